#include "base/memory.h"

#include <gtest/gtest.h>
#include <malloc.h>

#include <barrier>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "base/parallel.h"

namespace base {
namespace {

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

// The allocator's heaps, as it tells them.
std::size_t heapCount() {
  char* text = nullptr;
  std::size_t size = 0;
  std::FILE* file = ::open_memstream(&text, &size);
  ::malloc_info(0, file);
  std::fclose(file);
  const std::string info(text, size);
  std::free(text);
  std::size_t count = 0;
  for (std::size_t at = info.find("<heap nr="); at != info.npos; at = info.find("<heap nr=", at + 1)) ++count;
  return count;
}

// Starts more threads than there are cores, all of which hold memory at once.
void allocateOnManyThreads(unsigned threads) {
  std::barrier all(static_cast<std::ptrdiff_t>(threads));
  std::vector<std::thread> running;
  for (unsigned i = 0; i < threads; ++i)
    running.emplace_back([&] {
      const std::vector<char> block(100'000);
      all.arrive_and_wait();
    });
  for (std::thread& thread : running) thread.join();
}

// Each in a program of its own, since heaps that are there stay.
TEST(Memory, threadsOfABuildShareAsManyHeapsAsThereAreCores) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const unsigned threads = 3 * coreCount() + 1;
  const auto end = [](bool is_right) { std::_Exit(is_right ? 0 : 1); };
  EXPECT_EXIT((allocateOnManyThreads(threads), end(heapCount() > coreCount())), testing::ExitedWithCode(0), "");
  EXPECT_EXIT((keepFreedMemory(), allocateOnManyThreads(threads), end(heapCount() <= coreCount())),
              testing::ExitedWithCode(0), "");
}

#endif

}  // namespace
}  // namespace base
