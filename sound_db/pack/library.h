#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <tuple>
#include <vector>

#include <tl/expected.hpp>

#include "sound_db/pack/load.h"
#include "sound_db/pack/pack_error.h"
#include "sound_db/pack/sound_pack.h"

namespace rustle::pack {

/// A pack that was found, by its manifest.
struct PackEntry {
  std::filesystem::path folder;
  std::string name;
  std::string version;
  std::string material;
  std::string touched_surface;
  std::string licence;
  std::string origin;
};

/// Where packs are looked for, in this order: the folders of RUSTLE_PACK_PATH (separated by colons), ../share/rustle/packs
/// beside the program's own folder, /usr/share/rustle/packs.
std::vector<std::filesystem::path> default_search_folders();

/// The packs in a list of folders: each is a pack itself or holds packs. Of packs alike in material and surface the first in
/// search order counts; inside a folder the order is by name. A loaded pack is shared as long as somebody holds it.
/// Control side, any thread.
class PackLibrary {
 public:
  using Result = tl::expected<std::shared_ptr<const SoundPack>, PackError>;
  /// Reads a pack's folder; any thread, several at a time.
  using Loader = std::function<Result(const std::filesystem::path& folder, const LoadOptions& options)>;

  explicit PackLibrary(std::vector<std::filesystem::path> folders = default_search_folders(), Loader loader = load_folder());

  /// Reads packs anew: those of this name or material, or with an empty name all that are there; new ones too. All or
  /// nothing: an error names the first file at fault, and everything stays as it was. Returns them, at this rate; one that
  /// reads as it did before is the one that was shared before, and who holds another keeps it. Blocks while it reads.
  [[nodiscard]] tl::expected<std::vector<std::shared_ptr<const SoundPack>>, PackError> reload(const std::string& name,
                                                                                              std::uint32_t rate_hz);

  std::vector<std::filesystem::path> search_folders() const;
  std::vector<PackEntry> entries() const;
  /// Packs that were found but cannot be read.
  std::vector<PackError> broken() const;
  /// Names of the materials, sorted, each once.
  std::vector<std::string> materials() const;

  /// The pack of a material for a touched surface, or for any surface when there is none for that one. An error names the
  /// materials there are.
  [[nodiscard]] tl::expected<PackEntry, PackError> find(const std::string& material,
                                                        const std::string& touched_surface = {}) const;

  /// find, then load at a rate; fft_size 0: spectra as stored. Reads files, but once for all who ask for the same pack
  /// meanwhile; nobody else waits.
  [[nodiscard]] Result load(const std::string& material, const std::string& touched_surface, std::uint32_t rate_hz,
                            std::uint32_t fft_size = 0);

 private:
  static Loader load_folder();
  /// What is in the folders now.
  struct Found {
    std::vector<PackEntry> entries;
    std::vector<PackError> broken;
  };
  Found look() const;
  /// The entries to read anew; an error where one of that name cannot be.
  tl::expected<std::vector<PackEntry>, PackError> called(const std::string& name, const Found& found) const;
  std::size_t rank(const PackEntry& entry) const;

  using Key = std::tuple<std::filesystem::path, std::uint32_t, std::uint32_t>;
  /// A pack at a rate. Its lock is held while it is read, so that who wants the same one waits instead of reading it again.
  struct Loaded {
    std::mutex mutex;
    std::weak_ptr<const SoundPack> pack;
  };

  const std::vector<std::filesystem::path> folders_;
  const Loader loader_;
  mutable std::mutex mutex_;
  std::vector<PackEntry> entries_;
  std::vector<PackError> broken_;
  std::map<Key, std::shared_ptr<Loaded>> loaded_;
};

}  // namespace rustle::pack
