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
  // Each of the following streams a file of its own.
  kQsplat,  ///< splats streamed from qsplat.lgq (Rusinkiewicz and Levoy 2001)
  kPmr,     ///< points and umbrella triangles streamed from pmr.lgm (Dey and Hudson 2002)
  kHlod,    ///< triangles and points streamed from hlod.lgh (Guthe et al. 2004)
};

inline constexpr std::array<std::pair<Method, std::string_view>, 5> kMethodNames{{
    {Method::kLumigraph, "lumigraph"},
    {Method::kPatches, "patches"},
    {Method::kQsplat, "qsplat"},
    {Method::kPmr, "pmr"},
    {Method::kHlod, "hlod"},
}};

inline constexpr std::string_view nameOf(Method method) {
  return kMethodNames[static_cast<std::size_t>(method)].second;
}

inline std::optional<Method> methodFromName(std::string_view name) {
  for (const auto& [method, text] : kMethodNames)
    if (text == name) return method;
  return std::nullopt;
}

/// Whether the method streams a file of its own.
inline constexpr bool isStreamed(Method method) {
  return method >= Method::kQsplat;
}
/// Names for people what such a method draws.
inline constexpr std::string_view contentOf(Method method) {
  return method == Method::kHlod ? "triangles and points" : method == Method::kPmr ? "points and umbrellas" : "splats";
}

}  // namespace client
