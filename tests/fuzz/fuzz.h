#pragma once
// A fuzz target defines these two functions. Bytes from disk or wire may be anything: fuzzOne feeds one input to a
// reader, which must return a value or an error, without a crash, a sanitizer report or much memory. It aborts when a
// value breaks its promises. A target whose bytes carry checksums feeds each input twice: as it is, and with correct
// checksums.
#include <vector>

#include "base/bytes.h"

namespace fuzz {

/// Returns valid inputs that mutations start from: at least one, and at best a few small ones.
std::vector<base::Bytes> seeds();

void fuzzOne(base::ByteView bytes);

}  // namespace fuzz
