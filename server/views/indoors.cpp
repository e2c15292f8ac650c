#include "server/views/indoors.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <limits>

#include "server/views/level.h"
#include "server/views/unit_random.h"

namespace server {
namespace {

constexpr std::uint32_t kSeed = 1887;
constexpr std::size_t kDirections = 96;  // lines of sight; a choice
// In a room so many of the lines of sight end at a surface, and so many of these at its front. A choice: half of them
// do above open ground, and doors, windows and what the scanner missed leave some of them open.
constexpr float kEnding = 0.75F;
constexpr float kFronts = 0.7F;
constexpr float kSeen = 0.5F;  // a choice: a point just above a floor sees no less
// Nothing is nearer than this, over the median distance: nobody stands in a cupboard or with the nose at a wall.
constexpr float kNearest = 0.12F;
// … and at the places of tours and paths nothing is nearer than this: looking ahead there shows more than a wall.
constexpr float kRoomAround = 0.3F;
// Eyes are so high between floor and ceiling.
constexpr float kEyeLevel = 0.6F;
constexpr std::size_t kTries = 6'000;    // random places that are looked at …
constexpr std::size_t kMaxFound = 600;   // … until so many are in rooms
constexpr std::size_t kMaxPlaces = 120;  // spread over these; a room has several, so that doors are found
constexpr std::size_t kVisited = 24;     // the walk passes by the first so many
constexpr float kBody = 0.06F;           // in heights of the first place's room
constexpr int kLevelDirections = 48;     // among which the widest is found
constexpr float kUnreached = std::numeric_limits<float>::infinity();

// Directions that are evenly spread (Fibonacci's lattice on a sphere: Swinbank, Purser 2006).
std::vector<glm::vec3> evenDirections(std::size_t count) {
  std::vector<glm::vec3> directions;
  const float golden = glm::pi<float>() * (3.0F - std::sqrt(5.0F));
  for (std::size_t i = 0; i < count; ++i) {
    const float z = 1.0F - (2.0F * static_cast<float>(i) + 1.0F) / static_cast<float>(count);
    const float around = golden * static_cast<float>(i);
    const float r = std::sqrt(1.0F - z * z);
    directions.emplace_back(r * std::cos(around), r * std::sin(around), z);
  }
  return directions;
}

// Clear lines between places, by number.
class Ways {
 public:
  explicit Ways(std::size_t places) : lengths_(places, std::vector<float>(places, kUnreached)) {}
  void add(std::size_t a, std::size_t b, float length) { lengths_[a][b] = lengths_[b][a] = length; }

  struct Routes {
    std::vector<float> lengths;
    std::vector<std::size_t> before;  ///< the place before each on its route
  };
  // Dijkstra's routes from one place to all.
  Routes from(std::size_t start) const {
    Routes routes{std::vector<float>(lengths_.size(), kUnreached), std::vector<std::size_t>(lengths_.size(), start)};
    routes.lengths[start] = 0.0F;
    std::vector<bool> done(lengths_.size());
    for (;;) {
      std::size_t next = lengths_.size();
      for (std::size_t i = 0; i < lengths_.size(); ++i)
        if (!done[i] && routes.lengths[i] < (next == lengths_.size() ? kUnreached : routes.lengths[next])) next = i;
      if (next == lengths_.size()) return routes;
      done[next] = true;
      for (std::size_t i = 0; i < lengths_.size(); ++i)
        if (routes.lengths[next] + lengths_[next][i] < routes.lengths[i]) {
          routes.lengths[i] = routes.lengths[next] + lengths_[next][i];
          routes.before[i] = next;
        }
    }
  }

 private:
  std::vector<std::vector<float>> lengths_;
};

}  // namespace

/// Around a place: whether it is in a room, and how far one sees from it.
struct Indoors::Outlook {
  bool is_room = false;
  float fronts = 0.0F;                  ///< share of the lines of sight that end at the front of a surface
  float nearest = 0.0F, median = 0.0F;  ///< distance of the surface, scene units
};

Indoors::Indoors(lod::patch::ProxySight sight, const base::Aabb& box, const glm::vec3& up)
    : sight_(std::move(sight)), box_(box), up_(up), directions_(evenDirections(kDirections)) {}

base::Result<std::optional<Indoors>> Indoors::ofScene(const base::Scene& scene, const lod::patch::PatchFile& patches) {
  if (!scene.interior) return std::optional<Indoors>();
  LUMIGRID_ASSIGN_OR_RETURN(auto sight, lod::patch::ProxySight::ofFile(patches));
  return find(std::move(sight), scene.localBox(), glm::vec3(glm::normalize(scene.up)));
}

std::optional<Indoors> Indoors::find(lod::patch::ProxySight sight, const base::Aabb& box, const glm::vec3& up) {
  Indoors indoors(std::move(sight), box, up);
  indoors.findPlaces();
  if (indoors.places_.empty()) return std::nullopt;
  indoors.findWalk();
  return indoors;
}

float Indoors::distance(const glm::vec3& from, const glm::vec3& direction) const {
  const float far = box_.diagonal();
  const auto hit = sight_.nearest(from, direction, far);
  return hit ? hit->distance : far;
}

Indoors::Outlook Indoors::lookAround(const glm::vec3& point) const {
  std::vector<float> distances;
  std::size_t fronts = 0;
  for (const glm::vec3& direction : directions_) {
    const auto hit = sight_.nearest(point, direction, box_.diagonal());
    if (!hit) continue;
    distances.push_back(hit->distance);
    if (glm::dot(hit->normal, direction) < 0.0F) ++fronts;
  }
  Outlook outlook;
  outlook.fronts = static_cast<float>(fronts) / static_cast<float>(directions_.size());
  const auto ending = static_cast<float>(distances.size());
  if (ending < kEnding * static_cast<float>(directions_.size())) return outlook;
  std::sort(distances.begin(), distances.end());
  outlook.nearest = distances.front();
  outlook.median = distances[distances.size() / 2];
  outlook.is_room = static_cast<float>(fronts) >= kFronts * ending && outlook.nearest >= kNearest * outlook.median;
  return outlook;
}

bool Indoors::contains(const glm::vec3& point) const {
  return lookAround(point).is_room;
}

bool Indoors::seesRooms(const glm::vec3& point) const {
  return lookAround(point).fronts >= kSeen;
}

// As high above the floor beneath it as eyes are; nothing without a floor and a ceiling.
std::optional<glm::vec3> Indoors::eyeLevel(const glm::vec3& point) const {
  const auto floor = sight_.nearest(point, -up_, box_.diagonal());
  const auto ceiling = sight_.nearest(point, up_, box_.diagonal());
  if (!floor || !ceiling) return std::nullopt;
  return point + (kEyeLevel * (floor->distance + ceiling->distance) - floor->distance) * up_;
}

// Whether something of some width passes.
bool Indoors::hasWay(const glm::vec3& from, const glm::vec3& to) const {
  const glm::vec3 along = to - from;
  glm::vec3 side = glm::cross(along, up_);
  side = glm::length(side) > 1e-3F * glm::length(along) ? glm::normalize(side)
                                                        : glm::vec3(levelDirection(glm::dvec3(up_)));
  for (const glm::vec3& aside : {glm::vec3(0.0F), body_ * side, -body_ * side, -2.0F * body_ * up_})
    if (sight_.isBlocked(from + aside, to + aside, 0.0F)) return false;
  return true;
}

void Indoors::findPlaces() {
  UnitRandom random(kSeed);
  struct Found {
    glm::vec3 place{0.0F};
    float median = 0.0F;
  };
  std::vector<Found> found, narrow;
  for (std::size_t i = 0; i < kTries && found.size() < kMaxFound; ++i) {
    glm::vec3 share;
    for (int axis = 0; axis < 3; ++axis) share[axis] = static_cast<float>(random());
    const glm::vec3 point = box_.min + share * box_.size();
    if (!contains(point)) continue;
    const auto eye = eyeLevel(point);
    if (!eye) continue;
    const Outlook outlook = lookAround(*eye);
    if (!outlook.is_room) continue;
    (outlook.nearest >= kRoomAround * outlook.median ? found : narrow).push_back({*eye, outlook.median});
  }
  if (found.empty()) found = std::move(narrow);  // a gallery of a mine
  if (found.empty()) return;
  const auto widest =
      std::max_element(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.median < b.median; });
  std::vector<float> away(found.size(), kUnreached), medians;
  for (auto next = static_cast<std::size_t>(widest - found.begin()); places_.size() < kMaxPlaces;) {
    places_.push_back(found[next].place);
    medians.push_back(found[next].median);
    for (std::size_t i = 0; i < found.size(); ++i)
      away[i] = std::min(away[i], glm::distance(found[i].place, places_.back()));
    next = static_cast<std::size_t>(std::max_element(away.begin(), away.end()) - away.begin());
    if (away[next] <= 0.0F) break;
  }
  const auto middle = medians.begin() + static_cast<std::ptrdiff_t>(medians.size() / 2);
  std::nth_element(medians.begin(), middle, medians.end());
  width_ = 2.0F * *middle;
  const glm::vec3& first = places_.front();
  body_ = kBody * (distance(first, up_) + distance(first, -up_));
}

void Indoors::findWalk() {
  Ways ways(places_.size());
  float longest = 0.0F;
  for (std::size_t a = 0; a < places_.size(); ++a)
    for (std::size_t b = a + 1; b < places_.size(); ++b) {
      if (!hasWay(places_[a], places_[b])) continue;
      const float length = glm::distance(places_[a], places_[b]);
      ways.add(a, b, length);
      if (length <= longest) continue;
      longest = length;
      longest_line_.emplace(a, b);
    }
  walk_ = {0};
  std::vector<bool> visited(std::min(kVisited, places_.size()));
  visited[0] = true;
  for (bool is_back = false; !is_back;) {
    const Ways::Routes routes = ways.from(walk_.back());
    std::size_t next = 0;
    for (std::size_t i = 1; i < visited.size(); ++i)
      if (!visited[i] && routes.lengths[i] < (next == 0 ? kUnreached : routes.lengths[next])) next = i;
    is_back = next == 0;
    std::vector<std::size_t> route;
    for (std::size_t at = next; at != walk_.back(); at = routes.before[at]) route.push_back(at);
    for (; !route.empty(); route.pop_back()) {
      walk_.push_back(route.back());
      if (route.back() < visited.size()) visited[route.back()] = true;
    }
  }
}

glm::vec3 Indoors::widestDirection(const glm::vec3& from) const {
  const glm::vec3 side(levelDirection(glm::dvec3(up_)));
  const glm::vec3 across = glm::cross(up_, side);
  glm::vec3 widest = side;
  float farthest = 0.0F;
  for (int i = 0; i < kLevelDirections; ++i) {
    const float angle = glm::two_pi<float>() * static_cast<float>(i) / static_cast<float>(kLevelDirections);
    const glm::vec3 direction = std::cos(angle) * side + std::sin(angle) * across;
    const float reach = distance(from, direction);
    if (reach <= farthest) continue;
    farthest = reach;
    widest = direction;
  }
  return widest;
}

}  // namespace server
