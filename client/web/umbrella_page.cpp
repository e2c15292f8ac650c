// The module that shows points and umbrellas.
#include <utility>

#include "client/source/streamed_umbrellas.h"
#include "client/web/page.h"

namespace client::web {

const Method kPageMethod = Method::kPmr;

std::shared_ptr<StreamedView> makeView(FilePlace file, const protocol::Welcome& welcome,
                                       std::unique_ptr<RangeFetcher> fetcher, const StreamedOptions& options) {
  return std::make_shared<StreamedUmbrellas>(std::move(file), welcome, std::move(fetcher), options);
}

}  // namespace client::web
