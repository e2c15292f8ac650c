// annotations.json is written by people and sent by other hosts.
#include <string>

#include "base/check.h"
#include "base/json/annotations_file.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const std::string note =
      R"({"position": [500004.1, 4e6, -3], "normal": [0, 0, 1], "title": "Crack \u00e4", "text": "4 mm\n\"wide\"",)"
      R"( "camera": {"position": [5, 4, 1], "target": [5, 4, 3], "up": [0, 1, 0], "fov_y_degrees": 30}})";
  const std::string text = "{\"version\": 1, \"annotations\": [" + note + ", " + note + "]}";
  const std::string none = "{\"version\": 1, \"annotations\": []}";
  return {{text.begin(), text.end()}, {none.begin(), none.end()}};
}

void fuzzOne(base::ByteView bytes) {
  const auto notes = base::parseAnnotations(bytes, "annotations");
  if (!notes) {
    LUMIGRID_CHECK(notes.error().message.find('\n') == std::string::npos);
    return;
  }
  LUMIGRID_CHECK(notes->size() <= base::kMaxAnnotations);
  for (const base::Annotation& note : *notes) LUMIGRID_CHECK(bool(base::checkedAnnotation(note)));
}

}  // namespace fuzz
