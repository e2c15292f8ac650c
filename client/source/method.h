#pragma once
// The ways in which a viewer can show a scene, as the command line, links and settings spell them.
#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <utility>

namespace client {

enum class Method : std::uint8_t {
  kLumigraph,  ///< patches textured by the repository's images
  kPatches,    ///< patches alone, with the colours of their vertices
  kQsplat,     ///< splats streamed from qsplat.lgq (Rusinkiewicz and Levoy 2001)
  kPmr,        ///< points and umbrella triangles streamed from pmr.lgm (Dey and Hudson 2002)
};

inline constexpr std::array<std::pair<Method, std::string_view>, 4> kMethodNames{{
    {Method::kLumigraph, "lumigraph"},
    {Method::kPatches, "patches"},
    {Method::kQsplat, "qsplat"},
    {Method::kPmr, "pmr"},
}};

inline constexpr std::string_view nameOf(Method method) {
  return kMethodNames[static_cast<std::size_t>(method)].second;
}

inline std::optional<Method> methodFromName(std::string_view name) {
  for (const auto& [method, text] : kMethodNames)
    if (text == name) return method;
  return std::nullopt;
}

/// The file of a method that streams one of its own.
struct MethodFile {
  Method method;
  std::string_view stem, extension;  ///< "qsplat", ".lgq": its name in a scene that is not published
  std::string_view content;          ///< for people
};
inline constexpr std::array<MethodFile, 2> kMethodFiles{{
    {Method::kQsplat, "qsplat", ".lgq", "splats"},
    {Method::kPmr, "pmr", ".lgm", "points and umbrellas"},
}};
/// Null for methods that stream no file of their own.
inline constexpr const MethodFile* fileOf(Method method) {
  for (const MethodFile& file : kMethodFiles)
    if (file.method == method) return &file;
  return nullptr;
}
inline constexpr bool isStreamed(Method method) {
  return fileOf(method) != nullptr;
}

}  // namespace client
