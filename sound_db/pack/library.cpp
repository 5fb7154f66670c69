#include "sound_db/pack/library.h"

#include <algorithm>
#include <cstdlib>
#include <set>

#include <fmt/format.h>

#include "sound_db/pack/manifest.h"

namespace rustle::pack {

namespace fs = std::filesystem;

namespace {

std::vector<fs::path> pack_folders(const fs::path& folder) {
  std::error_code failed;
  if (fs::exists(folder / kManifestName, failed)) return {folder};
  std::vector<fs::path> found;
  for (fs::directory_iterator at(folder, failed), end; !failed && at != end; at.increment(failed)) {
    std::error_code unreadable;
    const bool hidden = at->path().filename().string().starts_with('.');
    if (!hidden && fs::exists(at->path() / kManifestName, unreadable)) found.push_back(at->path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

std::vector<fs::path> default_search_folders() {
  std::vector<fs::path> folders;
  if (const char* listed = std::getenv("RUSTLE_PACK_PATH")) {
    std::string_view rest(listed);
    while (!rest.empty()) {
      const auto colon = rest.find(':');
      const std::string_view name = rest.substr(0, colon);
      if (!name.empty()) folders.emplace_back(name);
      rest = colon == std::string_view::npos ? std::string_view{} : rest.substr(colon + 1);
    }
  }
  std::error_code failed;
  const fs::path program = fs::read_symlink("/proc/self/exe", failed);
  if (!failed) folders.push_back((program.parent_path() / "../share/rustle/packs").lexically_normal());
  folders.emplace_back("/usr/share/rustle/packs");
  return folders;
}

PackLibrary::PackLibrary(std::vector<fs::path> folders, Loader loader)
    : folders_(std::move(folders)), loader_(std::move(loader)) {
  rescan();
}

PackLibrary::Loader PackLibrary::load_folder() {
  return [](const fs::path& folder, const LoadOptions& options) { return pack::load(folder, options); };
}

void PackLibrary::rescan() {
  std::vector<PackEntry> entries;
  std::vector<PackError> broken;
  std::set<fs::path> seen;
  for (const fs::path& folder : folders_) {
    for (const fs::path& pack : pack_folders(folder)) {
      if (!seen.insert(pack).second) continue;
      Findings findings;
      if (const auto manifest = read_manifest(pack, findings)) {
        const SoundPack& p = manifest->pack;
        entries.push_back({pack, p.name, p.version, p.material, p.touched_surface, p.licence, p.origin});
        continue;
      }
      const auto first =
          std::find_if(findings.begin(), findings.end(), [](const Finding& f) { return f.severity == Severity::kError; });
      if (first != findings.end()) broken.push_back(first->what);
    }
  }
  const std::lock_guard lock(mutex_);
  entries_ = std::move(entries);
  broken_ = std::move(broken);
  loaded_.clear();
}

std::vector<fs::path> PackLibrary::search_folders() const {
  return folders_;
}

std::vector<PackEntry> PackLibrary::entries() const {
  const std::lock_guard lock(mutex_);
  return entries_;
}

std::vector<PackError> PackLibrary::broken() const {
  const std::lock_guard lock(mutex_);
  return broken_;
}

std::vector<std::string> PackLibrary::materials() const {
  std::set<std::string> names;
  for (const PackEntry& entry : entries()) names.insert(entry.material);
  return {names.begin(), names.end()};
}

tl::expected<PackEntry, PackError> PackLibrary::find(const std::string& material, const std::string& touched_surface) const {
  const auto all = entries();
  const PackEntry* any_surface = nullptr;
  for (const PackEntry& entry : all) {
    if (entry.material != material) continue;
    if (entry.touched_surface == touched_surface) return entry;
    if (!any_surface) any_surface = &entry;
  }
  if (any_surface) return *any_surface;
  std::vector<std::string> places;
  for (const fs::path& folder : folders_) places.push_back(folder.string());
  const auto known = materials();
  PackError error{fmt::format("{}", fmt::join(places, ":")), "material", fmt::format("no sound pack for \"{}\"", material),
                  ""};
  if (known.empty()) {
    error.remedy =
        "no packs are there at all: make one with `rustle pack generate`, or name their folder in RUSTLE_PACK_PATH";
  } else {
    error.remedy = fmt::format("there are: {}", fmt::join(known, ", "));
  }
  for (const PackError& broken : this->broken()) error.remedy += fmt::format("; unreadable: {}", broken.text());
  return tl::unexpected(std::move(error));
}

PackLibrary::Result PackLibrary::load(const std::string& material, const std::string& touched_surface, std::uint32_t rate_hz,
                                      std::uint32_t fft_size) {
  const auto entry = find(material, touched_surface);
  if (!entry) return tl::unexpected(entry.error());
  const Key key{entry->folder, rate_hz, fft_size};
  std::shared_ptr<Loaded> loaded;
  {
    const std::lock_guard lock(mutex_);
    auto& place = loaded_[key];
    if (!place) place = std::make_shared<Loaded>();
    loaded = place;
  }
  const std::lock_guard lock(loaded->mutex);
  if (auto shared = loaded->pack.lock()) return shared;
  auto pack = loader_(entry->folder, LoadOptions{rate_hz, fft_size});
  if (pack) loaded->pack = *pack;
  return pack;
}

}  // namespace rustle::pack
