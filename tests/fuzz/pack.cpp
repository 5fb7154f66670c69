#include <array>
#include <memory>

#include "sound_db/pack/check.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/query.h"
#include "sound_db/pack/write.h"
#include "tests/fuzz/file_of_bytes.h"
#include "tests/unit/pack/example_pack.h"

namespace {

using namespace rustle;

/// A whole pack, one file of which gives way to the input.
struct Place {
  fuzz::MemoryFolder folder;
  std::filesystem::path pack = folder.path() / "pack";
  std::vector<std::filesystem::path> files;
  std::vector<std::string> whole;

  Place() {
    std::filesystem::remove_all(pack);
    fuzz::require(pack::write(pack::example_pack(), pack).has_value());
    for (const auto& entry : std::filesystem::recursive_directory_iterator(pack))
      if (entry.is_regular_file()) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    for (const auto& file : files) whole.push_back(pack::read_bytes(file));
  }
};

}  // namespace

/// The pack loader: the first byte says which file of a pack is what follows; a pack that loads is asked for sounds.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Place place;
  if (size == 0) return 0;
  const std::size_t which = data[0] % place.files.size();
  fuzz::write_file(place.files[which], fuzz::text_of(data + 1, size - 1));
  const auto loaded = pack::load(place.pack, 48000);
  if (loaded) {
    const pack::SoundPack& sounds = **loaded;
    if (sounds.crumpling) {
      fuzz::require(!sounds.crumpling->units.empty());
      for (const auto& unit : sounds.crumpling->units)
        for (const float sample : unit.samples) fuzz::require(std::isfinite(sample));
    }
    if (sounds.friction)
      for (const auto& spectrum : sounds.friction->spectra)
        for (const float magnitude : spectrum.magnitudes) fuzz::require(std::isfinite(magnitude) && magnitude >= 0);
  } else {
    fuzz::require(!loaded.error().text().empty());
  }
  fuzz::write_file(place.files[which], place.whole[which]);
  return 0;
}
