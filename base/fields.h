#pragma once
// A record's fields, named once and used both to write and to read them.
//
// A function returns them by std::tie in the order in which they are stored:
//   auto fieldsOf(auto& header) { return std::tie(header.bytes, header.flags, header.crc); }
#include <tuple>
#include <type_traits>

#include "base/bytes.h"

namespace base {

/// Writes each field as it lies in memory.
template <class... Fields>
void writeFields(ByteWriter& out, const std::tuple<Fields&...>& fields) {
  std::apply([&](const auto&... field) { (out.write(field), ...); }, fields);
}

/// Reads what writeFields() wrote. Any byte but 0 reads as true.
template <class... Fields>
void readFields(ByteReader& in, const std::tuple<Fields&...>& fields) {
  const auto read = [&]<class Field>(Field& field) {
    if constexpr (std::is_same_v<Field, bool>)
      field = in.u8() != 0;
    else
      field = in.read<Field>();
  };
  std::apply([&](auto&... field) { (read(field), ...); }, fields);
}

}  // namespace base
