#include "client/native/answer_json.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/format_text.h"
#include "base/json/parse.h"

namespace client {
namespace {

using nlohmann::json;

base::Error bad(const std::string& place, const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, place + ": " + problem};
}

base::Result<json> parse(base::ByteView text, std::size_t limit, const std::string& name) {
  if (text.size() > limit) return bad(name, "has more than " + std::to_string(limit) + " bytes");
  json document = base::parseJson(text);
  if (!document.is_object()) return bad(name, "is not a JSON object");
  return document;
}

bool readNumber(const json& object, const char* key, double& value) {
  const auto it = object.find(key);
  if (it == object.end() || !it->is_number()) return false;
  value = it->get<double>();
  return std::isfinite(value);
}

bool readVector(const json& object, const char* key, glm::dvec3& v) {
  const auto it = object.find(key);
  if (it == object.end() || !it->is_array() || it->size() != 3) return false;
  for (int i = 0; i < 3; ++i) {
    const json& number = (*it)[static_cast<std::size_t>(i)];
    if (!number.is_number()) return false;
    v[i] = number.get<double>();
    if (!std::isfinite(v[i])) return false;
  }
  return true;
}

}  // namespace

std::string pickTarget(const glm::dvec3& origin, const glm::dvec3& direction) {
  return base::formatText("/pick?ox=%.17g&oy=%.17g&oz=%.17g&dx=%.17g&dy=%.17g&dz=%.17g", origin.x, origin.y, origin.z,
                          direction.x, direction.y, direction.z);
}

base::Result<PickAnswer> parsePickAnswer(base::ByteView text) {
  const std::string name = "the server's answer to a pick";
  LUMIGRID_ASSIGN_OR_RETURN(const auto document, parse(text, kMaxPickAnswer, name));
  const auto hit = document.find("hit");
  if (hit == document.end() || !hit->is_boolean()) return bad(name, "hit must be true or false");
  PickAnswer answer;
  answer.kind = PickAnswer::Kind::kNone;
  if (!hit->get<bool>()) return answer;
  answer.kind = PickAnswer::Kind::kHit;
  if (!readVector(document, "point", answer.point)) return bad(name, "point must be three numbers");
  if (!readVector(document, "normal", answer.normal)) return bad(name, "normal must be three numbers");
  if (!readNumber(document, "accuracy", answer.accuracy) || answer.accuracy < 0.0)
    return bad(name, "accuracy must be a number from 0 on");
  return answer;
}

}  // namespace client
