#pragma once
// Decodes a node's picture, or its caster, for the GPU.
#include <cstdint>
#include <memory>

#include "base/bytes.h"
#include "lod/hlod/format.h"
#include "lod/hlod/stream.h"

namespace lod::hlod {

/// Null where the bytes are damaged.
std::shared_ptr<const NodePicture> decodePicture(const Header& header, const Node& node, std::uint32_t number,
                                                 base::ByteView bytes);
/// Memory of a picture, and how much that of a node may take before it is known. A mesh has about half as many vertices
/// as triangles; the guess is twice that, since vertices with several attributes count several times.
std::uint64_t pictureBytes(const NodePicture& picture);
std::uint64_t guessedPictureBytes(const Node& node);

/// The same of a node's caster, which has a block of its own unless the node is a leaf.
std::shared_ptr<const CasterPicture> decodeCaster(const Header& header, const Node& node, std::uint32_t number,
                                                  base::ByteView bytes);
/// The caster of a leaf, whose picture this is.
std::shared_ptr<const CasterPicture> casterOfLeaf(const NodePicture& picture);
std::uint64_t casterBytes(const CasterPicture& caster);
std::uint64_t guessedCasterBytes(const Node& node);

}  // namespace lod::hlod
