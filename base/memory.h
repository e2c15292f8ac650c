#pragma once
// The machine's memory, and how the allocator of this process deals with what is freed.
#include <cstdint>

namespace base {

/// Bytes of physical memory, or the limit set for this process' control group where that is less.
std::uint64_t machineMemory();

/// Makes the allocator keep freed memory for the next request, which is often of the same size: fetching it from the
/// system anew costs a fault for each page. Threads that begin from now on share as many heaps as there are cores,
/// since each heap keeps its own: with more of them a build that decodes pictures ahead took 1.6 times the memory in
/// the same time. Holds for the whole process.
void keepFreedMemory();

/// Makes the allocator fetch blocks of a megabyte and more from the system and return each when it is freed, for a
/// program whose large blocks are of ever other sizes: kept ones would add up. Holds for the whole process.
void returnLargeBlocks();

/// Returns to the system what the allocator keeps, where that is a large share of the `memory_bytes` that may be used.
void releaseFreedMemory(std::uint64_t memory_bytes);

}  // namespace base
