#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <tl/expected.hpp>

namespace rustle::capture {

/// Reads the entries of a zip file (PKWARE APPNOTE 6.3; stored and deflated, zip64), as NumPy writes them.
/// All offsets and lengths are checked against the file before they are used. One thread at a time.
class ZipArchive {
 public:
  struct Entry {
    std::string name;
    std::uint16_t flags = 0;
    std::uint16_t method = 0;  ///< 0 stored, 8 deflated
    std::uint32_t crc = 0;
    std::uint64_t compressed_size = 0;
    std::uint64_t size = 0;
    std::uint64_t header_offset = 0;
  };

  /// Error: what is wrong with the file, without its name.
  static tl::expected<ZipArchive, std::string> open(const std::filesystem::path& path);

  const std::vector<Entry>& entries() const { return entries_; }
  /// The entry's bytes, their CRC checked. Error: what is wrong with it.
  tl::expected<std::string, std::string> read(const Entry& entry);

 private:
  tl::expected<std::string, std::string> bytes_at(std::uint64_t offset, std::uint64_t count);
  tl::expected<void, std::string> read_directory();

  std::ifstream file_;
  std::uint64_t file_size_ = 0;
  std::vector<Entry> entries_;
};

}  // namespace rustle::capture
