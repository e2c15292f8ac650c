#include "base/memory.h"

#include <malloc.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>

#include "base/parallel.h"

namespace base {
namespace {

constexpr int kMegabyte = 1 << 20;

// The first `bytes` that the allocator fetches from now on come in large pages, where the system has them: a fault for
// each page of 4 kB takes an eighth of the time of a small build. This reserves address space, not memory.
void useLargePages([[maybe_unused]] int bytes) {
#if defined(__GLIBC__) && defined(MADV_HUGEPAGE)
  constexpr std::uintptr_t kPage = std::uintptr_t{2} << 20;
  const auto heapEnd = [] { return reinterpret_cast<std::uintptr_t>(::sbrk(0)); };
  const std::uintptr_t begin = (heapEnd() + kPage - 1) / kPage * kPage;
  ::mallopt(M_TOP_PAD, bytes);
  // The allocator has no free block of this size, so it extends the heap by it and by the padding.
  if (void* room = std::malloc(16 * kMegabyte)) {
    *static_cast<volatile char*>(room) = 0;
    std::free(room);
  }
  ::mallopt(M_TOP_PAD, 1 << 17);  // the allocator's default
  const std::uintptr_t end = heapEnd() / kPage * kPage;
  if (begin < end) (void)::madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
#endif
}

}  // namespace

std::uint64_t machineMemory() {
  std::uint64_t bytes =
      static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  std::ifstream limit("/sys/fs/cgroup/memory.max");
  if (std::uint64_t max = 0; limit >> max) bytes = std::min(bytes, max);
  return bytes;
}

void keepFreedMemory() {
#if defined(__GLIBC__)
  ::mallopt(M_MMAP_THRESHOLD, 32 * kMegabyte);  // the largest that glibc accepts
  ::mallopt(M_TRIM_THRESHOLD, 128 * kMegabyte);
  ::mallopt(M_ARENA_MAX, static_cast<int>(coreCount()));  // the default is eight for each core
  useLargePages(64 * kMegabyte);
#endif
}

void returnLargeBlocks() {
#if defined(__GLIBC__)
  ::mallopt(M_MMAP_THRESHOLD, kMegabyte);
#endif
}

void releaseFreedMemory(std::uint64_t memory_bytes) {
#if defined(__GLIBC__)
  // Less than this is used again sooner than it is returned and fetched.
  constexpr std::uint64_t kMinWorthReturning = std::uint64_t{32} << 20;
  if (::mallinfo2().fordblks > std::max(kMinWorthReturning, memory_bytes / 16)) ::malloc_trim(0);
#endif
}

}  // namespace base
