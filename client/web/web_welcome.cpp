#include "client/web/web_welcome.h"

namespace client {
namespace {

glm::dvec3 vectorAt(const double* numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}

}  // namespace

protocol::Welcome welcomeOf(const std::string& name, const std::string& units, const double* numbers) {
  protocol::Welcome welcome;
  welcome.scene_name = name;
  welcome.units = units == "unknown" ? "" : units;
  welcome.origin = vectorAt(numbers);
  welcome.box_min = glm::vec3(vectorAt(numbers + 3) - welcome.origin);
  welcome.box_max = glm::vec3(vectorAt(numbers + 6) - welcome.origin);
  welcome.up = glm::vec3(vectorAt(numbers + 9));
  welcome.unlit = numbers[12] != 0.0;
  welcome.light_direction = glm::vec3(vectorAt(numbers + 13));
  return welcome;
}

}  // namespace client
