#pragma once
// Measures distances along a chain of points and angles of three points, in the scene's units. A point first lies on
// the coarse surface on the screen, and is replaced when the full-resolution one has been found.
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "client/source/pick_answer.h"

namespace client {

enum class MeasureKind : std::uint8_t { kDistance, kAngle };

struct MeasuredPoint {
  glm::dvec3 position{0.0};   ///< world
  glm::dvec3 normal{0.0};     ///< unit, world; zero when not known
  double accuracy = 0.0;      ///< world units: largest distance of the point from the scanned surface
  bool approximate = true;    ///< taken from the coarse surface, with the picture's accuracy
  std::uint32_t pick_id = 0;  ///< the pick that will replace it; 0: none
};

/// A length or angle, and where to write it.
struct MeasuredValue {
  glm::dvec3 at{0.0};     ///< world
  double value = 0.0;     ///< world units, or radians
  double accuracy = 0.0;  ///< bound of the value's error, same unit
  bool approximate = false;
  bool total = false;  ///< the length of the whole chain so far
  std::string text;    ///< "12.34 m ± 0.02 m"
};

struct Measurement {
  MeasureKind kind = MeasureKind::kDistance;
  std::vector<MeasuredPoint> points;
  bool finished = false;  ///< takes no more points
};

/// Returns the values of one measurement: each segment, and the total from two segments on; or the angle at the second
/// of three points. Accuracies add up, since they are bounds and not deviations.
std::vector<MeasuredValue> measuredValues(const Measurement& measurement, const std::string& unit);

/// Formats `value` ± `accuracy`, both down to the first digit of the accuracy and at most 9 digits: "12.34 m ± 0.02 m",
/// or "about 12.3 m" when approximate. An accuracy of 0 means unknown and gives 6 digits. `unit` is as in scene.json;
/// empty or "unknown" is written "units".
std::string formatLength(double value, double accuracy, bool approximate, const std::string& unit);
std::string formatAngle(double radians, double accuracy, bool approximate);  ///< from radians, in degrees

inline constexpr std::size_t kMaxMeasuredPoints = 500;  ///< in all measurements together; a choice

/// The measurements on the screen and their points on the way.
class MeasureTool {
 public:
  /// The next point begins a new measurement of this kind.
  void start(MeasureKind kind);
  /// Adds a point to the running measurement, or begins a new one. Returns false without a change when the point equals
  /// the last one, or there are too many. The third point finishes an angle.
  bool add(const MeasuredPoint& point);
  bool full() const;
  void finish();
  void removeLast();  ///< the newest point, of a finished measurement too
  void clear() { all_.clear(); }
  /// Replaces the point that waits for this pick by a hit; any other answer leaves the approximate point. Ids that no
  /// point waits for are ignored. Returns true when something changed.
  bool answer(std::uint32_t pick_id, const PickAnswer& answer);
  const std::vector<Measurement>& all() const { return all_; }

 private:
  std::vector<Measurement> all_;
  MeasureKind kind_ = MeasureKind::kDistance;
};

}  // namespace client
