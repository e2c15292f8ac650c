#include "base/resource_limits.h"

#include "base/memory.h"
#include "base/parallel.h"

namespace base {

ResourceLimits ResourceLimits::resolved() const {
  ResourceLimits out = *this;
  if (out.threads == 0) out.threads = coreCount();
  // The rest is left to the system's file cache, which the work files of a build go through, and to other programs.
  if (out.memory_bytes == 0) out.memory_bytes = machineMemory() / 10 * 6;
  return out;
}

}  // namespace base
