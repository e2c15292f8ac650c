#pragma once
// What a fuzz target defines. Bytes from disk or wire may be anything: fuzzOne feeds one input to a reader, which must
// come back with a value or an error, without a crash, a sanitizer report or much memory; it aborts when a value breaks
// its promises. A target whose bytes carry checksums feeds each input twice: as it is, and with its checksums made
// right again.
#include <vector>

#include "base/bytes.h"

namespace fuzz {

/// Valid inputs that mutations start from; at least one, best a few small ones.
std::vector<base::Bytes> seeds();

void fuzzOne(base::ByteView bytes);

}  // namespace fuzz
