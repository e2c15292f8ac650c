#pragma once
// EXT_meshopt_compression and KHR_meshopt_compression: buffer views that libmeshoptimizer decodes.
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "mesh/gltf/json_values.h"

namespace mesh::gltf {

/// The object of either extension within a buffer view; null where the view is not compressed.
const json& meshoptOf(const json& view);

/// Decodes the compressed bytes of a view. Errors begin with `here`.
base::Result<base::Bytes> decodeMeshopt(const json& compression, base::ByteView compressed, const std::string& here);

}  // namespace mesh::gltf
