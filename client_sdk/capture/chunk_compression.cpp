#include "client_sdk/capture/chunk_compression.h"

#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <cassert>
#include <memory>

#include <fmt/format.h>

namespace rustle::capture {
namespace {

constexpr std::size_t kFirstAllocation = 1u << 16;

struct ZstdFree {
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};
struct Lz4Free {
  void operator()(LZ4F_dctx* context) const { LZ4F_freeDecompressionContext(context); }
};

/// Calls `step(rest of input, rest of output)` until it is at the stream's end, growing the output up to `limit`.
/// step: consumes input, reports consumed and produced bytes and whether the stream is finished; a text on failure.
struct Step {
  std::size_t consumed = 0;
  std::size_t produced = 0;
  bool finished = false;
  std::string error;
};

template <typename StepFunction>
tl::expected<std::string, std::string> unpack(std::string_view input, std::uint64_t limit, StepFunction step) {
  std::string out;
  out.resize(std::min<std::uint64_t>(limit, kFirstAllocation));
  std::size_t filled = 0;
  while (true) {
    const Step result = step(input, out.data() + filled, out.size() - filled);
    if (!result.error.empty()) return tl::unexpected(result.error);
    input.remove_prefix(result.consumed);
    filled += result.produced;
    if (result.finished && input.empty()) break;
    if (result.consumed > 0 || result.produced > 0) continue;
    if (filled < out.size()) return tl::unexpected(std::string("its compressed data ends too early"));
    if (out.size() == limit) return tl::unexpected(fmt::format("it unpacks to more than the {} bytes it states", limit));
    out.resize(std::min<std::uint64_t>(limit, 2 * out.size()));
  }
  if (filled != limit) return tl::unexpected(fmt::format("it unpacks to {} bytes but states {}", filled, limit));
  return out;
}

tl::expected<std::string, std::string> decompress_zstd(std::string_view bytes, std::uint64_t size) {
  const std::unique_ptr<ZSTD_DCtx, ZstdFree> context(ZSTD_createDCtx());
  return unpack(bytes, size, [&](std::string_view input, char* out, std::size_t capacity) {
    ZSTD_inBuffer in{input.data(), input.size(), 0};
    ZSTD_outBuffer produced{out, capacity, 0};
    const std::size_t result = ZSTD_decompressStream(context.get(), &produced, &in);
    Step step{in.pos, produced.pos, result == 0, {}};
    if (ZSTD_isError(result)) step.error = fmt::format("its zstd data is damaged ({})", ZSTD_getErrorName(result));
    return step;
  });
}

tl::expected<std::string, std::string> decompress_lz4(std::string_view bytes, std::uint64_t size) {
  LZ4F_dctx* raw = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&raw, LZ4F_VERSION))) {
    return tl::unexpected(std::string("lz4 cannot be started"));
  }
  const std::unique_ptr<LZ4F_dctx, Lz4Free> context(raw);
  return unpack(bytes, size, [&](std::string_view input, char* out, std::size_t capacity) {
    std::size_t consumed = input.size();
    std::size_t produced = capacity;
    const std::size_t result = LZ4F_decompress(context.get(), out, &produced, input.data(), &consumed, nullptr);
    if (LZ4F_isError(result)) {
      return Step{0, 0, false, fmt::format("its lz4 data is damaged ({})", LZ4F_getErrorName(result))};
    }
    return Step{consumed, produced, result == 0, {}};
  });
}

}  // namespace

std::string_view compression_name(Compression compression) {
  return compression == Compression::kZstd ? "zstd" : "";
}

std::string compress(std::string_view bytes, Compression compression, int zstd_level) {
  assert(bytes.size() <= kMaxChunkBytes);
  if (compression == Compression::kNone) return std::string(bytes);
  std::string out;
  out.resize(ZSTD_compressBound(bytes.size()));
  const std::size_t size = ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), zstd_level);
  assert(!ZSTD_isError(size) && "compressBound() bytes always suffice");
  out.resize(size);
  return out;
}

tl::expected<std::string, std::string> decompress(std::string_view bytes, std::string_view compression,
                                                  std::uint64_t uncompressed_size) {
  if (uncompressed_size > kMaxChunkBytes) {
    return tl::unexpected(
        fmt::format("it states {} bytes of records; at most {} are read", uncompressed_size, kMaxChunkBytes));
  }
  if (compression == "zstd") return decompress_zstd(bytes, uncompressed_size);
  if (compression == "lz4") return decompress_lz4(bytes, uncompressed_size);
  if (!compression.empty()) return tl::unexpected(fmt::format("its compression \"{}\" is unknown", compression));
  if (bytes.size() != uncompressed_size) {
    return tl::unexpected(fmt::format("it holds {} bytes but states {}", bytes.size(), uncompressed_size));
  }
  return std::string(bytes);
}

}  // namespace rustle::capture
