#pragma once
// Where the meshes of an export lie in the world. Programs that make meshes from photographs (ContextCapture, DJI
// Terra) write OBJ with places less an origin, since many readers keep places in single precision, and tell the origin
// and the coordinate reference system in a file metadata.xml:
//
//     <ModelMetadata version="1">
//       <SRS>EPSG:32632</SRS>
//       <SRSOrigin>691000,5334000,520</SRSOrigin>
//     </ModelMetadata>
#include <glm/glm.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "base/error.h"
#include "mesh/crs_text.h"

namespace mesh {

struct ExportPlace {
  glm::dvec3 origin{0.0};  ///< to be added to the mesh's coordinates
  CrsDescription crs;      ///< of the sum; empty where the file names a local system, such as ENU, or none
};

/// Reads the text of such a file; nothing where it is some other XML, or tells no origin, or one in degrees. Error:
/// kInvalidInput where the origin is not three finite numbers.
base::Result<std::optional<ExportPlace>> readExportPlace(std::string_view xml);

/// Looks for metadata.xml in the folder of the mesh and in the two above it: the tiles of an export lie in folders of
/// their own, Data/Tile_+000_+000/Tile_+000_+000.obj. The first that tells an origin counts. Errors as readExportPlace,
/// with the file's name.
base::Result<std::optional<ExportPlace>> findExportPlace(const std::string& mesh);

}  // namespace mesh
