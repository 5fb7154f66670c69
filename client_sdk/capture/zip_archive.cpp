#include "client_sdk/capture/zip_archive.h"

#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <limits>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "client_sdk/capture/mcap_format.h"

namespace rustle::capture {
namespace {

constexpr std::uint32_t kEnd64Signature = 0x06064b50;
constexpr std::uint32_t kLocator64Signature = 0x07064b50;
constexpr std::uint32_t kDirectorySignature = 0x02014b50;
constexpr std::uint32_t kLocalSignature = 0x04034b50;
constexpr std::uint64_t kEndSize = 22;
constexpr std::uint64_t kLocatorSize = 20;
constexpr std::uint64_t kEnd64Size = 56;
constexpr std::uint64_t kLocalSize = 30;
constexpr std::uint16_t kEncrypted = 1;
constexpr std::uint16_t kZip64Extra = 1;
constexpr std::uint32_t kIn64 = 0xffffffffu;

constexpr std::uint64_t kMaxDirectoryBytes = 16u << 20;
constexpr std::uint64_t kMaxEntryBytes = std::uint64_t{4} << 30;
constexpr std::uint64_t kMaxDeflateRatio = 1032;

/// Unpacks one raw deflate stream to exactly `size` bytes.
tl::expected<std::string, std::string> inflate_all(const std::string& packed, std::uint64_t size) {
  z_stream stream{};
  if (inflateInit2(&stream, -MAX_WBITS) != Z_OK) return tl::unexpected(std::string("zlib cannot be started"));
  std::string out(size, '\0');
  // zlib's interface takes the input without const but does not write to it.
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  std::uint64_t in_left = packed.size();
  std::uint64_t out_left = size;
  constexpr std::uint64_t kStep = std::numeric_limits<uInt>::max();
  int state = Z_OK;
  do {
    const uInt in_step = static_cast<uInt>(std::min(in_left, kStep));
    const uInt out_step = static_cast<uInt>(std::min(out_left, kStep));
    stream.avail_in = in_step;
    stream.avail_out = out_step;
    state = inflate(&stream, Z_NO_FLUSH);
    in_left -= in_step - stream.avail_in;
    out_left -= out_step - stream.avail_out;
  } while (state == Z_OK);
  inflateEnd(&stream);
  if (state != Z_STREAM_END || out_left != 0) return tl::unexpected(std::string("its compressed data is damaged"));
  return out;
}

/// Sizes and offset that do not fit 32 bits stand in the zip64 extra field, in this order, only those that do not fit.
bool read_zip64(std::string_view extra, ZipArchive::Entry& entry) {
  FieldReader fields(extra);
  while (fields.rest().size() >= 4) {
    const auto id = fields.value<std::uint16_t>();
    FieldReader inner(fields.bytes(fields.value<std::uint16_t>()));
    if (fields.failed()) return false;
    if (id != kZip64Extra) continue;
    for (std::uint64_t* field : {&entry.size, &entry.compressed_size, &entry.header_offset}) {
      if (*field == kIn64) *field = inner.value<std::uint64_t>();
    }
    return !inner.failed();
  }
  return true;
}

}  // namespace

tl::expected<ZipArchive, std::string> ZipArchive::open(const std::filesystem::path& path) {
  std::error_code cause;
  ZipArchive archive;
  archive.file_size_ = std::filesystem::file_size(path, cause);
  if (cause) return tl::unexpected(fmt::format("cannot be opened: {}", cause.message()));
  archive.file_.open(path, std::ios::binary);
  if (!archive.file_) {
    return tl::unexpected(fmt::format("cannot be opened: {}", std::generic_category().message(errno)));
  }
  if (auto directory = archive.read_directory(); !directory) return tl::unexpected(directory.error());
  return archive;
}

tl::expected<std::string, std::string> ZipArchive::bytes_at(std::uint64_t offset, std::uint64_t count) {
  if (offset > file_size_ || count > file_size_ - offset) {
    return tl::unexpected(fmt::format("is cut or damaged: it points beyond its end, byte {}", file_size_));
  }
  std::string bytes(count, '\0');
  file_.clear();
  file_.seekg(static_cast<std::streamoff>(offset));
  file_.read(bytes.data(), static_cast<std::streamsize>(count));
  if (!file_) return tl::unexpected(fmt::format("cannot be read at byte {}", offset));
  return bytes;
}

tl::expected<void, std::string> ZipArchive::read_directory() {
  const std::uint64_t tail_size = std::min<std::uint64_t>(file_size_, kEndSize + 0xffff);
  const auto tail = bytes_at(file_size_ - tail_size, tail_size);
  if (!tail) return tl::unexpected(tail.error());
  const std::string_view signature("PK\x05\x06", 4);
  const std::size_t end_at = tail->rfind(signature);
  if (end_at == std::string::npos || tail->size() - end_at < kEndSize) {
    return tl::unexpected(std::string(tail->starts_with("PK") || file_size_ > 0xffff
                                          ? "has no zip directory: it is cut, or no zip file"
                                          : "is no zip file"));
  }
  FieldReader end(std::string_view(*tail).substr(end_at));
  end.bytes(10);
  std::uint64_t entry_count = end.value<std::uint16_t>();
  std::uint64_t directory_size = end.value<std::uint32_t>();
  std::uint64_t directory_offset = end.value<std::uint32_t>();

  const std::uint64_t end_offset = file_size_ - tail_size + end_at;
  if ((entry_count == 0xffff || directory_size == kIn64 || directory_offset == kIn64) && end_offset >= kLocatorSize) {
    const auto locator = bytes_at(end_offset - kLocatorSize, kLocatorSize);
    if (!locator) return tl::unexpected(locator.error());
    FieldReader fields(*locator);
    if (fields.value<std::uint32_t>() == kLocator64Signature) {
      fields.bytes(4);
      const auto end64 = bytes_at(fields.value<std::uint64_t>(), kEnd64Size);
      if (!end64) return tl::unexpected(end64.error());
      FieldReader wide(*end64);
      if (wide.value<std::uint32_t>() != kEnd64Signature) return tl::unexpected(std::string("has a damaged zip directory"));
      wide.bytes(28);
      entry_count = wide.value<std::uint64_t>();
      directory_size = wide.value<std::uint64_t>();
      directory_offset = wide.value<std::uint64_t>();
    }
  }
  if (directory_size > kMaxDirectoryBytes) return tl::unexpected(std::string("has a damaged zip directory"));
  const auto directory = bytes_at(directory_offset, directory_size);
  if (!directory) return tl::unexpected(directory.error());

  FieldReader fields(*directory);
  for (std::uint64_t i = 0; i < entry_count; ++i) {
    if (fields.value<std::uint32_t>() != kDirectorySignature) {
      return tl::unexpected(fmt::format("has a damaged zip directory at entry {}", i));
    }
    Entry entry;
    fields.bytes(4);
    entry.flags = fields.value<std::uint16_t>();
    entry.method = fields.value<std::uint16_t>();
    fields.bytes(4);
    entry.crc = fields.value<std::uint32_t>();
    entry.compressed_size = fields.value<std::uint32_t>();
    entry.size = fields.value<std::uint32_t>();
    const auto name_size = fields.value<std::uint16_t>();
    const auto extra_size = fields.value<std::uint16_t>();
    const auto comment_size = fields.value<std::uint16_t>();
    fields.bytes(8);
    entry.header_offset = fields.value<std::uint32_t>();
    entry.name = fields.bytes(name_size);
    const std::string_view extra = fields.bytes(extra_size);
    fields.bytes(comment_size);
    if (fields.failed() || !read_zip64(extra, entry)) {
      return tl::unexpected(fmt::format("has a damaged zip directory at entry {}", i));
    }
    entries_.push_back(std::move(entry));
  }
  return {};
}

tl::expected<std::string, std::string> ZipArchive::read(const Entry& entry) {
  if ((entry.flags & kEncrypted) != 0) return tl::unexpected(std::string("is encrypted"));
  if (entry.method != 0 && entry.method != 8) {
    return tl::unexpected(
        fmt::format("is compressed by method {}; only stored and deflated entries are read", entry.method));
  }
  if (entry.size > kMaxEntryBytes) {
    return tl::unexpected(fmt::format("has {} bytes; at most {} are read", entry.size, kMaxEntryBytes));
  }
  const auto local = bytes_at(entry.header_offset, kLocalSize);
  if (!local) return tl::unexpected(local.error());
  FieldReader fields(*local);
  if (fields.value<std::uint32_t>() != kLocalSignature)
    return tl::unexpected(std::string("is not where the zip directory says"));
  fields.bytes(22);
  const std::uint64_t name_size = fields.value<std::uint16_t>();
  const std::uint64_t extra_size = fields.value<std::uint16_t>();
  auto packed = bytes_at(entry.header_offset + kLocalSize + name_size + extra_size, entry.compressed_size);
  if (!packed) return packed;
  const bool stored = entry.method == 0;
  if (stored ? entry.size != packed->size() : entry.size / kMaxDeflateRatio > packed->size()) {
    return tl::unexpected(std::string("states a size that its data cannot have"));
  }
  auto bytes = stored ? std::move(packed) : inflate_all(*packed, entry.size);
  if (bytes && crc32_of(*bytes) != entry.crc) return tl::unexpected(std::string("is damaged: its checksum does not match"));
  return bytes;
}

}  // namespace rustle::capture
