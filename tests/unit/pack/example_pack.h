#pragma once

#include <stdlib.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numbers>
#include <string>

#include "sound_db/dsp/random.h"
#include "sound_db/pack/sound_pack.h"

namespace rustle::pack {

/// A folder of its own that goes away at the end.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "rustle-test-XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() {
    std::error_code failed;
    std::filesystem::remove_all(path_, failed);
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline std::string read_bytes(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// Overwrites in place: truncating a file and writing it again makes the file system wait for the disk.
inline void write_bytes(const std::filesystem::path& file, const std::string& bytes) {
  if (!std::filesystem::exists(file)) std::ofstream(file, std::ios::binary).flush();
  std::fstream(file, std::ios::binary | std::ios::in | std::ios::out)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  std::filesystem::resize_file(file, bytes.size());
}

/// Two grid points and the constrained one, two variants each: tones that die away, and low-pass noise spectra.
inline SoundPack example_pack(const std::string& extension = ".wav") {
  SoundPack pack;
  pack.name = "example";
  pack.version = "0.1";
  pack.material = "vellum";
  pack.touched_surface = "slate";
  pack.licence = "CC0-1.0";
  pack.origin = "test";
  CrumplingSection crumpling;
  FrictionSection friction;
  friction.geometry = {1.0, 30.0, true, 0.3};
  friction.speed_exponent = 0.75;
  int number = 0;
  for (const GridPoint point : {GridPoint{}, GridPoint{0.05, 0.1}, GridPoint{0.1, 0.2}}) {
    for (int variant = 0; variant < 2; ++variant, ++number) {
      Unit unit{point, "units/" + std::to_string(number) + extension, {}, point.disc_radius_m()};
      for (int n = 0; n < 480; ++n) {
        const double t = n / 48000.0;
        unit.samples.push_back(
            static_cast<float>(0.1 * std::exp(-t * 900) * std::sin(2 * std::numbers::pi * (900 + 700 * number) * t)));
      }
      crumpling.units.push_back(std::move(unit));
    }
    Spectrum spectrum{point, "spectra/" + std::to_string(number) + ".npy", {}, point.disc_radius_m()};
    for (int k = 0; k <= 512; ++k) {
      const double f = k * 46.875;
      spectrum.magnitudes.push_back(static_cast<float>(0.03 / (1 + std::pow(f / (2000.0 * number), 2))));
    }
    friction.spectra.push_back(std::move(spectrum));
  }
  pack.crumpling = std::move(crumpling);
  pack.friction = std::move(friction);
  return pack;
}

}  // namespace rustle::pack
