// The module that shows triangles and points of a hierarchy.
#include <utility>

#include "client/source/streamed_hlod.h"
#include "client/web/page.h"

namespace client::web {

const Method kPageMethod = Method::kHlod;

std::shared_ptr<StreamedView> makeView(FilePlace file, const protocol::Welcome& welcome,
                                       std::unique_ptr<RangeFetcher> fetcher, const StreamedOptions& options) {
  return std::make_shared<StreamedHlod>(std::move(file), welcome, std::move(fetcher), options);
}

}  // namespace client::web
