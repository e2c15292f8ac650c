#pragma once
// The names of the methods, as programs and files spell them (DESIGN section 1).
#include <array>
#include <optional>
#include <string_view>

#include <utility>

namespace lod {

enum class Method { kLumigraph, kPatches, kQsplat, kFull };

inline constexpr std::array<std::pair<Method, std::string_view>, 4> kMethodNames{{{Method::kLumigraph, "lumigraph"},
                                                                                  {Method::kPatches, "patches"},
                                                                                  {Method::kQsplat, "qsplat"},
                                                                                  {Method::kFull, "full"}}};

inline std::optional<Method> methodFromName(std::string_view name) {
  for (const auto& [method, text] : kMethodNames)
    if (text == name) return method;
  return std::nullopt;
}

}  // namespace lod
