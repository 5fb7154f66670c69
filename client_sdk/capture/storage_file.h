#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <system_error>

#include <tl/expected.hpp>

namespace rustle::capture {

/// What went wrong with a file on disk, for a person: which file, what happened, what to do.
struct StorageError {
  std::string file_name;
  std::string message;
  std::string remedy;

  std::string text() const;  ///< all three in one line
};

/// The remedy that fits the system's answer: disk full, quota, no permission, closed file, ...
StorageError storage_error(const std::string& file_name, const std::string& action, std::error_code cause);

/// A file that only grows, as a capture writer needs it. Errors are returned, never thrown.
/// One thread at a time.
class OutputFile {
 public:
  virtual ~OutputFile() = default;
  /// Appends all bytes, or says why not; then any part of them may be in the file.
  virtual std::error_code write(std::string_view bytes) = 0;
  /// Returns after everything written has reached the disk.
  virtual std::error_code sync() = 0;
  /// Cuts the file to `size_bytes`; the next write appends there.
  virtual std::error_code truncate(std::uint64_t size_bytes) = 0;
  virtual std::error_code close() = 0;
  virtual const std::string& name() const = 0;
};

/// A stream of bytes to read from its beginning. One thread at a time.
class InputFile {
 public:
  virtual ~InputFile() = default;
  /// Fills `out` as far as the file reaches: fewer bytes than asked mean the file's end.
  virtual tl::expected<std::size_t, std::error_code> read(std::span<char> out) = 0;
  virtual const std::string& name() const = 0;
};

/// Creates the file, or empties it when it exists. Its name becomes durable with the first sync().
tl::expected<std::unique_ptr<OutputFile>, StorageError> create_file(const std::filesystem::path& path);

/// The same, but never a file that exists, nor through a link: then "File exists" is the error.
tl::expected<std::unique_ptr<OutputFile>, StorageError> create_new_file(const std::filesystem::path& path);

tl::expected<std::unique_ptr<InputFile>, StorageError> open_file(const std::filesystem::path& path);

}  // namespace rustle::capture
