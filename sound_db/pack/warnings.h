#pragma once

#include <filesystem>
#include <string>
#include <utility>

#include "sound_db/pack/pack_error.h"

namespace rustle::pack {

/// Writes down what will not sound right in the files of a folder.
class Warnings {
 public:
  Warnings(const std::filesystem::path& folder, Findings& findings) : folder_(folder), findings_(findings) {}
  void operator()(const std::string& file, std::string field, std::string message, std::string remedy) {
    findings_.push_back(
        {Severity::kWarning, {(folder_ / file).string(), std::move(field), std::move(message), std::move(remedy)}});
  }

 private:
  const std::filesystem::path& folder_;
  Findings& findings_;
};

}  // namespace rustle::pack
