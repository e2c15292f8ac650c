#pragma once
// Where the meshes of an export lie in the world. Programs that make meshes from photographs write OBJ with places less
// an origin, since many readers keep places in single precision, and tell the origin and the coordinate reference
// system in a file of their own. ContextCapture and DJI Terra in metadata.xml:
//
//     <ModelMetadata version="1">
//       <SRS>EPSG:32632</SRS>
//       <SRSOrigin>691000,5334000,520</SRSOrigin>
//     </ModelMetadata>
//
// Pix4D in NAME_offset.xyz, three numbers, beside which NAME_wkt.prj has the system as well-known text; OpenDroneMap in
// odm_georeferencing/coords.txt, of which the second line is the origin, without a height:
//
//     WGS84 UTM 32N
//     691000 5334000
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
  std::string file;        ///< that says so, without the folder; empty where only a text was read
};

/// Reads the text of a metadata.xml; nothing where it is some other XML, or tells no origin, or one in degrees. Error:
/// kInvalidInput where the origin is not three finite numbers.
base::Result<std::optional<ExportPlace>> readMetadataXml(std::string_view xml);

/// Reads the text of a NAME_offset.xyz, and that of the NAME_wkt.prj beside it, "" where there is none. Error:
/// kInvalidInput where the former is not three finite numbers.
base::Result<ExportPlace> readOffsetXyz(std::string_view offset, std::string_view system);

/// Reads the text of a coords.txt. Its first line names a zone of UTM, an EPSG code or a PROJ string; of the last,
/// zones of UTM on WGS 84 are understood. Error: kInvalidInput where the second line does not begin with two finite
/// numbers.
base::Result<ExportPlace> readCoordsTxt(std::string_view text);

/// Looks for such files in the folder of the mesh and in the two above it, as the programs lay them out:
///
/// - metadata.xml, since the tiles of an export lie in folders of their own, Data/Tile_+000_+000/Tile_+000_+000.obj;
/// - NAME_offset.xyz there and in 1_initial/params, where the mesh's name begins with NAME;
/// - odm_georeferencing/coords.txt, where the mesh's name begins with odm_textured_model_geo.
///
/// The first that tells an origin counts, unless that is in degrees. Errors as above, with the file's name.
base::Result<std::optional<ExportPlace>> findExportPlace(const std::string& mesh);

}  // namespace mesh
