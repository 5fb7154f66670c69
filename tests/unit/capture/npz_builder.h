#pragma once

#include <zlib.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "client_sdk/capture/mcap_format.h"

namespace rustle::capture {

/// A `.npy` array of version 1 as NumPy writes it.
inline std::string npy_bytes(const std::string& type, const std::vector<std::size_t>& shape, const std::string& data,
                             bool fortran_order = false) {
  std::string header = fmt::format("{{'descr': '{}', 'fortran_order': {}, 'shape': ({}{}), }}", type,
                                   fortran_order ? "True" : "False", fmt::join(shape, ", "), shape.size() == 1 ? "," : "");
  while ((10 + header.size() + 1) % 64 != 0) header += ' ';
  header += '\n';
  std::string out("\x93NUMPY\x01\x00", 8);
  append_value(out, static_cast<std::uint16_t>(header.size()));
  return out + header + data;
}

template <typename Value>
std::string npy(const std::string& type, const std::vector<std::size_t>& shape, const std::vector<Value>& values) {
  return npy_bytes(type, shape, {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value)});
}

inline std::string deflated(const std::string& bytes) {
  z_stream stream{};
  deflateInit2(&stream, 6, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
  std::string out(deflateBound(&stream, bytes.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

struct ZipOptions {
  bool deflate = true;
  bool zip64 = false;  ///< sizes in the extra field and a 64-bit directory end, as NumPy writes for large files
};

/// A zip file of the entries.
inline std::string zip_of(const std::vector<std::pair<std::string, std::string>>& entries, ZipOptions options = {}) {
  const auto u16 = [](std::string& out, std::uint64_t value) { append_value(out, static_cast<std::uint16_t>(value)); };
  const auto u32 = [](std::string& out, std::uint64_t value) { append_value(out, static_cast<std::uint32_t>(value)); };
  std::string out, directory;
  for (const auto& [name, bytes] : entries) {
    const std::string packed = options.deflate ? deflated(bytes) : bytes;
    const std::uint64_t offset = out.size();
    std::string common;
    u16(common, 45);
    u16(common, 0);
    u16(common, options.deflate ? 8 : 0);
    u32(common, 0);
    u32(common, crc32_of(bytes));
    u32(common, options.zip64 ? 0xffffffffu : packed.size());
    u32(common, options.zip64 ? 0xffffffffu : bytes.size());
    u16(common, name.size());
    std::string extra;
    if (options.zip64) {
      u16(extra, 1);
      u16(extra, 24);
      append_value(extra, static_cast<std::uint64_t>(bytes.size()));
      append_value(extra, static_cast<std::uint64_t>(packed.size()));
      append_value(extra, offset);
    }
    u32(out, 0x04034b50);
    out += common;
    u16(out, extra.size());
    out += name + extra + packed;
    u32(directory, 0x02014b50);
    u16(directory, 45);
    directory += common;
    u16(directory, extra.size());
    u16(directory, 0);
    directory.append(8, '\0');
    u32(directory, options.zip64 ? 0xffffffffu : offset);
    directory += name + extra;
  }
  const std::uint64_t directory_offset = out.size();
  out += directory;
  if (options.zip64) {
    const std::uint64_t end64 = out.size();
    u32(out, 0x06064b50);
    append_value(out, std::uint64_t{44});
    u16(out, 45);
    u16(out, 45);
    out.append(8, '\0');
    append_value(out, static_cast<std::uint64_t>(entries.size()));
    append_value(out, static_cast<std::uint64_t>(entries.size()));
    append_value(out, static_cast<std::uint64_t>(directory.size()));
    append_value(out, directory_offset);
    u32(out, 0x07064b50);
    u32(out, 0);
    append_value(out, end64);
    u32(out, 1);
  }
  u32(out, 0x06054b50);
  u32(out, 0);
  u16(out, options.zip64 ? 0xffff : entries.size());
  u16(out, options.zip64 ? 0xffff : entries.size());
  u32(out, options.zip64 ? 0xffffffffu : directory.size());
  u32(out, options.zip64 ? 0xffffffffu : directory_offset);
  u16(out, 0);
  return out;
}

}  // namespace rustle::capture
