#include "plan/gain_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
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
/// An image that gains less for each of its bytes is not sent: 2e-7 for one of 10 kB. A picture of 40 dB has an error
/// of 1e-4. Less where the model does not fill the picture (GainQuery::counts_foreground).
constexpr double kLeastImageRate = 2e-11;
/// A model that is smaller counts as so large. With a fiftieth an orbit of the refinery took a third more bytes, for
/// nothing (docs/decisions/gain-per-byte.md).
constexpr double kLeastForeground = 0.25;
/// A group that is not needed and gains less for each of its bytes is not sent where query.leaves_groups
/// (docs/decisions/refine-at-rest.md).
constexpr double kLeastRate = 1e-11;

/// The numbers that errors at a sample depend on, after some of its groups.
struct Shading {
  float proxy2 = 0.0F;  // P²
  float color2 = 0.0F;  // a c², as images lie on it
  float shape = 0.0F;   // typical, scene units
};

Shading shadingAt(const ProxyShading& proxy, float density) {
  const float shape_px = proxy.shape_error * density;
  const float color2 = kColorShare * proxy.color_error * proxy.color_error;
  return {kProxyNoise2 + color2 + kOutline2 * std::min(1.0F, shape_px * shape_px), color2, proxy.shape_error};
}

/// One image of a sample, by the parts of its error.
struct Look {
  std::uint32_t point = 0;
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
  std::uint32_t best_point = ~0U;

  explicit BestTwo(float proxy2) : best(proxy2), second(proxy2) {}
  friend bool operator==(const BestTwo&, const BestTwo&) = default;
  float expected() const { return (1.0F - kFailingShare) * best + kFailingShare * second; }
  void add(std::uint32_t point, float error2) {
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

/// A piece of surface. Its states, images and groups lie side by side with those of others: see GainOrder.
struct Place {
  float detail2 = 0.0F;           // C²
  std::uint32_t first_state = 0;  // of those after 0, 1, … of its groups
  std::uint32_t states = 1;
  std::uint32_t state = 0;                       // groups that came
  std::uint32_t first_shown = 0, end_shown = 0;  // of its images
};

/// A place after some of its groups, with the images that came.
struct State {
  Shading shading;
  BestTwo errors;
  std::uint32_t next_group = 0;  // that makes the next state, if there is one
};

/// One image at a place that it shows.
struct Shown {
  std::uint32_t sample = 0;
  std::uint32_t image = 0;
  Look look;
  float gain = 0.0F;  // by how much the place's expected error would fall if it came now; 0 once it has come
};

struct Image {
  repository::FaceKey key;
  std::uint64_t bytes = 1;
  double gain = 0.0;
  bool has_come = false;
  std::uint32_t first_place = 0, places = 0;  // where it is shown: in image_places_
};

struct Step {
  std::uint32_t sample = 0, state = 0;
};

struct Group {
  std::vector<std::size_t> children;
  std::vector<Step> steps;  // samples whose states it makes, from the state before
  std::size_t parents_left = 0;
  double gain = 0.0;     // of the group alone, in this view
  bool is_stale = true;  // its prospect is of an earlier gain
  float later = 0.0F;    // and in others
  bool has_come = false;
};

/// Gain and bytes of a group with the best of what it makes possible.
struct Prospect {
  double gain = 0.0, bytes = 1.0;
  double rate() const { return gain / bytes; }
  bool isBetterThan(const Prospect& other) const { return gain * other.bytes > other.gain * bytes; }
};

/// Gains a byte of images, of which the best is found by blocks: what changes changes few of them.
class Rates {
 public:
  void reset(std::size_t count) {
    rates_.assign(count, 0.0);
    best_.assign((count + kBlock - 1) / kBlock, kStale);
  }
  void set(std::uint32_t image, double rate) {
    rates_[image] = rate;
    best_[image / kBlock] = kStale;
  }
  double operator[](std::uint32_t image) const { return rates_[image]; }

  /// The best image, and the first of equally good ones.
  std::optional<std::uint32_t> findBest() {
    std::optional<std::uint32_t> best;
    for (std::size_t block = 0; block < best_.size(); ++block) {
      if (best_[block] == kStale) best_[block] = bestOf(block);
      if (!best || rates_[best_[block]] > rates_[*best]) best = best_[block];
    }
    return best;
  }

 private:
  static constexpr std::size_t kBlock = 64;
  static constexpr std::uint32_t kStale = ~0U;

  std::uint32_t bestOf(std::size_t block) const {
    const auto begin = rates_.begin() + static_cast<std::ptrdiff_t>(block * kBlock);
    const auto end = rates_.begin() + static_cast<std::ptrdiff_t>(std::min((block + 1) * kBlock, rates_.size()));
    return static_cast<std::uint32_t>(std::max_element(begin, end) - rates_.begin());
  }

  std::vector<double> rates_;
  std::vector<std::uint32_t> best_;  // image of each block
};

/// Keeps what is known of images by the codes of their keys, in a table of open places of which at most half are taken.
class ImageTable {
 public:
  static constexpr std::uint32_t kNone = ~0U;
  struct Entry {
    std::uint64_t code = kFree;
    std::uint64_t bytes = 0;       // 0: not stored
    std::uint32_t number = kNone;  // among those that show a sample
  };
  ImageTable() : entries_(std::size_t{1} << kFirstBits), shift_(64 - kFirstBits) {}

  /// The entry, and whether it is new. It is valid until the next call.
  std::pair<Entry*, bool> find(std::uint64_t code) {
    if (2 * (count_ + 1) > entries_.size()) grow();
    Entry& entry = placeOf(code);
    const bool is_new = entry.code == kFree;
    if (is_new) entry.code = code, ++count_;
    return {&entry, is_new};
  }

 private:
  static constexpr unsigned kFirstBits = 12;
  static constexpr std::uint64_t kFree = ~std::uint64_t{0};  // no key's

  Entry& placeOf(std::uint64_t code) {
    std::size_t at = code * 0x9E3779B97F4A7C15U >> shift_;  // Knuth's multiplicative hashing
    while (entries_[at].code != kFree && entries_[at].code != code) at = (at + 1) & (entries_.size() - 1);
    return entries_[at];
  }
  void grow() {
    --shift_;
    std::vector<Entry> old(2 * entries_.size());
    old.swap(entries_);
    for (const Entry& entry : old)
      if (entry.code != kFree) placeOf(entry.code) = entry;
  }

  std::vector<Entry> entries_;
  unsigned shift_;
  std::size_t count_ = 0;
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
      if (groups[g].is_needed) groups_[g].later = query.later_share * groups[g].share * std::max(0.0F, gained);
    }
    for (std::size_t s = 0; s < samples.size(); ++s) addPlace(static_cast<std::uint32_t>(s), places[s]);
    double foreground = 0.0;
    for (const SurfaceSample& sample : samples) foreground += static_cast<double>(sample.weight);
    if (query.counts_foreground) foreground_ = std::clamp(foreground, kLeastForeground, 1.0);
    for (std::size_t g = groups.size(); g-- > 0;) left_.push_back(g);
    prospects_.resize(groups.size());
  }

  void addPoint(std::uint32_t number, const glm::uvec3& point) {
    const glm::vec3 position = query_.points.grid.point(point.x, point.y, point.z);
    const SightOfPoint sight(query_.points, point);
    point_code_ = repository::codeOfPoint(point);
    for (std::uint32_t s = 0; s < samples_.size(); ++s) {
      // Lines of sight are what costs most, so they are tested last.
      const auto line = lineTo(number, point, position, s);
      if (line && sight.sees(samples_[s])) addLooks(point, *line);
    }
  }

  /// After the last point.
  OrderByGain order() {
    arrangeLooks();
    std::size_t here = 0;
    for (std::uint32_t s = 0; s < places_.size(); ++s) renewImagesAt(s);
    for (std::uint32_t i = 0; i < images_.size(); ++i)
      if (query_.is_here(images_[i].key)) takeImage(i), ++here;
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
    for (std::size_t s = 0; s < samples_.size(); ++s) sum += samples_[s].weight * stateOf(places_[s]).errors.expected();
    return sum;
  }

  std::vector<OrderedItem> takeAll() {
    std::vector<OrderedItem> items;
    while (true) {
      std::optional<Prospect> group = findBestGroup(false);
      if (query_.leaves_groups && group && group->rate() < kLeastRate) group = findBestGroup(true);
      const std::optional<std::uint32_t> image = images_left_ > 0 ? findBestImage() : std::nullopt;
      if (!group && !image) return items;
      if (group && (!image || group->rate() >= rates_[*image])) {
        items.push_back({std::nullopt, best_group_, static_cast<float>(std::max(0.0, groups_[best_group_].gain))});
        takeGroup(groups_[best_group_]);
      } else {
        items.push_back({images_[*image].key, 0, static_cast<float>(images_[*image].gain)});
        takeImage(*image);
        --images_left_;
      }
    }
  }

  const State& stateOf(const Place& place) const { return states_[place.first_state + place.state]; }
  /// By how much the group that makes the next state lessens the error.
  float gainOfNext(std::uint32_t state) const {
    return states_[state].errors.expected() - states_[state + 1].errors.expected();
  }

  // ---- what there is ----

  void addPlace(std::uint32_t s, const ProxyPlace& input) {
    const SurfaceSample& sample = samples_[s];
    const glm::vec3 to_eye = query_.points.eye - sample.position;
    const float eye_distance = std::max(glm::length(to_eye), 1e-20F);
    const float density = query_.points.pixels_per_unit_at_one / eye_distance;
    Place& place = places_[s];
    place.detail2 = input.detail * input.detail + query_.lacking2;
    place.first_state = static_cast<std::uint32_t>(states_.size());
    place.states = static_cast<std::uint32_t>(1 + input.refined.size());
    float color = 1.0F, shape = std::numeric_limits<float>::max();
    const auto add = [&](const ProxyShading& shading, bool is_needed) {
      // Errors are estimates, and those of a finer proxy may be larger. It is no worse.
      color = std::min(color, shading.color_error);
      shape = std::min(shape, shading.shape_error);
      Shading reached = shadingAt({color, shape}, density);
      reached.proxy2 += query_.lacking2;
      // Images err by a share of the proxy's error since they lie on it beside their place. Where its shape serves,
      // finer colours beneath an image change nothing of that.
      if (!is_needed) reached.color2 = states_.back().shading.color2;
      states_.push_back({reached, BestTwo(reached.proxy2)});
    };
    add(input.now, true);
    for (std::uint32_t at = 0; at < input.refined.size(); ++at) {
      const std::size_t group = input.refined[at].group;
      groups_[group].steps.push_back({s, at});
      states_.back().next_group = static_cast<std::uint32_t>(group);
      add(input.refined[at].shading, input_[group].is_needed);
    }
    for (std::uint32_t state = place.first_state; state + 1 < states_.size(); ++state)
      groups_[states_[state].next_group].gain += static_cast<double>(sample.weight * gainOfNext(state));
  }

  /// A line from a sample to a point whose images show it, if nothing is in the way.
  struct Line {
    std::uint32_t sample = 0;
    std::uint32_t direction = 0;  // of the face that it meets
    std::uint32_t last = 0;       // depth of the finest tile that is of use and stored
    std::array<std::uint32_t, repository::kMaxTileDepth + 1> path{};  // tiles that it meets, by depth
    float distance = 0.0F;                                            // scene units
    float density = 0.0F;                                             // view pixels a unit
    float slant = 0.0F;                                               // cosine
    Look best;                                                        // of the finest
  };

  /// Nothing where no image of the point is of use for the sample.
  std::optional<Line> lineTo(std::uint32_t number, const glm::uvec3& point, const glm::vec3& position,
                             std::uint32_t s) {
    const SurfaceSample& sample = samples_[s];
    const glm::vec3 to_eye = query_.points.eye - sample.position;
    const glm::vec3 to_point = position - sample.position;
    const float eye_distance = glm::length(to_eye);
    const float distance = glm::length(to_point);
    if (!(eye_distance > 0.0F) || !(distance > 0.0F)) return std::nullopt;
    float slant = 1.0F;
    if (glm::dot(sample.normal, sample.normal) > 0.0F) {
      // A surface that turns away from the point is not seen by it. Scans are open, so either side may be looked at.
      const float towards_eye = glm::dot(sample.normal, to_eye) / eye_distance;
      const float towards_point = glm::dot(sample.normal, to_point) / distance;
      slant = towards_eye < 0.0F ? -towards_point : towards_point;
      if (slant <= 0.0F) return std::nullopt;
    }

    const repository::Grid& grid = query_.points.grid;
    Line line;
    line.sample = s;
    line.distance = distance;
    line.density = query_.points.pixels_per_unit_at_one / eye_distance;
    line.slant = slant;
    std::uint32_t deepest = 0;
    while (deepest < grid.tile_depth && sharpnessOf(line, deepest) < 1.0F) ++deepest;
    const float shift = kShift * line.density * glm::length(to_eye / eye_distance - to_point / distance);
    line.best = lookAt(line, deepest, number, shift);
    // The finest image has the smallest error.
    if (!isOfUse(line.best, places_[s])) return std::nullopt;

    // An absent tile leaves what it would have shown to the one above it.
    const repository::FaceKey tile = repository::tileOfDirection(-to_point, deepest);
    line.direction = tile.d;
    line.path[deepest] = tile.tile;
    for (std::uint32_t depth = deepest; depth > 0; --depth)
      line.path[depth - 1] = repository::parentOfTile(line.path[depth]);
    if (entryOf(imageOf(point, line, 0)).bytes == 0) return std::nullopt;
    while (line.last < deepest && entryOf(imageOf(point, line, line.last + 1)).bytes != 0) ++line.last;
    return line;
  }

  /// Texels of the tiles of this depth that a view pixel holds along the surface.
  float sharpnessOf(const Line& line, std::uint32_t depth) const {
    return 0.5F * static_cast<float>(query_.points.grid.faceSideAt(depth)) / line.distance / line.density * line.slant;
  }
  Look lookAt(const Line& line, std::uint32_t depth, std::uint32_t point, float shift) const {
    const float texel = 1.0F / std::clamp(sharpnessOf(line, depth), 0.01F, 1.0F);
    const float lost = texel > 1.0F ? kTexelShare * std::pow(texel * texel - 1.0F, kTexelPower) : 0.0F;
    return {point, lost * places_[line.sample].detail2, shift};
  }
  bool isOfUse(const Look& look, const Place& place) const {
    const Shading& coarsest = states_[place.first_state].shading;
    const Shading& finest = states_[place.first_state + place.states - 1].shading;
    return look.error2(coarsest) < coarsest.proxy2 || look.error2(finest) < finest.proxy2;
  }
  /// An image of the point that is added.
  struct PointImage {
    repository::FaceKey key;
    std::uint64_t code = 0;
  };
  PointImage imageOf(const glm::uvec3& point, const Line& line, std::uint32_t depth) const {
    return {{point.x, point.y, point.z, line.direction, line.path[depth]},
            point_code_ | std::uint64_t{line.direction} << repository::kTileBits | line.path[depth]};
  }

  /// The images of a point that show a sample, from the whole face down to the finest that is of use.
  void addLooks(const glm::uvec3& point, const Line& line) {
    for (std::uint32_t depth = 0; depth < line.last; ++depth) {
      const Look look = lookAt(line, depth, line.best.point, line.best.shift);
      if (isOfUse(look, places_[line.sample])) addLook(imageOf(point, line, depth), line.sample, look);
    }
    addLook(imageOf(point, line, line.last), line.sample, line.best);
  }

  ImageTable::Entry& entryOf(const PointImage& image) {
    const auto [entry, is_new] = table_.find(image.code);
    if (is_new) {
      entry->bytes = query_.image_bytes;
      if (query_.stored_bytes) entry->bytes = query_.stored_bytes(image.key).value_or(query_.image_bytes);
    }
    return *entry;
  }

  void addLook(const PointImage& image, std::uint32_t s, const Look& look) {
    ImageTable::Entry& entry = entryOf(image);
    if (entry.number == ImageTable::kNone) {
      entry.number = static_cast<std::uint32_t>(images_.size());
      images_.push_back({image.key, entry.bytes});
    }
    ++images_[entry.number].places;
    ++places_[s].end_shown;  // a count until arrangeLooks()
    shown_.push_back({s, entry.number, look});
  }

  /// Sorts what was added by sample, and lists it by image; within each the order stays.
  void arrangeLooks() {
    std::uint32_t sum = 0;
    for (Place& place : places_) {
      place.first_shown = sum;
      sum += std::exchange(place.end_shown, sum);
    }
    std::vector<Shown> sorted(shown_.size());
    for (const Shown& shown : shown_) sorted[places_[shown.sample].end_shown++] = shown;
    shown_.swap(sorted);
    sum = 0;
    for (Image& image : images_) {
      image.first_place = sum;
      sum += std::exchange(image.places, 0);
    }
    image_places_.resize(shown_.size());
    rates_.reset(images_.size());
    for (std::uint32_t i = 0; i < shown_.size(); ++i) {
      Image& image = images_[shown_[i].image];
      image_places_[image.first_place + image.places++] = i;
    }
  }

  // ---- what it gains ----

  // Gains are kept, and changed by what an item changes at its places: all of them are looked at for each next one.

  /// The images of a place gain more or less by now.
  void renewImagesAt(std::uint32_t s) {
    const Place& place = places_[s];
    const State& state = stateOf(place);
    const float expected = state.errors.expected();
    for (std::uint32_t i = place.first_shown; i < place.end_shown; ++i) {
      Shown& shown = shown_[i];
      Image& image = images_[shown.image];
      if (image.has_come) continue;
      BestTwo with = state.errors;
      with.add(shown.look.point, shown.look.error2(state.shading));
      const float gain = expected - with.expected();
      if (gain == shown.gain) continue;
      image.gain += static_cast<double>(samples_[s].weight) * static_cast<double>(gain - shown.gain);
      rates_.set(shown.image, image.gain / static_cast<double>(image.bytes));
      shown.gain = gain;
    }
  }

  /// The image that gains most for its bytes, of equals the first, if any gains enough.
  std::optional<std::uint32_t> findBestImage() {
    const std::optional<std::uint32_t> best = rates_.findBest();
    return best && rates_[*best] >= kLeastImageRate * foreground_ ? best : std::nullopt;
  }

  /// Finds the group that may come next with the best prospect: best_group_. One that gains nothing itself may be
  /// worth its bytes for those after it. `needed`: of those that are needed.
  std::optional<Prospect> findBestGroup(bool needed) {
    std::optional<Prospect> best;
    std::erase_if(left_, [this](std::size_t g) { return groups_[g].has_come; });
    for (const std::size_t g : left_) {
      const Group& group = groups_[g];
      if (group.is_stale) renewProspect(g);
      if (needed && !input_[g].is_needed) continue;
      if (group.parents_left == 0 && (!best || !best->isBetterThan(prospects_[g])))
        best = prospects_[g], best_group_ = g;
    }
    return best;
  }

  void renewProspect(std::size_t g) {
    groups_[g].is_stale = false;
    const Prospect alone{std::max(0.0, groups_[g].gain) + static_cast<double>(groups_[g].later),
                         static_cast<double>(input_[g].bytes)};
    prospects_[g] = alone;
    for (const std::size_t child : groups_[g].children) {
      const Prospect both{alone.gain + prospects_[child].gain, alone.bytes + prospects_[child].bytes};
      if (both.isBetterThan(prospects_[g])) prospects_[g] = both;
    }
    for (const std::size_t parent : input_[g].parents) groups_[parent].is_stale = true;
  }

  void takeImage(std::uint32_t number) {
    Image& image = images_[number];
    image.has_come = true;
    rates_.set(number, -1.0);
    for (std::uint32_t at = image.first_place; at < image.first_place + image.places; ++at) {
      const Shown& shown = shown_[image_places_[at]];
      const Place& place = places_[shown.sample];
      const double weight = static_cast<double>(samples_[shown.sample].weight);
      const std::uint32_t first = place.first_state + place.state;
      const std::uint32_t last = place.first_state + place.states - 1;
      for (std::uint32_t i = first; i < last; ++i)
        groups_[states_[i].next_group].gain -= weight * static_cast<double>(gainOfNext(i));
      const BestTwo before = states_[first].errors;
      for (std::uint32_t i = first; i <= last; ++i)
        states_[i].errors.add(shown.look.point, shown.look.error2(states_[i].shading));
      for (std::uint32_t i = first; i < last; ++i) {
        Group& group = groups_[states_[i].next_group];
        group.gain += weight * static_cast<double>(gainOfNext(i));
        group.is_stale = true;
      }
      if (states_[first].errors != before) renewImagesAt(shown.sample);
    }
  }

  void takeGroup(Group& group) {
    group.has_come = true;
    for (const std::size_t child : group.children) --groups_[child].parents_left;
    for (const Step& step : group.steps) {
      places_[step.sample].state = step.state + 1;
      renewImagesAt(step.sample);
    }
  }

  const GainQuery& query_;
  std::span<const SurfaceSample> samples_;
  std::span<const OrderedGroup> input_;
  std::vector<Place> places_;                // beside samples_
  std::vector<State> states_;                // of all places, those of a place side by side
  std::vector<Shown> shown_;                 // by place, once arranged
  std::vector<std::uint32_t> image_places_;  // indices into shown_, by image
  std::vector<Group> groups_;
  std::vector<Image> images_;
  Rates rates_;  // beside images_; −1 once one has come
  ImageTable table_;
  std::vector<std::size_t> left_;  // groups that have not come, children before parents
  std::vector<Prospect> prospects_;
  std::size_t best_group_ = 0;
  std::uint64_t point_code_ = 0;  // of the point that is added
  double foreground_ = 1.0;       // share of the picture that shows the model, as far as it counts
  std::size_t images_left_ = 0;
};

}  // namespace

OrderByGain orderByGain(const GainQuery& query, std::span<const glm::uvec3> points,
                        std::span<const SurfaceSample> samples, std::span<const ProxyPlace> places,
                        std::span<const OrderedGroup> groups) {
  LUMIGRID_CHECK_EQ(samples.size(), places.size());
  GainOrder order(query, samples, places, groups);
  for (std::size_t i = 0; i < points.size(); ++i) order.addPoint(static_cast<std::uint32_t>(i), points[i]);
  return order.order();
}

}  // namespace plan
