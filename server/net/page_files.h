#pragma once
// The browser client as files: index.html, program, style, icons, as the preset "web" builds them and `cmake --install`
// puts them beside the programs. All are read at start, so that a requested name is looked up in a list and never on
// the disk.
#include <map>
#include <string>
#include <string_view>

#include "base/bytes.h"
#include "base/error.h"

namespace server {

/// A file as it is, or as compressed beforehand.
struct PageForm {
  base::Bytes bytes;
  std::string etag;  ///< strong, with its quotes; empty: the file has no such form
};

struct PageFile {
  const char* type = "";   ///< Content-Type
  bool immutable = false;  ///< the name holds a hash of the bytes: may be kept forever
  PageForm plain, gzip, brotli;
};

/// By name relative to the folder, '/' between folders: "index.html", "icons/32.png".
using PageFiles = std::map<std::string, PageFile, std::less<>>;

/// Reads the folder; FILE.br and FILE.gz are forms of FILE. Hidden files and links are passed over. Errors name the
/// folder and what to do: kNotFound without index.html; kInvalidInput for more than 256 files or 64 MiB, a compressed
/// form without its file, and names that no URL has.
base::Result<PageFiles> readPageFiles(const std::string& directory);

/// The folder of this program's installed page: ../share/lumigrid/web beside its bin, or build/web/site of the tree
/// that it was built in. Empty when neither is there.
std::string installedPageFiles();

/// The Content-Type for a name's ending; application/octet-stream for an unknown one.
const char* contentTypeOf(std::string_view name);
/// Whether the name holds a hash: "lumigrid-1f0c2a9b.js": '-' or '.', 8 or more lower-case hexadecimal digits, '.'.
bool isHashedName(std::string_view name);

/// Content-Security-Policy of the page: program and style only from here (and client/web/site/early.js, which stands in
/// index.html, by its SHA-256), WebAssembly allowed, pictures also from memory, data from any host, since ?scene= may
/// point anywhere. Whether the page may stand in another's frame is not limited: people embed viewers, and there is
/// nothing here that a click could give away.
inline constexpr const char* kPagePolicy =
    "default-src 'self'; script-src 'self' 'wasm-unsafe-eval' 'sha256-G3PNp+9HCM4FJadtZ7XuRIXb0Ky78I+yH0hcE88h2eo='; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' blob: "
    "data:; "
    "worker-src 'self' blob:; connect-src 'self' ws: wss: http: https: blob: data:; object-src 'none'; base-uri "
    "'none'; form-action 'none'";

}  // namespace server
