// The module that shows splats.
#include <utility>

#include "client/source/streamed_splats.h"
#include "client/web/page.h"

namespace client::web {

const Method kPageMethod = Method::kQsplat;

std::shared_ptr<StreamedView> makeView(FilePlace file, const protocol::Welcome& welcome,
                                       std::unique_ptr<RangeFetcher> fetcher, const StreamedOptions& options) {
  return std::make_shared<StreamedSplats>(std::move(file), welcome, std::move(fetcher), options);
}

}  // namespace client::web
