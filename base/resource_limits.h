#pragma once
// The cores and the memory that a command may use, handed down to everything it calls.
#include <cstdint>

namespace base {

/// No output depends on either.
struct ResourceLimits {
  unsigned threads = 0;            ///< 0: all cores
  std::uint64_t memory_bytes = 0;  ///< memory of the whole process; 0: 60 % of the machine's

  /// The same limits with numbers in place of zeros.
  ResourceLimits resolved() const;
};

}  // namespace base
