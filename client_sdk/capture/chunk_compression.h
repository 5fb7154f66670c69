#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

namespace rustle::capture {

enum class Compression { kNone, kZstd };

/// What a chunk's records unpack to at most; a chunk that claims more is refused before anything is allocated.
inline constexpr std::uint64_t kMaxChunkBytes = 256u << 20;

/// The name in MCAP's registry: "" or "zstd".
std::string_view compression_name(Compression compression);

/// Pure; the same bytes for the same input. \pre bytes.size() <= kMaxChunkBytes
std::string compress(std::string_view bytes, Compression compression, int zstd_level);

/// Unpacks "zstd", "lz4" (frame format) or "" to exactly `uncompressed_size` bytes, or says what is wrong: an unknown
/// compression, a damaged stream, another size, a size above kMaxChunkBytes. Memory grows with what really unpacks,
/// never by the claimed size alone.
tl::expected<std::string, std::string> decompress(std::string_view bytes, std::string_view compression,
                                                  std::uint64_t uncompressed_size);

}  // namespace rustle::capture
