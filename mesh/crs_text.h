#pragma once
// Coordinate reference systems as point clouds name them: in well-known text (OGC 01-009 and ISO 19162) and in GeoTIFF
// keys (OGC 19-008r4). Only the horizontal system is read, and nothing is looked up.
#include <string>
#include <string_view>

#include "base/bytes.h"

namespace mesh {

/// A horizontal coordinate reference system as a file names it. Texts are empty where the file says nothing.
struct CrsDescription {
  std::string code;          ///< by authority, "EPSG:26912"
  std::string name;          ///< "NAD83 / UTM zone 12N"
  std::string unit;          ///< of x and y: "m", "ft", "us-ft", or as the file names it; not of degrees
  bool has_degrees = false;  ///< x is longitude and y latitude
};

/// Reads well-known text of either version; broken text describes as much as was understood.
CrsDescription crsFromWellKnownText(std::string_view text);

/// `directory` and `names` are the contents of GeoTIFF's tags 34735 and 34737. Keys that do not fit are passed over.
CrsDescription crsFromGeoKeys(base::ByteView directory, std::string_view names);

}  // namespace mesh
