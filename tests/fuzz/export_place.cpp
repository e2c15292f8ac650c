// Feeds any text to readExportPlace: it tells a place of finite numbers, none, or a one-line error.
#include "mesh/export_place.h"

#include <cmath>

#include "base/check.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  for (const std::string text :
       {"<ModelMetadata><SRS>EPSG:32632</SRS><SRSOrigin>691000,5334000,520</SRSOrigin></ModelMetadata>",
        "<ModelMetadata version=\"1\"><SRS>PROJCS[&quot;a&quot;,UNIT[&quot;metre&quot;,1],AUTHORITY[&quot;EPSG&quot;,"
        "&quot;1&quot;]]</SRS><SRSOrigin> 1e3; -2, +.5</SRSOrigin>",
        "<ModelMetadata><SRSOrigin>0,0</SRSOrigin>"})
    all.emplace_back(text.begin(), text.end());
  return all;
}

void fuzzOne(base::ByteView bytes) {
  const auto place = mesh::readExportPlace(base::textOf(bytes));
  if (!place) {
    LUMIGRID_CHECK(place.error().message.find('\n') == std::string::npos);
    return;
  }
  if (!*place) return;
  for (int axis = 0; axis < 3; ++axis) LUMIGRID_CHECK(std::isfinite((*place)->origin[axis]));
}

}  // namespace fuzz
