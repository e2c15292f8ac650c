#include "server/views/indoor_paths.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <glm/gtc/quaternion.hpp>

namespace server {
namespace {

constexpr float kTurning = 10.0F;          // degrees a second
constexpr float kDown = 0.1F;              // radians below the horizon: rooms have more to see there than above
constexpr double kDiagonalSeconds = 12.0;  // of the box, walking
constexpr float kAhead = 0.06F;            // diagonals: as far ahead one looks while walking …
constexpr float kMostTurning = 80.0F;      // … and turns no faster, degrees a second; choices

glm::vec3 turned(const glm::vec3& direction, const glm::vec3& axis, float angle) {
  return glm::angleAxis(angle, axis) * direction;
}

// A level direction, somewhat lowered.
glm::vec3 lowered(const Indoors& indoors, const glm::vec3& level) {
  return glm::normalize(std::cos(kDown) * level - std::sin(kDown) * indoors.up());
}

IndoorEye turning(const Indoors& indoors, const glm::vec3& place, const glm::vec3& first, double degrees) {
  const auto angle = static_cast<float>(glm::radians(degrees));
  return {place, lowered(indoors, turned(first, indoors.up(), angle))};
}

// The angle around `up` from one direction to another, radians, −π to π.
float turnBetween(const glm::vec3& from, const glm::vec3& to, const glm::vec3& up) {
  const auto level = [&](const glm::vec3& direction) { return direction - glm::dot(direction, up) * up; };
  const glm::vec3 a = level(from);
  const glm::vec3 b = level(to);
  return std::atan2(glm::dot(glm::cross(a, b), up), glm::dot(a, b));
}

/// A line from place to place, by the way along it.
class Line {
 public:
  explicit Line(std::vector<glm::vec3> corners) : corners_(std::move(corners)), ways_{0.0F} {
    for (std::size_t i = 1; i < corners_.size(); ++i)
      ways_.push_back(ways_.back() + glm::distance(corners_[i - 1], corners_[i]));
  }
  float length() const { return ways_.back(); }
  float wayTo(std::size_t corner) const { return ways_[corner]; }
  glm::vec3 at(float way) const {
    const auto after = std::upper_bound(ways_.begin(), ways_.end(), std::clamp(way, 0.0F, length()));
    if (after == ways_.end()) return corners_.back();
    const auto i = static_cast<std::size_t>(after - ways_.begin());
    return glm::mix(corners_[i - 1], corners_[i], (way - ways_[i - 1]) / (ways_[i] - ways_[i - 1]));
  }

 private:
  std::vector<glm::vec3> corners_;
  std::vector<float> ways_;  ///< to each corner
};

Line walkLine(const Indoors& indoors) {
  std::vector<glm::vec3> corners;
  for (const std::size_t place : indoors.walk()) corners.push_back(indoors.places()[place]);
  return Line(std::move(corners));
}

}  // namespace

std::vector<IndoorEye> indoorOrbit(const Indoors& indoors, double seconds, int frames) {
  const glm::vec3& place = indoors.places().front();
  const glm::vec3 first = indoors.widestDirection(place);
  std::vector<IndoorEye> eyes;
  for (int i = 0; i < frames; ++i) eyes.push_back(turning(indoors, place, first, kTurning * seconds * i));
  return eyes;
}

std::vector<IndoorEye> indoorJitter(const Indoors& indoors, double seconds, int frames) {
  const glm::vec3& place = indoors.places().front();
  const glm::vec3 first = indoors.widestDirection(place);
  const float amplitude = glm::radians(0.5F);
  std::vector<IndoorEye> eyes;
  for (int i = 0; i < frames; ++i) {
    const double t = seconds * i;
    IndoorEye eye = turning(indoors, place, first, 0.2 * kTurning * t);
    const glm::vec3 right = glm::normalize(glm::cross(eye.direction, indoors.up()));
    const glm::vec3 tremble =
        static_cast<float>(std::sin(19.0 * t)) * right + static_cast<float>(std::sin(23.0 * t + 1.0)) * indoors.up();
    eye.direction = glm::normalize(eye.direction + amplitude * tremble);
    eyes.push_back(eye);
  }
  return eyes;
}

std::vector<IndoorEye> indoorApproach(const Indoors& indoors, double seconds, int frames) {
  const auto line = indoors.longestLine();
  const glm::vec3 from = indoors.places()[line ? line->first : 0];
  const glm::vec3 direction =
      line ? glm::normalize(indoors.places()[line->second] - from) : indoors.widestDirection(from);
  const float whole = indoors.distance(from, direction);
  const glm::vec3 wall = from + whole * direction;
  std::vector<IndoorEye> eyes;
  for (int i = 0; i < frames; ++i) {
    const auto nearer = static_cast<float>(std::exp2(-0.25 * seconds * i));
    eyes.push_back({wall - whole * std::max(0.05F, nearer) * direction, direction});
  }
  return eyes;
}

std::vector<IndoorEye> indoorWalk(const Indoors& indoors, double seconds, int frames) {
  const Line line = walkLine(indoors);
  const float diagonal = indoors.box().diagonal();
  if (line.length() <= kAhead * diagonal) return indoorOrbit(indoors, seconds, frames);  // nowhere to go
  const auto step = static_cast<float>(diagonal * seconds / kDiagonalSeconds);
  const auto most = glm::radians(kMostTurning) * static_cast<float>(seconds);
  const auto onward = [&](float way) { return line.at(std::fmod(way, line.length())); };
  std::vector<IndoorEye> eyes;
  for (int i = 0; i < frames; ++i) {
    const float way = step * static_cast<float>(i);
    IndoorEye eye{onward(way), glm::vec3(0.0F)};
    const glm::vec3 toward = onward(way + kAhead * diagonal) - eye.position;
    // Where the walk turns back what lies ahead is here.
    const glm::vec3 level = toward - glm::dot(toward, indoors.up()) * indoors.up();
    const bool is_clear = glm::length(level) > 0.2F * kAhead * diagonal;
    const glm::vec3 ahead = is_clear       ? lowered(indoors, glm::normalize(level))
                            : eyes.empty() ? lowered(indoors, indoors.widestDirection(eye.position))
                                           : eyes.back().direction;
    if (!eyes.empty()) {
      const glm::vec3& before = eyes.back().direction;
      eye.direction = turned(before, indoors.up(), std::clamp(turnBetween(before, ahead, indoors.up()), -most, most));
    } else {
      eye.direction = ahead;
    }
    eyes.push_back(eye);
  }
  return eyes;
}

std::vector<IndoorEye> indoorTour(const Indoors& indoors, int frames) {
  // Densely, so that one turns no faster than one who walks; of those every so many.
  constexpr int kSteps = 60;
  const Line line = walkLine(indoors);
  const double seconds = kDiagonalSeconds * static_cast<double>(line.length() / indoors.box().diagonal());
  const bool stands = line.length() <= kAhead * indoors.box().diagonal();
  const double whole = stands ? 360.0 / kTurning : seconds;
  const auto eyes = indoorWalk(indoors, whole / (kSteps * frames), kSteps * frames);
  std::vector<IndoorEye> tour;
  for (int i = 0; i < frames; ++i) tour.push_back(eyes[static_cast<std::size_t>(kSteps) * static_cast<std::size_t>(i)]);
  return tour;
}

std::vector<IndoorEye> indoorInspection(const Indoors& indoors, double seconds, int frames) {
  const Line line = walkLine(indoors);
  const auto& walk = indoors.walk();
  struct Stop {
    float way = 0.0F;
    glm::vec3 direction{0.0F};
  };
  std::vector<Stop> stops;
  const float apart = 0.1F * indoors.box().diagonal();
  for (std::size_t i = 0; i < walk.size(); ++i) {
    const glm::vec3& place = indoors.places()[walk[i]];
    if (!stops.empty() && line.wayTo(i) - stops.back().way < apart) continue;
    stops.push_back({line.wayTo(i), lowered(indoors, indoors.widestDirection(place))});
  }
  std::vector<IndoorEye> eyes;
  for (int i = 0; i < frames; ++i) {
    const double t = seconds * i;
    const auto stop = static_cast<std::size_t>(t / 4.0);
    const Stop& a = stops[stop % stops.size()];
    const Stop& b = stops[(stop + 1) % stops.size()];
    const auto moved = static_cast<float>(std::clamp(t - 4.0 * static_cast<double>(stop) - 3.0, 0.0, 1.0));
    const float smooth = moved * moved * (3.0F - 2.0F * moved);
    const float to = b.way > a.way ? b.way : b.way + line.length();  // the walk ends where it begins
    const float way = stops.size() == 1 ? a.way : std::fmod(glm::mix(a.way, to, smooth), line.length());
    const float angle = smooth * turnBetween(a.direction, b.direction, indoors.up());
    eyes.push_back({line.at(way), turned(a.direction, indoors.up(), angle)});
  }
  return eyes;
}

}  // namespace server
