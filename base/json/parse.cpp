#include "base/json/parse.h"

namespace base {

nlohmann::json parseJson(ByteView text) {
  using nlohmann::json;
  constexpr int kMaxDepth = 16;
  bool deep = false;
  const auto shallow = [&deep](int depth, json::parse_event_t, json&) {
    deep = deep || depth > kMaxDepth;
    return !deep;
  };
  json document = json::parse(text.begin(), text.end(), shallow, false);
  return deep ? json(json::value_t::discarded) : document;
}

}  // namespace base
