// Feeds any text to the readers of places of exports: each tells a place of finite numbers, none, or a one-line error.
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
        "<ModelMetadata><SRSOrigin>0,0</SRSOrigin>", "691000 5334000 520\n", "WGS84 UTM 32N\n691000 5334000\n1 2 3\n",
        "+proj=utm +zone=17 +south +datum=WGS84\n1 2\n", "EPSG:25832\r\n1.5 -2\r\n"})
    all.emplace_back(text.begin(), text.end());
  return all;
}

namespace {

void check(const mesh::ExportPlace& place) {
  for (int axis = 0; axis < 3; ++axis) LUMIGRID_CHECK(std::isfinite(place.origin[axis]));
}
void check(const std::optional<mesh::ExportPlace>& place) {
  if (place) check(*place);
}
template <typename Read>
void checkRead(const Read& read) {
  if (read)
    check(*read);
  else
    LUMIGRID_CHECK(read.error().message.find('\n') == std::string::npos);
}

}  // namespace

void fuzzOne(base::ByteView bytes) {
  const std::string_view text = base::textOf(bytes);
  checkRead(mesh::readMetadataXml(text));
  checkRead(mesh::readOffsetXyz(text, text));
  checkRead(mesh::readCoordsTxt(text));
}

}  // namespace fuzz
