#include "sound_db/pack/library.h"

#include <algorithm>
#include <cstdlib>
#include <set>
#include <utility>

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

std::vector<std::string> places_of(const std::vector<fs::path>& folders) {
  std::vector<std::string> places;
  for (const fs::path& folder : folders) places.push_back(folder.string());
  return places;
}

/// By its own name or its material's; an empty name is everyone's.
bool is_called(const PackEntry& entry, const std::string& name) {
  return name.empty() || entry.name == name || entry.material == name;
}

/// Whether the error is about the pack in this folder.
bool is_of(const PackError& error, const fs::path& folder) {
  return error.file == folder || fs::path(error.file).parent_path() == folder;
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
  Found found = look();
  entries_ = std::move(found.entries);
  broken_ = std::move(found.broken);
}

PackLibrary::Loader PackLibrary::load_folder() {
  return [](const fs::path& folder, const LoadOptions& options) { return pack::load(folder, options); };
}

PackLibrary::Found PackLibrary::look() const {
  Found found;
  std::set<fs::path> seen;
  for (const fs::path& folder : folders_) {
    for (const fs::path& pack : pack_folders(folder)) {
      if (!seen.insert(pack).second) continue;
      Findings findings;
      if (const auto manifest = read_manifest(pack, findings)) {
        const SoundPack& p = manifest->pack;
        found.entries.push_back({pack, p.name, p.version, p.material, p.touched_surface, p.licence, p.origin});
        continue;
      }
      const auto first =
          std::find_if(findings.begin(), findings.end(), [](const Finding& f) { return f.severity == Severity::kError; });
      if (first != findings.end()) found.broken.push_back(first->what);
    }
  }
  return found;
}

/// Where in the search order the entry's folder stands.
std::size_t PackLibrary::rank(const PackEntry& entry) const {
  const auto holds = [&](const fs::path& folder) { return folder == entry.folder || folder == entry.folder.parent_path(); };
  return static_cast<std::size_t>(std::find_if(folders_.begin(), folders_.end(), holds) - folders_.begin());
}

tl::expected<std::vector<PackEntry>, PackError> PackLibrary::called(const std::string& name, const Found& found) const {
  if (name.empty() && !found.broken.empty()) return tl::unexpected(found.broken.front());
  if (found.entries.empty()) {
    return tl::unexpected(PackError{fmt::format("{}", fmt::join(places_of(folders_), ":")), "", "no sound packs are there",
                                    "put them back, or name their folder in RUSTLE_PACK_PATH and start again"});
  }
  std::vector<PackEntry> meant;
  std::set<std::pair<std::string, std::string>> seen;
  for (const PackEntry& entry : found.entries) {
    const bool counts = seen.emplace(entry.material, entry.touched_surface).second;
    if (counts && is_called(entry, name)) meant.push_back(entry);
  }
  if (name.empty()) return meant;
  for (const PackError& broken : found.broken) {
    const auto known = entries();
    const bool is_meant = std::any_of(known.begin(), known.end(),
                                      [&](const PackEntry& e) { return is_called(e, name) && is_of(broken, e.folder); });
    if (is_meant || fs::path(broken.file).parent_path().filename() == name) return tl::unexpected(broken);
  }
  if (!meant.empty()) return meant;
  std::set<std::string> names;
  for (const PackEntry& entry : found.entries) names.insert(entry.material);
  return tl::unexpected(PackError{fmt::format("{}", fmt::join(places_of(folders_), ":")), "name",
                                  fmt::format("there is no sound pack or material called \"{}\"", name),
                                  fmt::format("there are: {}", fmt::join(names, ", "))});
}

tl::expected<std::vector<std::shared_ptr<const SoundPack>>, PackError> PackLibrary::reload(const std::string& name,
                                                                                           std::uint32_t rate_hz) {
  Found found = look();
  const auto meant = called(name, found);
  if (!meant) return tl::unexpected(meant.error());
  std::vector<std::shared_ptr<const SoundPack>> packs;
  for (const PackEntry& entry : *meant) {
    auto pack = loader_(entry.folder, LoadOptions{rate_hz, 0});
    if (!pack) return tl::unexpected(std::move(pack.error()));
    packs.push_back(std::move(*pack));
  }
  const std::lock_guard lock(mutex_);
  for (std::size_t k = 0; k < packs.size(); ++k) {
    const fs::path& folder = (*meant)[k].folder;
    const auto before = loaded_.find(Key{folder, rate_hz, 0});
    const auto shared = before == loaded_.end() ? nullptr : before->second->pack.lock();
    if (shared && *shared == *packs[k]) {
      packs[k] = shared;
      continue;
    }
    std::erase_if(loaded_, [&](const auto& known) { return std::get<0>(known.first) == folder; });
    auto& place = loaded_[Key{folder, rate_hz, 0}] = std::make_shared<Loaded>();
    place->pack = packs[k];
  }
  if (name.empty()) {
    entries_ = std::move(found.entries);
    broken_.clear();
    return packs;
  }
  for (const PackEntry& entry : *meant) {
    std::erase_if(broken_, [&](const PackError& broken) { return is_of(broken, entry.folder); });
    std::erase_if(entries_, [&](const PackEntry& known) { return known.folder == entry.folder; });
    entries_.push_back(entry);
  }
  std::sort(entries_.begin(), entries_.end(), [&](const PackEntry& a, const PackEntry& b) {
    return std::pair(rank(a), a.folder) < std::pair(rank(b), b.folder);
  });
  return packs;
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
  const auto known = materials();
  PackError error{fmt::format("{}", fmt::join(places_of(folders_), ":")), "material",
                  fmt::format("no sound pack for \"{}\"", material), ""};
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
