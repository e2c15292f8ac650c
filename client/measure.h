#pragma once
// Distances along a chain of points and angles of three, in the scene's units. A point first comes from the coarse
// surface on the screen and is replaced when the full-resolution one has been found.
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

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
  std::string text;    ///< "12.34 m ± 2 mm"
};

struct Measurement {
  MeasureKind kind = MeasureKind::kDistance;
  std::vector<MeasuredPoint> points;
  bool finished = false;  ///< takes no more points
};

/// The values of one measurement: each segment, and the total from two segments on; or the angle at the second of three
/// points. Accuracies add up (they are bounds, not deviations).
std::vector<MeasuredValue> measuredValues(const Measurement& measurement, const std::string& unit);

/// `value` ± `accuracy` with as many digits as the accuracy leaves, at most 6 significant: "12.34 m ± 0.01 m",
/// "about 12.3 m" when approximate. `unit`: as scene.json has it; empty or "unknown": "units".
std::string formatLength(double value, double accuracy, bool approximate, const std::string& unit);
std::string formatAngle(double radians, double accuracy, bool approximate);  ///< degrees

}  // namespace client
