#pragma once
// References from one file to another as glTF and 3D Tiles write them (RFC 3986), and bytes that are written into a
// reference (RFC 2397).
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.h"
#include "base/error.h"

namespace mesh {

/// Whether the reference holds the bytes itself: "data:image/png;base64,...".
inline bool isDataUri(std::string_view reference) {
  return reference.substr(0, 5) == "data:";
}
/// Whether the reference names another host or protocol: "https://...", "//host/...".
bool isRemote(std::string_view reference);

/// The file that a reference within the file `from` names. A relative one starts at the folder of `from`. Whole paths
/// and ".." are followed, as in every other format. A query and a fragment are dropped.
std::string fileOfReference(const std::string& from, std::string_view reference);

/// The text after a data URI's comma where it is base64; empty for all other references.
std::string_view base64Of(std::string_view reference);
/// The bytes of a data URI, whether it is base64 or percent-encoded. Nullopt where it is broken.
std::optional<base::Bytes> bytesOfDataUri(std::string_view reference);
/// Nullopt where a character is none of base64's. A backslash before "/" is skipped, as JSON may write it.
std::optional<base::Bytes> bytesOfBase64(std::string_view text);

}  // namespace mesh
