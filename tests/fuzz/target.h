#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// What every target of tests/fuzz is: one function from bytes to nothing, which libFuzzer calls with what it makes up, and
/// replay.cpp with the corpus. It may do anything with the bytes but crash, hang, or break what it asserts.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace rustle::fuzz {

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
  return {static_cast<const char*>(static_cast<const void*>(data)), size};
}

/// Holds where NDEBUG takes assertions away.
inline void require(bool holds) {
  if (!holds) __builtin_trap();
}

/// The input as a sequence of parts, each after its length in two bytes, little-endian; the last may be cut.
inline std::vector<std::string_view> parts_of(std::string_view input) {
  std::vector<std::string_view> parts;
  while (input.size() >= 2) {
    const std::size_t length = static_cast<unsigned char>(input[0]) | static_cast<unsigned char>(input[1]) << 8;
    input.remove_prefix(2);
    parts.push_back(input.substr(0, length));
    input.remove_prefix(parts.back().size());
  }
  return parts;
}

}  // namespace rustle::fuzz
