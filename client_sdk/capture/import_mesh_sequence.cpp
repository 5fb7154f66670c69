#include "client_sdk/capture/import_mesh_sequence.h"

#include <algorithm>
#include <cctype>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "client_sdk/capture/sheet_recorder.h"
#include "client_sdk/capture/storage_file.h"
#include "client_sdk/capture/triangle_mesh.h"

namespace rustle::capture {
namespace {

constexpr std::size_t kMaxFileBytes = std::size_t{1} << 30;
constexpr std::size_t kReadStep = 1u << 20;

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

bool comes_before(std::string_view a, std::string_view b) {
  while (!a.empty() && !b.empty()) {
    if (!is_digit(a[0]) || !is_digit(b[0])) {
      if (a[0] != b[0]) return a[0] < b[0];
      a.remove_prefix(1);
      b.remove_prefix(1);
      continue;
    }
    const auto take_number = [](std::string_view& text) {
      const std::size_t end = std::min(text.find_first_not_of("0123456789"), text.size());
      std::string_view digits = text.substr(0, end);
      text.remove_prefix(end);
      digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
      return digits;
    };
    const std::string_view number_a = take_number(a);
    const std::string_view number_b = take_number(b);
    if (number_a.size() != number_b.size()) return number_a.size() < number_b.size();
    if (number_a != number_b) return number_a < number_b;
  }
  return a.size() < b.size();
}

bool matches(std::string_view pattern, std::string_view name) {
  std::size_t p = 0, n = 0;
  std::size_t star = std::string_view::npos, star_name = 0;
  while (n < name.size()) {
    if (p < pattern.size() && (pattern[p] == '?' || pattern[p] == name[n]) && pattern[p] != '*') {
      ++p;
      ++n;
    } else if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      star_name = n;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      n = ++star_name;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', p) == std::string_view::npos;
}

std::string kind_of(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  std::ranges::transform(extension, extension.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension == ".obj" || extension == ".ply" ? extension : "";
}

tl::expected<std::string, ImportError> read_all(const std::filesystem::path& path) {
  auto file = open_file(path);
  if (!file) return tl::unexpected(ImportError{path.string(), "", file.error().message, file.error().remedy});
  std::string bytes;
  while (true) {
    const std::size_t filled = bytes.size();
    bytes.resize(filled + kReadStep);
    const auto got = (*file)->read(std::span(bytes).subspan(filled));
    if (!got)
      return tl::unexpected(ImportError{path.string(), "", "cannot be read: " + got.error().message(), "check the disk"});
    bytes.resize(filled + *got);
    if (*got < kReadStep) return bytes;
    if (bytes.size() > kMaxFileBytes) {
      return tl::unexpected(ImportError{path.string(), "", "is larger than 1 GiB", "simplify the mesh"});
    }
  }
}

}  // namespace

void sort_naturally(std::vector<std::filesystem::path>& files) {
  std::ranges::sort(files, [](const std::filesystem::path& a, const std::filesystem::path& b) {
    const std::string name_a = a.string(), name_b = b.string();
    if (comes_before(name_a, name_b)) return true;
    if (comes_before(name_b, name_a)) return false;
    return name_a < name_b;
  });
}

tl::expected<std::vector<std::filesystem::path>, ImportError> mesh_sequence_files(const std::string& input) {
  const std::filesystem::path path(input);
  const std::string pattern = path.filename().string();
  std::error_code cause;
  const bool is_folder = std::filesystem::is_directory(path, cause);
  if (!is_folder && pattern.find_first_of("*?") == std::string::npos) {
    if (!std::filesystem::exists(path, cause)) {
      return tl::unexpected(ImportError{input, "", "there is no such file", "check the path"});
    }
    if (kind_of(path).empty()) {
      return tl::unexpected(ImportError{input, "", "is of no kind that can be imported",
                                        "give a .npz, an .obj or a .ply file, or a folder of .obj or .ply files"});
    }
    return std::vector{path};
  }
  const std::filesystem::path folder = is_folder ? path : path.has_parent_path() ? path.parent_path() : ".";
  std::vector<std::filesystem::path> files;
  bool mixed = false;
  for (std::filesystem::directory_iterator entry(folder, cause), end; !cause && entry != end; entry.increment(cause)) {
    const std::filesystem::path& file = entry->path();
    if (kind_of(file).empty() || (!is_folder && !matches(pattern, file.filename().string()))) continue;
    mixed = mixed || (!files.empty() && kind_of(files.front()) != kind_of(file));
    files.push_back(file);
  }
  if (cause) return tl::unexpected(ImportError{folder.string(), "", "cannot be read: " + cause.message(), "check the path"});
  if (files.empty()) return tl::unexpected(ImportError{input, "", "holds no .obj or .ply files", "check the path"});
  if (mixed) {
    return tl::unexpected(ImportError{input, "", "holds both .obj and .ply files", "say which, such as \"frames/*.obj\""});
  }
  sort_naturally(files);
  return files;
}

ImportResult import_mesh_sequence(const std::vector<std::filesystem::path>& files, const std::filesystem::path& output,
                                  const ImportOptions& options, const ImportProgress& progress) {
  if (auto checked = check_options(options); !checked) return tl::unexpected(checked.error());
  if (files.empty()) return tl::unexpected(ImportError{"", "", "no files", "give at least one"});
  if (options.frames_per_s <= 0) {
    return tl::unexpected(
        ImportError{files.front().string(), "fps", "mesh files have no times", "give the rate, such as --fps 30"});
  }
  ImportSummary summary;
  auto recorder = SheetRecorder::create(output, files.front().string(), options, 0);
  if (!recorder) return tl::unexpected(recorder.error());
  for (std::size_t f = 0; f < files.size(); ++f) {
    const auto bytes = read_all(files[f]);
    if (!bytes) return tl::unexpected(bytes.error());
    const auto mesh = kind_of(files[f]) == ".ply" ? parse_ply(*bytes) : parse_obj(*bytes);
    if (!mesh) {
      return tl::unexpected(ImportError{files[f].string(), mesh.error().place, mesh.error().message, "export it again"});
    }
    const std::size_t vertex_count = mesh->positions.size() / 3;
    SheetFrame frame;
    frame.time_s = static_cast<double>(f) / options.frames_per_s;
    frame.positions = mesh->positions;
    frame.triangles = mesh->triangles;
    if (options.texture_coordinates_are_material) {
      if (mesh->texture_coordinates.size() != 2 * vertex_count) {
        return tl::unexpected(ImportError{files[f].string(), "texture coordinates", "are not one for each vertex",
                                          "export without seams, or leave them out"});
      }
      frame.material_coordinates = mesh->texture_coordinates;
    }
    if (auto sent = recorder->frame(frame, files[f].filename().string()); !sent) return tl::unexpected(sent.error());
    if (progress) progress(static_cast<double>(f + 1) / static_cast<double>(files.size()));
  }
  return recorder->finish(std::move(summary));
}

}  // namespace rustle::capture
