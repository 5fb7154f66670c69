#include "client_sdk/capture/import.h"

#include <cmath>

#include <fmt/format.h>

#include "client_sdk/capture/import_mesh_sequence.h"
#include "client_sdk/capture/import_npz.h"

namespace rustle::capture {

std::string ImportError::text() const {
  std::string out = file;
  for (const std::string* part : {&field, &message}) {
    if (part->empty()) continue;
    if (!out.empty()) out += ": ";
    out += *part;
  }
  if (!remedy.empty()) out += "; " + remedy;
  return out;
}

tl::expected<void, ImportError> check_options(const ImportOptions& options) {
  const auto refuse = [](std::string field, std::string message, std::string remedy) {
    return tl::unexpected(ImportError{"", std::move(field), std::move(message), std::move(remedy)});
  };
  if (!std::isfinite(options.metres_per_unit) || options.metres_per_unit <= 0) {
    return refuse("scale", fmt::format("{} metres per unit is not a length", options.metres_per_unit),
                  "give a positive number, such as 0.01 for centimetres");
  }
  if (!std::isfinite(options.frames_per_s) || options.frames_per_s < 0) {
    return refuse("fps", fmt::format("{} frames per second is not a rate", options.frames_per_s),
                  "give a positive number, such as 60");
  }
  return {};
}

ImportResult import_capture(const std::string& input, const std::filesystem::path& output, const ImportOptions& options,
                            const ImportProgress& progress) {
  if (std::filesystem::path(input).extension() == ".npz") return import_npz(input, output, options, progress);
  auto files = mesh_sequence_files(input);
  if (!files) return tl::unexpected(files.error());
  return import_mesh_sequence(*files, output, options, progress);
}

}  // namespace rustle::capture
