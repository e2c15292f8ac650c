#include "base/jpeg/huffman.h"

#include <algorithm>

namespace base::jpeg {

std::optional<HuffmanTable> HuffmanTable::make(std::span<const std::uint8_t, 17> lengths,
                                               std::span<const std::uint8_t, 256> symbols) {
  HuffmanTable table;
  std::copy(symbols.begin(), symbols.end(), table.symbols_.begin());
  std::uint32_t code = 0;  // the next one, of as many bits as the loop is at
  std::uint32_t count = 0;
  for (unsigned length = 1; length <= 16; ++length, code <<= 1) {
    table.first_[length] = static_cast<std::uint16_t>(count - code);
    for (unsigned i = 0; i < lengths[length]; ++i, ++code, ++count) {
      if (count >= 256 || code >= 1U << length) return std::nullopt;
      Code& known = table.codes_[symbols[count]];
      if (known.length != 0) return std::nullopt;
      known = {static_cast<std::uint16_t>(code), static_cast<std::uint8_t>(length)};
      if (length > kWindow) continue;
      const Symbol symbol{symbols[count], static_cast<std::uint8_t>(length)};
      std::fill_n(table.short_.begin() + (code << (kWindow - length)), 1U << (kWindow - length), symbol);
    }
    table.end_[length] = code << (16 - length);
  }

  for (std::uint32_t window = 0; window < table.several_.size(); ++window) {
    Skip& skip = table.several_[window];
    unsigned bits = 0, steps = 0;
    while (skip.ends == 0) {
      const Symbol next = table.short_[(window << bits) & (table.short_.size() - 1)];
      const unsigned used = bits + next.length + (next.value & 15U);
      // The window's bits must hold all of the code, and all of its value unless it is the first.
      if (next.length == 0 || bits + next.length > kWindow || (bits > 0 && used > kWindow)) break;
      const unsigned step = next.value == 0 ? 1 : (next.value >> 4) + 1U;
      if (steps + step > 64) break;
      skip.ends = next.value == 0 ? 1 : 0;
      bits = used, steps += step;
      if (bits >= kWindow) break;
    }
    skip.bits = static_cast<std::uint16_t>(bits & 31U);
    skip.steps = static_cast<std::uint16_t>(steps & 127U);
  }
  return table;
}

HuffmanTable::Symbol HuffmanTable::longSymbolOf(std::uint32_t bits) const {
  for (unsigned length = kWindow + 1; length <= 16; ++length)
    if (bits < end_[length]) {
      const auto at = static_cast<std::uint16_t>(first_[length] + (bits >> (16 - length)));
      return {symbols_[at & 255U], static_cast<std::uint8_t>(length)};
    }
  return {};
}

void BitWriter::copy(const std::uint8_t* data, std::uint64_t from, std::uint64_t to) {
  const auto bitsAt = [data](std::uint64_t bit) { return BitReader::wordAt(data + bit / 8) << (bit % 8); };
  const std::size_t needed = used_ + static_cast<std::size_t>((to - from) / 8) + 8;
  if (bytes_.size() < needed) bytes_.resize(std::max(needed, 2 * bytes_.size()));
  for (; to - from >= 32; from += 32) put(static_cast<std::uint32_t>(bitsAt(from) >> 32), 32);
  if (from < to) put(static_cast<std::uint32_t>(bitsAt(from) >> (64 - (to - from))), static_cast<unsigned>(to - from));
}

void BitWriter::finish(Bytes& out) {
  const unsigned open = (8 - count_ % 8) % 8;
  put((1U << open) - 1, open);
  bytes_.resize(used_);
  while (count_ > 0) {
    count_ -= 8;
    bytes_.push_back(static_cast<std::uint8_t>(hold_ >> count_));
  }
  used_ = 0;
  out.reserve(out.size() + bytes_.size() + bytes_.size() / 64 + 64);
  const std::uint8_t *from = bytes_.data(), *const end = from + bytes_.size();
  while (from != end) {
    const auto* ones = static_cast<const std::uint8_t*>(std::memchr(from, 0xFF, static_cast<std::size_t>(end - from)));
    const std::uint8_t* const to = ones == nullptr ? end : ones + 1;
    out.insert(out.end(), from, to);
    if (ones != nullptr) out.push_back(0);
    from = to;
  }
  bytes_.clear();
}

std::optional<std::size_t> unstuff(ByteView coded, std::uint8_t* out, std::size_t& written) {
  const std::uint8_t *from = coded.data(), *const end = from + coded.size();
  written = 0;
  while (from != end) {
    const auto* ones = static_cast<const std::uint8_t*>(std::memchr(from, 0xFF, static_cast<std::size_t>(end - from)));
    if (ones == nullptr || ones + 1 == end) return std::nullopt;
    const bool stuffed = ones[1] == 0;
    const std::size_t count = static_cast<std::size_t>(ones - from) + (stuffed ? 1 : 0);
    std::memcpy(out + written, from, count);
    written += count;
    if (!stuffed) return static_cast<std::size_t>(ones - coded.data());
    from = ones + 2;
  }
  return std::nullopt;
}

}  // namespace base::jpeg
