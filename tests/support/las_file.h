#pragma once
// LAS files written field by field, as the specification (ASPRS, LAS 1.4 - R15) lays them out.
#include <array>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

namespace support {

/// The least bytes of a point of each format, and where its colour lies (0: it has none).
inline constexpr std::array<std::size_t, 11> kLasBytes{20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
inline constexpr std::array<std::size_t, 11> kLasColor{0, 0, 20, 28, 0, 28, 0, 30, 30, 0, 30};

struct LasPoint {
  std::array<std::int32_t, 3> number{};
  std::array<std::uint16_t, 3> color{};
  std::uint16_t intensity = 0;
  int classification = 2;
  bool is_withheld = false;
};

/// A file with all that a test may want otherwise.
struct LasFile {
  int minor = 4;
  int format = 7;
  std::array<double, 3> scale{0.001, 0.001, 0.001};
  std::array<double, 3> offset{0.0, 0.0, 0.0};
  std::vector<LasPoint> points;
  std::vector<std::pair<std::uint16_t, std::string>> records;           // of LASF_Projection
  std::vector<std::pair<std::uint16_t, std::string>> extended_records;  // the same, behind the points
  std::size_t padding = 0;                                              // bytes of each point that nobody knows

  std::size_t headerBytes() const { return minor < 3 ? 227 : minor == 3 ? 235 : 375; }
  std::size_t record() const { return kLasBytes[static_cast<std::size_t>(format)] + padding; }
};

/// Overwrites bytes of a file in memory.
template <class T>
void patch(std::string& bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof(value));
}

inline std::string recordOf(std::uint16_t number, const std::string& content, bool extended) {
  std::string bytes(2, '\0');
  bytes += "LASF_Projection";
  bytes += '\0';
  const std::uint64_t length = content.size();
  bytes.append(reinterpret_cast<const char*>(&number), sizeof(number));
  bytes.append(reinterpret_cast<const char*>(&length), extended ? 8 : 2);
  return bytes + std::string(32, '\0') + content;
}

inline std::string pointOf(const LasFile& file, const LasPoint& point) {
  std::string bytes(file.record(), '\0');
  patch(bytes, 0, point.number);
  patch(bytes, 12, point.intensity);
  const bool is_extended = file.format >= 6;
  bytes[14] = is_extended ? '\x11' : '\x09';
  if (is_extended) {
    bytes[15] = point.is_withheld ? '\x04' : '\0';
    bytes[16] = static_cast<char>(point.classification);
  } else {
    bytes[15] = static_cast<char>(point.classification | (point.is_withheld ? 0x80 : 0));
  }
  if (const std::size_t at = kLasColor[static_cast<std::size_t>(file.format)]; at != 0) patch(bytes, at, point.color);
  return bytes;
}

inline std::string bytesOf(const LasFile& file) {
  std::string bytes(file.headerBytes(), '\0');
  bytes.replace(0, 4, "LASF");
  bytes[24] = 1, bytes[25] = static_cast<char>(file.minor);
  patch(bytes, 94, static_cast<std::uint16_t>(bytes.size()));
  patch(bytes, 100, static_cast<std::uint32_t>(file.records.size()));
  bytes[104] = static_cast<char>(file.format);
  patch(bytes, 105, static_cast<std::uint16_t>(file.record()));
  const auto count = static_cast<std::uint32_t>(file.points.size());
  if (file.format < 6) patch(bytes, 107, count);
  patch(bytes, 131, file.scale);
  patch(bytes, 155, file.offset);
  if (file.minor == 4) patch(bytes, 247, std::uint64_t{count});
  for (const auto& [number, content] : file.records) bytes += recordOf(number, content, false);
  patch(bytes, 96, static_cast<std::uint32_t>(bytes.size()));
  for (const LasPoint& point : file.points) bytes += pointOf(file, point);
  if (file.minor == 4 && !file.extended_records.empty()) {
    patch(bytes, 235, std::uint64_t{bytes.size()});
    patch(bytes, 243, static_cast<std::uint32_t>(file.extended_records.size()));
    for (const auto& [number, content] : file.extended_records) bytes += recordOf(number, content, true);
  }
  return bytes;
}

}  // namespace support
