#include "mesh/gltf/material.h"

#include <cmath>

namespace mesh::gltf {
namespace {

// Turns counter-clockwise in texture coordinates whose v runs downwards, as the extension's examples and all viewers
// do; the matrix in its text turns the other way.
glm::dmat2 turned(double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {glm::dvec2(c, -s), glm::dvec2(s, c)};
}

}  // namespace

BaseColor Materials::of(const json& primitive) {
  const json& material = item(document_.list("materials"), integer(member(primitive, "material"), kMissing));
  const json& base = member(material, "pbrMetallicRoughness");
  BaseColor color;
  color.factor = numbers<glm::dvec4>(member(base, "baseColorFactor")).value_or(glm::dvec4(1.0));
  // Only a mask and what is blended have an alpha (glTF 2.0, section 3.9.4).
  const std::string mode = text(member(material, "alphaMode"));
  color.opaque = mode != "MASK" && mode != "BLEND";
  const json& reference = member(base, "baseColorTexture");
  if (!reference.is_object()) return color;
  color.texture = integer(member(reference, "index"), kMissing);

  const json& transform = extension(reference, "KHR_texture_transform");
  const std::uint64_t set = integer(member(transform, "texCoord"), integer(member(reference, "texCoord"), 0));
  color.coordinates = "TEXCOORD_" + std::to_string(set);
  const auto scale = numbers<glm::dvec2>(member(transform, "scale")).value_or(glm::dvec2(1.0));
  const glm::dmat2 scaled(glm::dvec2(scale.x, 0.0), glm::dvec2(0.0, scale.y));
  color.picture_from_vertex = turned(number(member(transform, "rotation"), 0.0)) * scaled;
  color.offset = numbers<glm::dvec2>(member(transform, "offset")).value_or(glm::dvec2(0.0));
  return color;
}

// The stream says itself which pictures it cannot decode.
std::uint32_t Materials::pictureOf(const BaseColor& base, std::span<const glm::dvec2> uv) {
  const std::uint64_t texture = *base.texture;
  if (unread_.contains(texture)) return kNoPicture;
  if (const auto known = pictures_.find({texture, base.opaque}); known != pictures_.end())
    return out_.textures.find(known->second, uv, out_.summary.warnings);
  const json& source = item(document_.list("textures"), texture);
  // An extension's picture stands beside one for those who do not know it, or alone.
  const json& webp = member(extension(source, "EXT_texture_webp"), "source");
  const json& plain = webp.is_null() ? member(source, "source") : webp;
  base::Result<SourcePicture> picture = base::Error{};
  if (plain.is_null() && extension(source, "KHR_texture_basisu").is_object())
    picture = unsupported("it is KTX2 (KHR_texture_basisu); write the textures as JPEG, PNG or WebP");
  else
    picture = document_.picture(integer(plain, kMissing));
  if (picture) {
    picture->opaque = base.opaque;
    pictures_[{texture, base.opaque}] = *picture;
    return out_.textures.find(*picture, uv, out_.summary.warnings);
  }
  unread_.insert(texture);
  if (omissions_.unread_textures++ == 0) omissions_.first_unread = picture.error().message;
  return kNoPicture;
}

}  // namespace mesh::gltf
