#pragma once

#include <algorithm>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "client_sdk/capture/storage_file.h"

namespace rustle::capture {

/// What a MemoryFile holds, kept beyond the file's life.
struct MemoryDisk {
  std::string bytes;
  std::vector<std::size_t> write_ends;  ///< size after each write
  int operations = 0;                   ///< writes, syncs, truncations, closings so far
  int failing_operation = -1;           ///< this one fails; a failing write leaves half of its bytes
  bool fails_from_then_on = false;
  bool closed = false;
};

class MemoryOutputFile final : public OutputFile {
 public:
  explicit MemoryOutputFile(std::shared_ptr<MemoryDisk> disk) : disk_(std::move(disk)) {}

  std::error_code write(std::string_view bytes) override {
    if (auto cause = next_operation()) {
      disk_->bytes.append(bytes.substr(0, bytes.size() / 2));
      return cause;
    }
    disk_->bytes.append(bytes);
    disk_->write_ends.push_back(disk_->bytes.size());
    return {};
  }
  std::error_code sync() override { return next_operation(); }
  std::error_code truncate(std::uint64_t size_bytes) override {
    if (auto cause = next_operation()) return cause;
    disk_->bytes.resize(size_bytes);
    return {};
  }
  std::error_code close() override {
    disk_->closed = true;
    return next_operation();
  }
  const std::string& name() const override { return name_; }

 private:
  std::error_code next_operation() {
    const int operation = disk_->operations++;
    const bool fails =
        disk_->failing_operation >= 0 &&
        (operation == disk_->failing_operation || (disk_->fails_from_then_on && operation > disk_->failing_operation));
    return fails ? std::make_error_code(std::errc::no_space_on_device) : std::error_code();
  }

  std::shared_ptr<MemoryDisk> disk_;
  std::string name_ = "recording.mcap";
};

class MemoryInputFile final : public InputFile {
 public:
  explicit MemoryInputFile(std::string_view bytes) : rest_(bytes) {}

  tl::expected<std::size_t, std::error_code> read(std::span<char> out) override {
    const std::size_t count = std::min(out.size(), rest_.size());
    std::memcpy(out.data(), rest_.data(), count);
    rest_.remove_prefix(count);
    return count;
  }
  const std::string& name() const override { return name_; }

 private:
  std::string_view rest_;
  std::string name_ = "recording.mcap";
};

}  // namespace rustle::capture
