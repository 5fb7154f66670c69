#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/monitor/http_server.h"

namespace rustle::page {

/// RUSTLE_PAGE_PATH, or where an installation has the page: ../share/rustle/page beside the program's folder, then
/// /usr/share/rustle/page. The first that is there; else the first.
std::filesystem::path page_folder();

/// The files that the browser loads, as Vite built them.
class StaticFiles {
 public:
  static constexpr std::uintmax_t kFileBytes = 16 << 20;  ///< what is larger is not served

  explicit StaticFiles(std::filesystem::path folder) : folder_(std::move(folder)) {}

  /// "/" is index.html; where that is missing, a page that says what to do. Other paths are those of files below the folder
  /// by plain names (letters, digits, dots, dashes, underscores; none begins with a dot). Absent: there is no such file.
  /// Reads the disk. [HTTP thread]
  std::optional<monitor::HttpResponse> answer(const monitor::HttpRequest& request) const;

 private:
  const std::filesystem::path folder_;
};

}  // namespace rustle::page
