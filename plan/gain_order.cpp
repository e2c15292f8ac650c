#include "plan/gain_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>
#include <utility>

#include "base/check.h"
#include "repository/sampling/cube_face.h"

namespace plan {
namespace {

// The formula's numbers, fitted to what pictures of random views showed (docs/decisions/gain-per-byte.md).
constexpr float kProxyNoise2 = 1.6e-5F;  // p²
constexpr float kColorShare = 0.45F;     // a
constexpr float kOutline2 = 5e-4F;       // o²
constexpr float kImageNoise2 = 5e-5F;    // n²
constexpr float kImageShare = 0.1F;      // i
constexpr float kShiftShare = 0.5F;      // h
constexpr float kFarShift = 60.0F;       // f
constexpr float kTexelShare = 0.03F;     // x
constexpr float kTexelPower = 0.7F;
constexpr float kShift = 3.0F;         // of s, as BlendTuning's
constexpr float kFailingShare = 0.1F;  // q
/// The share of later views' gain that counts while the eye moves. A choice (docs/decisions/gain-per-byte.md).
constexpr float kLater = 0.3F;
/// An image that gains less for each of its bytes is not sent: 2e-7 for one of 10 kB. A picture of 40 dB has an error
/// of 1e-4.
constexpr double kLeastImageRate = 2e-11;
/// A group that is not needed and gains less for each of its bytes is not sent
/// (docs/decisions/refine-at-rest.md).
constexpr double kLeastRate = 1e-11;

/// The numbers that errors at a sample depend on, after some of its groups.
struct Shading {
  float proxy2 = 0.0F;  // P²
  float color2 = 0.0F;  // a c²
  float shape = 0.0F;   // typical, scene units
};

Shading shadingAt(const ProxyShading& proxy, float density) {
  const float shape_px = proxy.shape_error * density;
  const float color2 = kColorShare * proxy.color_error * proxy.color_error;
  return {kProxyNoise2 + color2 + kOutline2 * std::min(1.0F, shape_px * shape_px), color2, proxy.shape_error};
}

/// One image of a sample, by the parts of its error.
struct Look {
  std::size_t point = 0;
  float texel2 = 0.0F;  // the part that its texels make
  float shift = 0.0F;   // s, for a shape that errs by 1

  float error2(const Shading& shading) const {
    const float s = shift * shading.shape;
    const float far = s / kFarShift;
    return kImageNoise2 + texel2 + shading.color2 * (kImageShare + kShiftShare * s / (1.0F + s) + far * far);
  }
};

/// The best two at a place, from different points.
struct BestTwo {
  float best, second;
  std::size_t best_point = SIZE_MAX;

  explicit BestTwo(float proxy2) : best(proxy2), second(proxy2) {}
  float expected() const { return (1.0F - kFailingShare) * best + kFailingShare * second; }
  void add(std::size_t point, float error2) {
    if (point == best_point) {
      best = std::min(best, error2);
    } else if (error2 < best) {
      second = best;
      best = error2, best_point = point;
    } else {
      second = std::min(second, error2);
    }
  }
};

/// One image at a place that it shows.
struct Shown {
  std::uint32_t image = 0;
  Look look;
  float gain = 0.0F;  // by how much the place's expected error would fall if it came now; 0 once it has come
};

struct Place {
  float detail2 = 0.0F;             // C²
  std::vector<Shading> shadings;    // after 0, 1, … of its groups
  std::vector<std::size_t> groups;  // that make the next
  std::size_t state = 0;            // groups that came
  std::vector<Shown> images;
  std::vector<BestTwo> errors;  // beside `shadings`, with the images that came

  float expected() const { return errors[state].expected(); }
  float gainOf(const Look& look) const {
    BestTwo with = errors[state];
    with.add(look.point, look.error2(shadings[state]));
    return expected() - with.expected();
  }
  /// By how much its group from this state to the next lessens the error.
  float gainOfGroupAt(std::size_t at) const { return errors[at].expected() - errors[at + 1].expected(); }
};

struct Image {
  repository::FaceKey key;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> places;  // sample, index into its `images`
  double bytes = 1.0;
  double gain = 0.0;
  bool has_come = false;
  double rate() const { return gain / bytes; }
};

struct Group {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> steps;  // sample, its state before
  std::vector<std::size_t> children;
  std::size_t parents_left = 0;
  double gain = 0.0;   // of the group alone, in this view
  float later = 0.0F;  // and in others
  bool has_come = false;
};

/// Gain and bytes of a group with the best of what it makes possible.
struct Prospect {
  double gain = 0.0, bytes = 1.0;
  double rate() const { return gain / bytes; }
  bool isBetterThan(const Prospect& other) const { return gain * other.bytes > other.gain * bytes; }
};

class GainOrder {
 public:
  GainOrder(const GainQuery& query, std::span<const SurfaceSample> samples, std::span<const ProxyPlace> places,
            std::span<const OrderedGroup> groups)
      : query_(query), samples_(samples), input_(groups), places_(samples.size()), groups_(groups.size()) {
    for (std::size_t g = 0; g < groups.size(); ++g) {
      groups_[g].parents_left = groups[g].parents.size();
      for (const std::size_t parent : groups[g].parents) groups_[parent].children.push_back(g);
      const float gained =
          shadingAt(groups[g].before, groups[g].density).proxy2 - shadingAt(groups[g].after, groups[g].density).proxy2;
      if (query.is_moving && groups[g].is_needed) groups_[g].later = kLater * groups[g].share * std::max(0.0F, gained);
    }
    for (std::size_t s = 0; s < samples.size(); ++s) addPlace(static_cast<std::uint32_t>(s), places[s]);
    for (std::size_t g = groups.size(); g-- > 0;) left_.push_back(g);
    prospects_.resize(groups.size());
  }

  void addPoint(std::size_t number, const glm::uvec3& point) {
    const glm::vec3 position = query_.points.grid.point(point.x, point.y, point.z);
    for (std::size_t s = 0; s < samples_.size(); ++s) addLooks(number, point, position, static_cast<std::uint32_t>(s));
  }

  OrderByGain order() {
    std::size_t here = 0;
    for (std::uint32_t s = 0; s < places_.size(); ++s) renewImagesAt(s);
    for (Image& image : images_)
      if (query_.is_here(image.key)) take(image), ++here;
    // Tiles that are here may be too coarse by now.
    const std::size_t least = query_.points.grid.isTiled() ? query_.max_images / 4 : 0;
    images_left_ = std::max(least, query_.max_images - std::min(query_.max_images, here));
    OrderByGain order;
    order.error_before = expectedError();
    order.items = takeAll();
    order.error_after = expectedError();
    return order;
  }

 private:
  float expectedError() const {
    float sum = 0.0F;
    for (std::size_t s = 0; s < samples_.size(); ++s) sum += samples_[s].weight * places_[s].expected();
    return sum;
  }

  std::vector<OrderedItem> takeAll() {
    std::vector<OrderedItem> items;
    while (true) {
      std::optional<Prospect> group = findBestGroup(false);
      if (group && group->rate() < kLeastRate) group = findBestGroup(true);
      const std::optional<std::uint32_t> image = images_left_ > 0 ? findBestImage() : std::nullopt;
      if (!group && !image) return items;
      if (group && (!image || group->rate() >= images_[*image].rate())) {
        items.push_back({std::nullopt, best_group_, static_cast<float>(std::max(0.0, groups_[best_group_].gain))});
        take(groups_[best_group_]);
      } else {
        items.push_back({images_[*image].key, 0, static_cast<float>(images_[*image].gain)});
        take(images_[*image]);
        --images_left_;
      }
    }
  }

  // ---- what there is ----

  void addPlace(std::uint32_t s, const ProxyPlace& input) {
    const SurfaceSample& sample = samples_[s];
    const glm::vec3 to_eye = query_.points.eye - sample.position;
    const float eye_distance = std::max(glm::length(to_eye), 1e-20F);
    const float density = query_.points.pixels_per_unit_at_one / eye_distance;
    Place& place = places_[s];
    place.detail2 = input.detail * input.detail;
    float color = 1.0F, shape = std::numeric_limits<float>::max();
    const auto add = [&](const ProxyShading& shading) {
      // Errors are estimates, and those of a finer proxy may be larger. It is no worse.
      color = std::min(color, shading.color_error);
      shape = std::min(shape, shading.shape_error);
      place.shadings.push_back(shadingAt({color, shape}, density));
      place.errors.emplace_back(place.shadings.back().proxy2);
    };
    add(input.now);
    for (const ProxyPlace::Refined& refined : input.refined) {
      groups_[refined.group].steps.emplace_back(s, static_cast<std::uint32_t>(place.groups.size()));
      place.groups.push_back(refined.group);
      add(refined.shading);
    }
    for (std::size_t at = 0; at < place.groups.size(); ++at)
      groups_[place.groups[at]].gain += static_cast<double>(sample.weight * place.gainOfGroupAt(at));
  }

  /// The images of a point that show a sample, from the whole face down to the finest that is of use.
  void addLooks(std::size_t number, const glm::uvec3& point, const glm::vec3& position, std::uint32_t s) {
    const SurfaceSample& sample = samples_[s];
    const glm::vec3 to_eye = query_.points.eye - sample.position;
    const glm::vec3 to_point = position - sample.position;
    const float eye_distance = glm::length(to_eye);
    const float distance = glm::length(to_point);
    if (!(eye_distance > 0.0F) || !(distance > 0.0F)) return;
    float slant = 1.0F;
    if (glm::dot(sample.normal, sample.normal) > 0.0F) {
      // A surface that turns away from the point is not seen by it. Scans are open, so either side may be looked at.
      const float towards_eye = glm::dot(sample.normal, to_eye) / eye_distance;
      const float towards_point = glm::dot(sample.normal, to_point) / distance;
      slant = towards_eye < 0.0F ? -towards_point : towards_point;
      if (slant <= 0.0F) return;
    }

    const repository::Grid& grid = query_.points.grid;
    const float density = query_.points.pixels_per_unit_at_one / eye_distance;
    const auto sharpnessAt = [&](std::uint32_t depth) {
      return 0.5F * static_cast<float>(grid.faceSideAt(depth)) / distance / density * slant;
    };
    std::uint32_t deepest = 0;
    while (deepest < grid.tile_depth && sharpnessAt(deepest) < 1.0F) ++deepest;
    const repository::FaceKey finest = repository::tileOfDirection(-to_point, deepest);
    std::array<std::uint32_t, repository::kMaxTileDepth + 1> path{};
    path[deepest] = finest.tile;
    for (std::uint32_t depth = deepest; depth > 0; --depth) path[depth - 1] = repository::parentOfTile(path[depth]);
    const auto keyAt = [&](std::uint32_t depth) {
      return repository::FaceKey{point.x, point.y, point.z, finest.d, path[depth]};
    };

    if (storedBytes(keyAt(0)) == 0) return;
    // An absent tile leaves what it would have shown to the one above it.
    std::uint32_t last = 0;
    while (last < deepest && storedBytes(keyAt(last + 1)) != 0) ++last;
    const float angle = glm::length(to_eye / eye_distance - to_point / distance);
    std::array<Look, repository::kMaxTileDepth + 1> looks;
    std::array<bool, repository::kMaxTileDepth + 1> is_of_use{};
    for (std::uint32_t depth = 0; depth <= last; ++depth) {
      const float texel = 1.0F / std::clamp(sharpnessAt(depth == last ? deepest : depth), 0.01F, 1.0F);
      const float lost = kTexelShare * std::pow(texel * texel - 1.0F, kTexelPower);
      const Look look{number, lost * places_[s].detail2, kShift * density * angle};
      const auto helps = [&](const Shading& shading) { return look.error2(shading) < shading.proxy2; };
      is_of_use[depth] = helps(places_[s].shadings.front()) || helps(places_[s].shadings.back());
      looks[depth] = look;
    }
    // Lines of sight are what costs most, so they are tested last.
    if (std::find(is_of_use.begin(), is_of_use.end(), true) == is_of_use.end()) return;
    if (!isInSight(query_.points, position, sample)) return;
    for (std::uint32_t depth = 0; depth <= last; ++depth)
      if (is_of_use[depth]) addLook(keyAt(depth), s, looks[depth]);
  }

  std::uint64_t storedBytes(const repository::FaceKey& key) {
    const auto [found, is_new] = stored_bytes_.try_emplace(key.code(), query_.image_bytes);
    if (is_new && query_.stored_bytes) found->second = query_.stored_bytes(key).value_or(query_.image_bytes);
    return found->second;
  }

  void addLook(const repository::FaceKey& key, std::uint32_t s, const Look& look) {
    const auto [found, is_new] = numbers_.try_emplace(key.code(), static_cast<std::uint32_t>(images_.size()));
    if (is_new) images_.push_back({key, {}, static_cast<double>(storedBytes(key))});
    images_[found->second].places.emplace_back(s, static_cast<std::uint32_t>(places_[s].images.size()));
    places_[s].images.push_back({found->second, look});
  }

  // ---- what it gains ----

  // Gains are kept, and changed by what an item changes at its places: all of them are looked at for each next one.

  /// The images of a place gain more or less by now.
  void renewImagesAt(std::uint32_t s) {
    Place& place = places_[s];
    for (Shown& shown : place.images) {
      Image& image = images_[shown.image];
      if (image.has_come) continue;
      const float gain = place.gainOf(shown.look);
      image.gain += static_cast<double>(samples_[s].weight) * static_cast<double>(gain - shown.gain);
      shown.gain = gain;
    }
  }

  /// The image that gains most for its bytes, of equals the first, if any gains enough.
  std::optional<std::uint32_t> findBestImage() const {
    std::optional<std::uint32_t> best;
    double best_rate = kLeastImageRate;
    for (std::uint32_t i = 0; i < images_.size(); ++i)
      if (!images_[i].has_come && images_[i].rate() >= best_rate && !(best && images_[i].rate() == best_rate))
        best = i, best_rate = images_[i].rate();
    return best;
  }

  /// Finds the group that may come next with the best prospect: best_group_. One that gains nothing itself may be
  /// worth its bytes for those after it. `needed`: of those that are needed.
  std::optional<Prospect> findBestGroup(bool needed) {
    std::optional<Prospect> best;
    std::erase_if(left_, [this](std::size_t g) { return groups_[g].has_come; });
    for (const std::size_t g : left_) {
      const Group& group = groups_[g];
      const Prospect alone{std::max(0.0, group.gain) + static_cast<double>(group.later),
                           static_cast<double>(input_[g].bytes)};
      prospects_[g] = alone;
      for (const std::size_t child : group.children) {
        const Prospect both{alone.gain + prospects_[child].gain, alone.bytes + prospects_[child].bytes};
        if (both.isBetterThan(prospects_[g])) prospects_[g] = both;
      }
      if (needed && !input_[g].is_needed) continue;
      if (group.parents_left == 0 && (!best || !best->isBetterThan(prospects_[g])))
        best = prospects_[g], best_group_ = g;
    }
    return best;
  }

  void take(Image& image) {
    image.has_come = true;
    for (const auto& [s, index] : image.places) {
      Place& place = places_[s];
      const double weight = static_cast<double>(samples_[s].weight);
      for (std::size_t at = place.state; at < place.groups.size(); ++at)
        groups_[place.groups[at]].gain -= weight * static_cast<double>(place.gainOfGroupAt(at));
      const Look& look = place.images[index].look;
      for (std::size_t at = place.state; at < place.errors.size(); ++at)
        place.errors[at].add(look.point, look.error2(place.shadings[at]));
      for (std::size_t at = place.state; at < place.groups.size(); ++at)
        groups_[place.groups[at]].gain += weight * static_cast<double>(place.gainOfGroupAt(at));
      renewImagesAt(s);
    }
  }

  void take(Group& group) {
    group.has_come = true;
    for (const std::size_t child : group.children) --groups_[child].parents_left;
    for (const auto& [s, state] : group.steps) {
      places_[s].state = state + 1;
      renewImagesAt(s);
    }
  }

  const GainQuery& query_;
  std::span<const SurfaceSample> samples_;
  std::span<const OrderedGroup> input_;
  std::vector<Place> places_;
  std::vector<Group> groups_;
  std::vector<Image> images_;
  std::unordered_map<std::uint64_t, std::uint32_t> numbers_;       // of images, by code
  std::unordered_map<std::uint64_t, std::uint64_t> stored_bytes_;  // by code, as far as it was asked
  std::vector<std::size_t> left_;                                  // groups that have not come, children before parents
  std::vector<Prospect> prospects_;
  std::size_t best_group_ = 0;
  std::size_t images_left_ = 0;
};

}  // namespace

OrderByGain orderByGain(const GainQuery& query, std::span<const glm::uvec3> points,
                        std::span<const SurfaceSample> samples, std::span<const ProxyPlace> places,
                        std::span<const OrderedGroup> groups) {
  LUMIGRID_CHECK_EQ(samples.size(), places.size());
  GainOrder order(query, samples, places, groups);
  for (std::size_t i = 0; i < points.size(); ++i) order.addPoint(i, points[i]);
  return order.order();
}

}  // namespace plan
