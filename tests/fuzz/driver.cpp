// Runs a target over its seeds, over every cut of them, and over a fixed number of mutations of them.
//
//   fuzz_NAME [--inputs N]      all inputs, which are the same on every machine
//   fuzz_NAME --only I          input number I alone, as a crash names it
//   fuzz_NAME --write-seeds DIR the seeds as files, for libFuzzer
//   fuzz_NAME FILE...           these files
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "base/file.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr std::size_t kMaxExhaustiveBytes = 4096;  // bytes; smaller seeds are cut at every length

// splitmix64 (Steele et al. 2014) lets any input be made from its number alone.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15ULL) {}
  std::uint64_t next() {
    std::uint64_t z = (state_ += 0x9E3779B97F4A7C15ULL);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
  }
  std::size_t below(std::size_t limit) { return limit == 0 ? 0 : static_cast<std::size_t>(next() % limit); }

 private:
  std::uint64_t state_;
};

std::uint64_t interestingNumber(Random& random) {
  static constexpr std::array<std::uint64_t, 12> kNumbers{0,
                                                          1,
                                                          0x7F,
                                                          0x80,
                                                          0xFF,
                                                          0x7FFF,
                                                          0xFFFF,
                                                          0x7FFFFFFF,
                                                          0x80000000,
                                                          0xFFFFFFFF,
                                                          0x7FC00000 /* NaN */,
                                                          0xFFFFFFFFFFFFFFFF};
  return kNumbers[random.below(kNumbers.size())];
}

void mutateOnce(base::Bytes& bytes, const base::Bytes& other, Random& random) {
  const std::size_t at = random.below(bytes.size());
  const auto position = bytes.begin() + static_cast<std::ptrdiff_t>(at);
  const std::size_t rest = bytes.size() - at;
  switch (random.below(7)) {
    case 0:  // one bit
      if (rest > 0) bytes[at] ^= static_cast<std::uint8_t>(1U << random.below(8));
      break;
    case 1:  // one byte
      if (rest > 0) bytes[at] = static_cast<std::uint8_t>(random.next());
      break;
    case 2: {  // a number that often breaks readers, mostly where a field would lie
      const std::uint64_t number = interestingNumber(random);
      const std::size_t size = std::size_t{1} << random.below(4);
      const std::size_t aligned = random.below(4) != 0 ? at / 4 * 4 : at;
      if (aligned + size <= bytes.size()) std::memcpy(bytes.data() + aligned, &number, size);
      break;
    }
    case 3:  // cut
      bytes.resize(at);
      break;
    case 4:  // remove a piece
      bytes.erase(position, position + static_cast<std::ptrdiff_t>(random.below(std::min<std::size_t>(rest, 64) + 1)));
      break;
    case 5:  // insert a piece
      bytes.insert(position, 1 + random.below(32), static_cast<std::uint8_t>(random.next()));
      break;
    default: {  // insert a piece of another seed
      const std::size_t from = random.below(other.size());
      const std::size_t count = std::min({rest, other.size() - from, random.below(64) + 1});
      std::copy_n(other.begin() + static_cast<std::ptrdiff_t>(from), count, position);
    }
  }
}

base::Bytes mutated(const std::vector<base::Bytes>& seeds, std::uint64_t number) {
  Random random(number + 1);
  base::Bytes bytes = seeds[random.below(seeds.size())];
  for (std::size_t i = 0, count = 1 + random.below(4); i < count; ++i)
    mutateOnce(bytes, seeds[random.below(seeds.size())], random);
  return bytes;
}

// The number of the current input, which a crash report names.
volatile std::sig_atomic_t current_input = -1;

extern "C" void reportCrash(int signal) {
  std::array<char, 96> line{};
  const int length = std::snprintf(line.data(), line.size(), "fuzz: signal %d at input %d; run again with --only\n",
                                   signal, static_cast<int>(current_input));
  if (::write(STDERR_FILENO, line.data(), static_cast<std::size_t>(length)) < 0) std::_Exit(3);
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

void runAll(const std::vector<base::Bytes>& seeds, std::uint64_t inputs) {
  for (const base::Bytes& seed : seeds) {
    fuzz::fuzzOne(seed);
    for (std::size_t length = 0; seed.size() <= kMaxExhaustiveBytes && length < seed.size(); ++length)
      fuzz::fuzzOne(base::ByteView(seed).first(length));
  }
  for (std::uint64_t i = 0; i < inputs; ++i) {
    current_input = static_cast<std::sig_atomic_t>(i);
    fuzz::fuzzOne(mutated(seeds, i));
  }
}

int writeSeeds(const std::vector<base::Bytes>& seeds, const std::string& directory) {
  for (std::size_t i = 0; i < seeds.size(); ++i)
    if (!base::writeFileAtomically(directory + "/seed" + std::to_string(i), seeds[i])) return 1;
  return 0;
}

int runFiles(const std::vector<std::string>& paths) {
  for (const std::string& path : paths) {
    const auto bytes = base::readFile(path);
    if (!bytes) return std::fprintf(stderr, "%s\n", bytes.error().message.c_str()), 1;
    fuzz::fuzzOne(*bytes);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  for (const int signal : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL}) std::signal(signal, reportCrash);
  const std::vector<std::string> words(argv + 1, argv + argc);
  const std::vector<base::Bytes> seeds = fuzz::seeds();
  if (words.size() == 2 && words[0] == "--write-seeds") return writeSeeds(seeds, words[1]);
  if (words.size() == 2 && words[0] == "--only") return fuzz::fuzzOne(mutated(seeds, std::stoull(words[1]))), 0;
  if (!words.empty() && words[0] != "--inputs") return runFiles(words);

  const std::uint64_t inputs = words.size() == 2 ? std::stoull(words[1]) : 20000;
  runAll(seeds, inputs);
  std::printf("%zu seeds, their cuts and %llu mutations\n", seeds.size(), static_cast<unsigned long long>(inputs));
  return 0;
}
