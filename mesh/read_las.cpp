// LAS point clouds: positions, colours or else intensities; deleted points and noise stay out.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "mesh/greys.h"
#include "mesh/las_header.h"
#include "mesh/readers.h"

namespace mesh {
namespace {

constexpr std::size_t kIntensity = 12;  // its offset in a point

/// Tells how a point gets its colour.
enum class Coloring {
  kNone,
  kIntensity,  ///< grey
  kBytes,      ///< colours of 8 bits in fields of 16, which the specification forbids and many programs write
  kWords,      ///< colours of 16 bits
};

struct LeftOut {
  std::uint64_t withheld = 0;
  std::uint64_t noise = 0;
};

class Points {
 public:
  Points(base::ByteView bytes, const LasHeader& header) : first_(bytes.data() + header.first_point), header_(header) {}

  const std::uint8_t* at(std::uint64_t point) const { return first_ + point * header_.record; }
  std::uint64_t count() const { return header_.points; }
  bool hasColors() const { return header_.format.color != 0; }

  glm::dvec3 position(const std::uint8_t* point) const {
    glm::ivec3 number;
    std::memcpy(&number, point, sizeof(number));
    return header_.scale * glm::dvec3(number) + header_.offset;
  }
  glm::u16vec3 color(const std::uint8_t* point) const {
    glm::u16vec3 color;
    std::memcpy(&color, point + header_.format.color, sizeof(color));
    return color;
  }
  static std::uint16_t intensity(const std::uint8_t* point) {
    std::uint16_t intensity = 0;
    std::memcpy(&intensity, point + kIntensity, sizeof(intensity));
    return intensity;
  }
  bool isWithheld(const std::uint8_t* point) const {
    return (point[header_.format.flags] & header_.format.withheld) != 0;
  }
  /// Low noise (7) or high noise (18), as the specification's table of classes has them.
  bool isNoise(const std::uint8_t* point) const {
    const int name = point[header_.format.classification] & header_.format.class_mask;
    return name == 7 || name == 18;
  }

 private:
  const std::uint8_t* first_;
  const LasHeader& header_;
};

// The least that a colour asks for. Files without colours may have black ones, and more than 255 takes 16 bits.
Coloring coloringOf(const glm::u16vec3& color) {
  const std::uint16_t largest = std::max({color.r, color.g, color.b});
  return largest == 0 ? Coloring::kNone : largest <= 255 ? Coloring::kBytes : Coloring::kWords;
}

/// Reads points one way. It stops where a colour shows that the way is wrong.
class PointReader {
 public:
  PointReader(const Points& points, MeshStream& out) : points_(points), out_(out) { lookAtSample(); }

  base::Result<void> read();
  Coloring coloring() const { return coloring_; }
  const GreyRange& greys() const { return greys_; }
  const LeftOut& leftOut() const { return left_out_; }

 private:
  void lookAtSample();
  base::Result<bool> readAll();
  bool readPoint(const std::uint8_t* point);

  const Points& points_;
  MeshStream& out_;
  Coloring coloring_ = Coloring::kNone;
  GreyRange greys_;
  LeftOut left_out_;
};

// Chooses colours by a sample: 64 runs of 1024 points, evenly over the file, are read in a blink from any disk.
void PointReader::lookAtSample() {
  constexpr std::uint64_t kRuns = 64, kRun = 1024;
  std::vector<double> intensities;
  const std::uint64_t step = std::max(points_.count() / kRuns, kRun);
  for (std::uint64_t first = 0; first < points_.count(); first += step)
    for (std::uint64_t i = first; i < std::min(first + kRun, points_.count()); ++i) {
      const std::uint8_t* point = points_.at(i);
      if (points_.isWithheld(point) || points_.isNoise(point)) continue;
      if (points_.hasColors()) coloring_ = std::max(coloring_, coloringOf(points_.color(point)));
      intensities.push_back(Points::intensity(point));
    }
  if (coloring_ != Coloring::kNone) return;
  greys_ = GreyRange::of(intensities);
  if (!greys_.isEmpty()) coloring_ = Coloring::kIntensity;
}

// False where the point's colour needs another way; then that is set.
bool PointReader::readPoint(const std::uint8_t* point) {
  if (points_.isWithheld(point)) {
    ++left_out_.withheld;
    return true;
  }
  if (points_.isNoise(point)) {
    ++left_out_.noise;
    return true;
  }
  out_.positions.push_back(points_.position(point));
  if (points_.hasColors() && coloring_ != Coloring::kWords) {
    if (const Coloring needed = coloringOf(points_.color(point)); needed > coloring_) {
      coloring_ = needed;
      return false;
    }
  }
  if (coloring_ == Coloring::kIntensity) out_.colors.push_back(greys_.grey(Points::intensity(point)));
  if (coloring_ == Coloring::kBytes) out_.colors.emplace_back(glm::u8vec3(points_.color(point)), 255);
  if (coloring_ == Coloring::kWords) {
    const glm::u16vec3 color = points_.color(point);
    out_.colors.emplace_back(glm::u8vec3(color.r >> 8, color.g >> 8, color.b >> 8), 255);
  }
  return true;
}

// False where the points must be read another way.
base::Result<bool> PointReader::readAll() {
  left_out_ = {};
  for (std::uint64_t i = 0; i < points_.count(); ++i) {
    if (!readPoint(points_.at(i))) return false;
    // Also where most points are left out, pages are released and progress is told.
    if ((i + 1) % MeshStream::kBlock == 0) LUMIGRID_TRY(out_.flush(points_.at(i + 1)));
  }
  LUMIGRID_TRY(out_.flush(points_.at(points_.count())));
  return true;
}

base::Result<void> PointReader::read() {
  // Each restart is for colours of more bits, so that there are two at most.
  while (true) {
    LUMIGRID_ASSIGN_OR_RETURN(const bool done, readAll());
    if (done) return {};
    LUMIGRID_TRY(out_.restart());
  }
}

// ---- Lines about the file ----

void describeLeftOut(const LeftOut& left_out, std::vector<std::string>& warnings) {
  std::string line;
  if (left_out.withheld > 0) line = std::to_string(left_out.withheld) + " that are marked as withheld";
  if (left_out.noise > 0)
    line += (line.empty() ? "" : " and ") + std::to_string(left_out.noise) + " of noise (classes 7 and 18)";
  if (!line.empty()) warnings.push_back("its points are read without " + line);
}

// Says what a person has to know of the coordinates beyond what the scene keeps.
void describeCrs(const CrsDescription& crs, std::vector<std::string>& warnings) {
  if (crs.code.empty() && !crs.name.empty())
    warnings.push_back("its coordinate reference system is " + inQuotes(crs.name) +
                       " without a code; name it in the scene: lumigrid set SCENE --crs EPSG:CODE");
  if (crs.has_degrees)
    warnings.push_back(
        "its x and y are degrees beside heights in a unit of length, so that the model is far out of shape; project it "
        "first: pdal translate in.las out.las reprojection --filters.reprojection.out_srs=EPSG:CODE");
  if (crs.unit == "ft" || crs.unit == "us-ft")
    warnings.push_back(std::string("its coordinates are in ") +
                       (crs.unit == "ft" ? "feet of 0.3048 m" : "US survey feet") + ", and so is the scene");
}

void describeGreys(const GreyRange& greys, std::vector<std::string>& warnings) {
  warnings.push_back("it has no colours; intensities from " + std::to_string(std::lround(greys.black)) + " to " +
                     std::to_string(std::lround(greys.white)) + " are shown from black to white");
}

}  // namespace

base::Result<void> readLas(base::ByteView bytes, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, readLasHeader(bytes));
  if (!out.accepts_points) return unsupported(kOnlyPoints);
  const Points points(bytes, header);
  PointReader reader(points, out);
  LUMIGRID_TRY(reader.read());

  StreamedFile& summary = out.summary;
  const LeftOut& left_out = reader.leftOut();
  if (summary.vertices == 0)
    return invalidInput("all of its " + std::to_string(points.count()) + " points are marked as withheld or as noise");
  summary.georeference = {header.crs.code, header.crs.unit, Georeference::Up::kZ};
  if (!header.warning.empty()) summary.warnings.push_back(header.warning);
  describeLeftOut(left_out, summary.warnings);
  describeCrs(header.crs, summary.warnings);
  if (reader.coloring() == Coloring::kIntensity) describeGreys(reader.greys(), summary.warnings);
  return {};
}

}  // namespace mesh
