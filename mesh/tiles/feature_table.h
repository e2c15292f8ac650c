#pragma once
// The header and the feature table that batched models (b3dm) and points (pnts) begin with. Section names in the source
// refer to the specification 3D Tiles 1.1 (OGC 22-025r4).
#include <glm/glm.hpp>
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "mesh/gltf/json_values.h"

namespace mesh::tiles {

struct FeatureTable {
  gltf::json root;                ///< null where the table is empty
  base::ByteView binary;          ///< behind its JSON
  base::ByteView body;            ///< behind all tables: a model
  std::uint64_t body_offset = 0;  ///< in the file

  /// Reads the header of 28 bytes and finds the tables. `name` is the format's, for errors: "b3dm".
  static base::Result<FeatureTable> parse(base::ByteView bytes, const char* name);
  /// RTC_CENTER, of the coordinates in those of the tile; 0 where it is missing.
  base::Result<glm::dvec3> center() const;
  /// A semantic of so many bytes that stands in the binary part, {"byteOffset": 12}. An error where it reaches past it.
  base::Result<base::ByteView> bytesOf(const char* semantic, std::uint64_t bytes) const;
};

}  // namespace mesh::tiles
