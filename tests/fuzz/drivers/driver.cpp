// Runs a target over the files of its corpus, over its seeds, over every cut of them, and over a fixed number of
// mutations of all.
//
//   fuzz_NAME [--corpus DIR] [--inputs N]  all inputs, which are the same on every machine
//   fuzz_NAME [--corpus DIR] --only I      input number I alone, as a crash names it
//   fuzz_NAME FILE...                      these files
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
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

/// The files of the corpus in the order of their names; none where the target has no corpus yet.
std::vector<std::string> corpusFiles(const std::string& directory) {
  std::vector<std::string> paths;
  std::error_code ec;
  for (const auto& entry : std::filesystem::directory_iterator(directory, ec)) paths.push_back(entry.path().string());
  std::sort(paths.begin(), paths.end());
  return paths;
}

/// Appends the bytes of the files; false, with a line, where one cannot be read.
bool readInto(std::vector<base::Bytes>& inputs, const std::vector<std::string>& paths) {
  for (const std::string& path : paths) {
    auto bytes = base::readFile(path);
    if (!bytes) return std::fprintf(stderr, "%s\n", bytes.error().message.c_str()), false;
    inputs.push_back(std::move(*bytes));
  }
  return true;
}

struct Arguments {
  std::string corpus;
  std::uint64_t inputs = 20000;
  std::optional<std::uint64_t> only;
  std::vector<std::string> files;
};

Arguments parse(int argc, char** argv) {
  Arguments parsed;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const bool has_value = i + 1 < argc;
    if (word == "--corpus" && has_value)
      parsed.corpus = argv[++i];
    else if (word == "--inputs" && has_value)
      parsed.inputs = std::stoull(argv[++i]);
    else if (word == "--only" && has_value)
      parsed.only = std::stoull(argv[++i]);
    else
      parsed.files.push_back(word);
  }
  return parsed;
}

void runSeeds(const std::vector<base::Bytes>& seeds) {
  for (const base::Bytes& seed : seeds) {
    fuzz::fuzzOne(seed);
    for (std::size_t length = 0; seed.size() <= kMaxExhaustiveBytes && length < seed.size(); ++length)
      fuzz::fuzzOne(base::ByteView(seed).first(length));
  }
}

void runMutations(const std::vector<base::Bytes>& origins, std::uint64_t inputs) {
  for (std::uint64_t i = 0; i < inputs; ++i) {
    current_input = static_cast<std::sig_atomic_t>(i);
    fuzz::fuzzOne(mutated(origins, i));
  }
}

}  // namespace

int main(int argc, char** argv) {
  for (const int signal : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL}) std::signal(signal, reportCrash);
  const Arguments arguments = parse(argc, argv);
  std::vector<base::Bytes> corpus;
  if (!readInto(corpus, arguments.files.empty() ? corpusFiles(arguments.corpus) : arguments.files)) return 1;
  if (!arguments.only)
    for (const base::Bytes& input : corpus) fuzz::fuzzOne(input);
  if (!arguments.files.empty()) return 0;

  const std::vector<base::Bytes> seeds = fuzz::seeds();
  std::vector<base::Bytes> origins = seeds;
  origins.insert(origins.end(), corpus.begin(), corpus.end());
  if (arguments.only) return fuzz::fuzzOne(mutated(origins, *arguments.only)), 0;
  runSeeds(seeds);
  runMutations(origins, arguments.inputs);
  std::printf("%zu files of the corpus, %zu seeds, their cuts and %llu mutations\n", corpus.size(), seeds.size(),
              static_cast<unsigned long long>(arguments.inputs));
  return 0;
}
