// Reads arbitrary settings.json files and answers to a pick.
#include <cmath>

#include "base/check.h"
#include "client/native/answer_json.h"
#include "client/native/user_files.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  for (const std::string text :
       {R"({"hit":true,"point":[1.5,2,3],"normal":[0,0,1],"distance":3.5,"accuracy":0.001})", R"({"hit":false})",
        R"({"version":1,"fov_degrees":60,"points":4,"images":false,"theme":"dark","zoom_speed":-1.5})"})
    all.emplace_back(text.begin(), text.end());
  return all;
}

void fuzzOne(base::ByteView bytes) {
  if (const auto answer = client::parsePickAnswer(bytes))
    for (int i = 0; i < 3; ++i) LUMIGRID_CHECK(std::isfinite(answer->point[i]));
  const client::ReadSettings read = client::parseSettings(std::string(bytes.begin(), bytes.end()));
  for (const client::SettingField& field : client::settingFields()) {
    const double value = read.settings.*(field.value);
    LUMIGRID_CHECK(value >= field.min && value <= field.max);
  }
  LUMIGRID_CHECK(client::parseSettings(client::formatSettings(read.settings)).settings == read.settings);
}

}  // namespace fuzz
