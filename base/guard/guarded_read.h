#pragma once
// Reads mapped memory without dying of it. Where a mapped file was cut, or its disk fails, touching the map raises
// SIGBUS, which ends the process; a guarded read ends with `false` instead (docs/decisions/reads-that-cannot-kill.md).
#include <memory>
#include <type_traits>

#include "base/bytes.h"

namespace base {

/// Runs body(context) and returns true; or false when memory that it touched could not be read, in which case the rest
/// of it did not run. The body is left by siglongjmp then: nothing within it may have a destructor, hold a lock or
/// throw, and what it has written is undefined. Guards may be nested: a fault ends the innermost one. Any thread.
///
/// The first call installs a handler of SIGBUS. Faults outside of guards go to the handler that was there before, or
/// end the process as ever.
bool runGuarded(void (*body)(void*), void* context);

/// The same for a lambda that captures references.
template <class Body>
bool guardedRead(const Body& body) {
  static_assert(std::is_trivially_destructible_v<Body>, "a guarded body is left without running destructors");
  const auto call = [](void* context) { (*static_cast<const Body*>(context))(); };
  return runGuarded(call, const_cast<void*>(static_cast<const void*>(std::addressof(body))));
}

/// Copies mapped bytes; false when they could not be read. `out` has room for them.
bool copyGuarded(ByteView mapped, std::uint8_t* out);

/// Leaves the innermost guard of this thread as a fault would; does nothing where there is none. For callbacks of C
/// libraries that would end the process over bytes that make no sense.
void leaveGuard();

}  // namespace base
