#pragma once
// Numbers written for people.
#include <cstdint>
#include <string>

namespace base {

/// "12.3 MB": units of 1 000, from B to TB.
std::string formatBytes(std::uint64_t bytes);

/// 3024763 as "3,024,763".
std::string formatCount(std::uint64_t count, char separator = ',');

}  // namespace base
