#pragma once
// The base colour of a primitive: a factor, or a picture with the place of each corner in it.
#include <glm/glm.hpp>
#include <map>
#include <optional>
#include <span>
#include <string>

#include "mesh/gltf/document.h"
#include "mesh/gltf/reader.h"
#include "mesh/mesh_stream.h"

namespace mesh::gltf {

struct BaseColor {
  glm::dvec4 factor{1.0};                ///< linear
  std::optional<std::uint64_t> texture;  ///< of the document, for Materials::pictureOf()
  bool opaque = true;                    ///< the picture's alpha says nothing
  std::string coordinates;               ///< the attribute that holds places in it, "TEXCOORD_0"
  glm::dmat2 picture_from_vertex{1.0};   ///< turns and scales them (KHR_texture_transform)
  glm::dvec2 offset{0.0};                ///< is added after that
};

/// Finds the base colours of a document's materials, and notes textures that are not read.
class Materials {
 public:
  Materials(Document& document, Omissions& omissions, MeshStream& out)
      : document_(document), omissions_(omissions), out_(out) {}
  BaseColor of(const json& primitive);
  /// The number in MeshStream::textures of the texture of `base`, which has one; a triangle shows it first.
  std::uint32_t pictureOf(const BaseColor& base, std::span<const glm::dvec2> uv);

 private:
  Document& document_;
  Omissions& omissions_;
  MeshStream& out_;
  std::map<std::pair<std::uint64_t, bool>, SourcePicture> pictures_;  // by texture and whether it is opaque
  std::set<std::uint64_t> unread_;                                    // textures that lie nowhere
};

}  // namespace mesh::gltf
