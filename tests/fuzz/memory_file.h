#pragma once

#include <algorithm>
#include <span>
#include <string>
#include <string_view>

#include "client_sdk/capture/capture_reader.h"

namespace rustle::fuzz {

/// A capture that lies in memory. \pre the bytes outlive it
class MemoryFile : public capture::InputFile {
 public:
  explicit MemoryFile(std::string_view bytes) : rest_(bytes) {}
  tl::expected<std::size_t, std::error_code> read(std::span<char> out) override {
    const std::size_t count = std::min(out.size(), rest_.size());
    std::copy_n(rest_.data(), count, out.data());
    rest_.remove_prefix(count);
    return count;
  }
  const std::string& name() const override { return name_; }

 private:
  std::string_view rest_;
  std::string name_ = "memory.mcap";
};

}  // namespace rustle::fuzz
