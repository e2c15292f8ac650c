#pragma once
// A digest of a method's file that does not depend on the version of its format tells whether two builds made the same.
#include <cstdint>
#include <string>

#include "base/error.h"

namespace server::cli {

/// SHA-256, in hexadecimal digits, of patch.lgp, qsplat.lgq, pmr.lgm or hlod.lgh with zeros in place of the header's
/// version (bytes 8 to 11) and checksum (the header's last 4 bytes), which covers the version. `header_bytes`: length
/// of the header; 0: the file has it behind the version. Errors: kNotFound, kIo; kInvalidInput where the file is
/// shorter than its header.
base::Result<std::string> methodDigest(const std::string& path, std::uint32_t header_bytes = 0);

}  // namespace server::cli
