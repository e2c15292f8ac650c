#pragma once
// Distances along a chain of points and angles of three, in the scene's units. A point first comes from the coarse
// surface on the screen and is replaced when the full-resolution one has been found.
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
  double accuracy = 0.0;      ///< world units: how far the point may lie from the scanned surface
  bool approximate = true;    ///< from the coarse surface: its accuracy is that of the picture
  std::uint32_t pick_id = 0;  ///< the request that is to replace it; 0 when none is open
};

/// A length or angle and where to write it.
struct MeasuredValue {
  glm::dvec3 at{0.0};     ///< world
  double value = 0.0;     ///< world units, or radians
  double accuracy = 0.0;  ///< the value may be off by this much, same unit
  bool approximate = false;
  bool total = false;  ///< the length of the whole chain so far
  std::string text;    ///< "12.34 m ± 0.02 m"
};

struct Measurement {
  MeasureKind kind = MeasureKind::kDistance;
  std::vector<MeasuredPoint> points;
  bool finished = false;  ///< takes no more points
};

/// The values of one measurement: each segment, and the total from two segments on; or the angle at the second of three
/// points. Accuracies add up (they are bounds, not deviations).
std::vector<MeasuredValue> measuredValues(const Measurement& measurement, const std::string& unit);

/// `value` ± `accuracy`, both down to the first digit of the accuracy, at most 9 digits: "12.34 m ± 0.02 m",
/// "about 12.3 m" when approximate. An accuracy of 0 is not known: 6 digits. `unit`: as scene.json has it; empty or
/// "unknown": "units".
std::string formatLength(double value, double accuracy, bool approximate, const std::string& unit);
std::string formatAngle(double radians, double accuracy, bool approximate);  ///< degrees

inline constexpr std::size_t kMaxMeasuredPoints = 500;  ///< of all measurements together

/// The measurements on the screen and their points on the way.
class MeasureTool {
 public:
  /// The next point begins a new measurement of this kind.
  void start(MeasureKind kind);
  /// A point of the running measurement, or the first of a new one. False, and nothing changes: it is where the last
  /// one is, or there are too many. An angle is finished by its third point.
  bool add(const MeasuredPoint& point);
  bool full() const;
  void finish();
  void removeLast();  ///< the newest point, wherever it is
  void clear();
  /// A hit replaces the point that asked for it; anything else leaves the approximate one. An id that nobody waits for
  /// is passed over. True when something changed.
  bool answer(std::uint32_t pick_id, const PickAnswer& answer);
  const std::vector<Measurement>& all() const { return all_; }

 private:
  std::vector<Measurement> all_;
  MeasureKind kind_ = MeasureKind::kDistance;
};

}  // namespace client
