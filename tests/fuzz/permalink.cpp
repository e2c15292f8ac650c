// Reads arbitrary links: each gives a view within its limits or a one-line error, and a link that was read is written
// and read again as the same view.
#include "client/app/permalink.h"

#include <cmath>

#include "base/check.h"
#include "protocol/message.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  for (const std::string text :
       {"v=1&p=500004.5,4000007,103.25&a=-120.5,-20&r=12.5&f=60&m=patches&o=sco&x=z,102.5,b",
        "#v=1&p=0,0,1&a=0,-90&r=1", "v=1&x=x,-1e-3,a&r=1e12&a=360,90&p=-1e12,0,1e12", "v=1&x=z,2.4,b", "v=2"})
    all.emplace_back(text.begin(), text.end());
  return all;
}

void fuzzOne(base::ByteView bytes) {
  const std::string text(bytes.begin(), bytes.end());
  const auto view = client::parsePermalink(text);
  if (!view) {
    LUMIGRID_CHECK(!view.error().message.empty() && view.error().message.size() < 200);
    return;
  }
  for (int i = 0; i < 3; ++i) LUMIGRID_CHECK(std::abs(view->position[i]) <= protocol::kMaxCoordinate);
  LUMIGRID_CHECK(std::abs(glm::length(view->direction) - 1.0) < 1e-12);
  LUMIGRID_CHECK(view->pivot_distance >= 0.0 && view->pivot_distance <= protocol::kMaxCoordinate);
  LUMIGRID_CHECK(view->fov_y > 0.0 && view->fov_y < 3.0);
  if (view->pivot_distance == 0.0) return;  // it has no place, and nothing writes such links

  // The written form is short, and stable.
  const std::string link = client::formatPermalink(*view);
  LUMIGRID_CHECK(link.size() <= client::kMaxPermalink);
  const auto again = client::parsePermalink(link);
  LUMIGRID_CHECK(bool(again));
  LUMIGRID_CHECK(client::formatPermalink(*again) == link);
}

}  // namespace fuzz
