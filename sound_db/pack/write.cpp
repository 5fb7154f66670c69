#include "sound_db/pack/write.h"

#include <algorithm>
#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <unistd.h>

#include "sound_db/dsp/level.h"
#include "sound_db/pack/audio_file.h"
#include "sound_db/pack/cloth_corpus.h"
#include "sound_db/pack/cloth_write.h"
#include "sound_db/pack/manifest.h"
#include "sound_db/pack/npy.h"

namespace rustle::pack {

namespace {

namespace fs = std::filesystem;

constexpr double kStoredPeak_db = -1.0;

tl::expected<void, PackError> write_files(const SoundPack& pack, const fs::path& folder) {
  const auto failure = [](const fs::path& file, std::string message) {
    return tl::unexpected(PackError{file.string(), "", std::move(message), "choose a folder that can be written"});
  };
  Manifest manifest;
  manifest.pack = pack;
  manifest.pack.stored_rate_hz = pack.rate_hz;
  const auto make_parent = [&](const std::string& name) {
    std::error_code failed;
    fs::create_directories((folder / name).parent_path(), failed);
    return folder / name;
  };
  if (pack.crumpling) {
    double peak = 0;
    for (const Unit& unit : pack.crumpling->units) peak = std::max(peak, dsp::peak(unit.samples));
    // Whole tenths: the manifest is read by people.
    const double up_db = peak > 0 ? std::floor(10 * (kStoredPeak_db - dsp::gain_to_db(peak))) / 10 : 0.0;
    manifest.crumpling_gain_db = -up_db;
    const auto up = static_cast<float>(dsp::db_to_gain(up_db));
    std::vector<float> samples;
    for (const Unit& unit : pack.crumpling->units) {
      samples = unit.samples;
      for (float& x : samples) x *= up;
      const fs::path file = make_parent(unit.file);
      if (const auto done = write_clip(file, samples, pack.rate_hz); !done) return failure(file, done.error());
    }
  }
  if (pack.friction) {
    for (const Spectrum& spectrum : pack.friction->spectra) {
      const fs::path file = make_parent(spectrum.file);
      if (const auto done = write_npy(file, spectrum.magnitudes); !done) return failure(file, done.error());
    }
  }
  if (pack.cloth) {
    auto cloth = write_cloth(*pack.cloth, folder);
    if (!cloth) return tl::unexpected(std::move(cloth.error()));
    manifest.cloth = std::move(*cloth);
  }
  std::ofstream stream(folder / kManifestName, std::ios::binary);
  stream << manifest_text(manifest);
  stream.close();
  if (!stream) return failure(folder / kManifestName, "cannot be written");
  return {};
}

}  // namespace

tl::expected<void, PackError> write(const SoundPack& pack, const fs::path& folder) {
  std::error_code failed;
  const fs::path target = fs::absolute(folder, failed).lexically_normal();
  const fs::path whole = target.has_filename() ? target : target.parent_path();
  if (fs::exists(whole, failed) && !fs::exists(whole / kManifestName, failed) && !fs::is_empty(whole, failed)) {
    return tl::unexpected(
        PackError{whole.string(), "", "is there already and is not a sound pack", "choose another folder"});
  }
  const fs::path beside = whole.parent_path() / fmt::format(".{}.{}.partial", whole.filename().string(), ::getpid());
  fs::remove_all(beside, failed);
  if (!fs::create_directories(beside, failed)) {
    return tl::unexpected(PackError{beside.string(), "", fmt::format("cannot be made ({})", failed.message()),
                                    "choose a folder that can be written"});
  }
  auto done = write_files(pack, beside);
  if (done) {
    fs::remove_all(whole, failed);
    fs::rename(beside, whole, failed);
    if (!failed) return {};
    done = tl::unexpected(
        PackError{whole.string(), "", fmt::format("cannot be replaced ({})", failed.message()), "choose another folder"});
  }
  fs::remove_all(beside, failed);
  return done;
}

}  // namespace rustle::pack
