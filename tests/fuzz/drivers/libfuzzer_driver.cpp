// Hands libFuzzer's inputs to the target. `fuzz_NAME --write-seeds DIR` writes the target's seeds as files to begin
// with.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "base/file.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  if (*argc != 3 || std::string_view((*argv)[1]) != "--write-seeds") return 0;
  int number = 0;
  for (const base::Bytes& seed : fuzz::seeds())
    if (!base::writeFileAtomically(std::string((*argv)[2]) + "/seed" + std::to_string(number++), seed)) std::exit(1);
  std::exit(0);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::fuzzOne({data, size});
  return 0;
}
