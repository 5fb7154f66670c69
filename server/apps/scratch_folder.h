#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>

namespace rustle::apps {

/// A folder for what a command needs while it runs, in the system's folder for such; gone when it is.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::error_code unknown;
    std::string name = (std::filesystem::temp_directory_path(unknown) / "rustle-XXXXXX").string();
    if (!unknown && mkdtemp(name.data()) != nullptr) path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  /// Empty: it could not be made.
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace rustle::apps
