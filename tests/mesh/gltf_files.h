#pragma once
// Small glTF files, made by hand.
#include <nlohmann/json.hpp>
#include <string>

#include "tests/mesh/mesh_files.h"

namespace mesh_files {

using nlohmann::json;

/// A GLB of a document and its BIN chunk.
inline std::string glb(const json& document, std::string binary) {
  std::string text = document.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  binary.resize((binary.size() + 3) / 4 * 4, '\0');
  std::string b = "glTF";
  put(b, std::uint32_t{2});
  put(b, static_cast<std::uint32_t>(12 + 8 + text.size() + 8 + binary.size()));
  put(b, static_cast<std::uint32_t>(text.size()));
  b += "JSON" + text;
  put(b, static_cast<std::uint32_t>(binary.size()));
  return b + std::string("BIN\0", 4) + binary;
}

/// The square has positions with a stride of 16, 16-bit indices and byte colours.
inline json squareDocument(std::string& binary) {
  const float xy[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  for (const auto& p : xy)
    for (const float x : {p[0], p[1], 0.0F, 99.0F}) put(binary, x);
  for (const int i : {0, 1, 2, 0, 2, 3}) put(binary, static_cast<std::uint16_t>(i));
  for (int v = 0; v < 4; ++v)
    for (const int c : {255, 0, 55, 255}) put(binary, static_cast<std::uint8_t>(c));
  return json{{"asset", {{"version", "2.0"}}},
              {"buffers", {{{"byteLength", binary.size()}}}},
              {"bufferViews",
               {{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", 64}, {"byteStride", 16}},
                {{"buffer", 0}, {"byteOffset", 64}, {"byteLength", 12}},
                {{"buffer", 0}, {"byteOffset", 76}, {"byteLength", 16}}}},
              {"accessors",
               {{{"bufferView", 0}, {"componentType", 5126}, {"count", 4}, {"type", "VEC3"}},
                {{"bufferView", 1}, {"componentType", 5123}, {"count", 6}, {"type", "SCALAR"}},
                {{"bufferView", 2}, {"componentType", 5121}, {"count", 4}, {"type", "VEC4"}, {"normalized", true}}}},
              {"meshes", {{{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}}}}}}},
              {"nodes", {{{"mesh", 0}}}},
              {"scenes", {{{"nodes", {0}}}}},
              {"scene", 0}};
}

inline std::string base64(const std::string& bytes) {
  constexpr const char* kAlphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t bits = 0;
    for (std::size_t k = 0; k < 3; ++k)
      bits = bits << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k) text += i + k <= bytes.size() ? kAlphabet[bits >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

}  // namespace mesh_files
