#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

/// Sound packs: a folder of `pack.json`, WAV/FLAC units and `.npy` spectra that a sound designer can open, listen to and
/// replace. A pack is for one sheet material and one touched surface (P6). Packs of paper have crumpling and friction, packs
/// of cloth have cloth.
namespace rustle::pack {

struct ClothCorpus;

/// Where a section's sounds were recorded: a sheet at the origin, seen from `distance_m` at `elevation_deg` above the
/// plane it lies on, or along its normal when there is no plane.
struct RecordingGeometry {
  double distance_m = 1.0;
  double elevation_deg = 90.0;  ///< of the microphone above the plane; 90: on the sheet's axis
  bool plane = false;           ///< a reflecting plane under the sheet
  double compression = 0.0;     ///< of the bent edges: how high the sheet stands above the plane
  friend bool operator==(const RecordingGeometry&, const RecordingGeometry&) = default;
};

/// A place in the grid. (0,0): the constrained sounds, clac and flat friction.
struct GridPoint {
  double ruling_length_m = 0;       ///< l_r
  double free_border_length_m = 0;  ///< l_c = twice the edge the paper cut
  bool constrained() const { return ruling_length_m <= 0 || free_border_length_m <= 0; }
  /// Radius of the disc of the sheet's area, a = √(l_r (l_c/2) / π); 0 when constrained.
  double disc_radius_m() const;
  friend bool operator==(const GridPoint&, const GridPoint&) = default;
};

/// One crumpling unit: a clip played whole (P9).
struct Unit {
  GridPoint point;
  std::string file;
  std::vector<float> samples;  ///< mono, at the pack's loaded rate, the manifest's gain applied
  double radius_m = 0;         ///< a_ref of the size factor (a/a_ref)³ (P10); 0: constrained
  friend bool operator==(const Unit&, const Unit&) = default;
};

/// One friction spectrum: amplitude per bin, as heard at the recording geometry at the reference speed (P8). A signal of
/// magnitude M has the one-sided power density 2 M² / rate per Hz, at every FFT size: the same sound at another rate has
/// magnitudes √(rate'/rate) as large.
struct Spectrum {
  GridPoint point;
  std::string file;
  std::vector<float> magnitudes;  ///< [bins]: bin k is k * rate / (2 (bins-1)); white noise of unit variance per sample has
                                  ///< magnitude 1 in every bin
  double radius_m = 0;            ///< a_ref of the size factor (P10); 0: flat
  friend bool operator==(const Spectrum&, const Spectrum&) = default;
};

struct CrumplingSection {
  RecordingGeometry geometry;
  double reference_compression = 0.10;
  std::vector<Unit> units;
  /// Event amplitude (P2, metres) that the units of a grid point were made for: Σ A |ΔH| of a bent l_r x l_c/2 sheet turned
  /// over.
  double reference_amplitude_m(const GridPoint& point) const;
  /// Amplitude that a clac (constrained unit) was made for.
  double constrained_reference_amplitude_m = 0.001;
  friend bool operator==(const CrumplingSection&, const CrumplingSection&) = default;
};

struct FrictionSection {
  RecordingGeometry geometry;
  double reference_speed_m_per_s = 0.1;
  double speed_exponent = 1.0;
  std::uint32_t fft_size = 1024;  ///< of the spectra as loaded: they have fft_size / 2 + 1 bins
  double gain_sigma = 0.35;       ///< slow random gain: standard deviation of its logarithm (0: none)
  double gain_cutoff_hz = 80.0;
  std::vector<Spectrum> spectra;
  std::uint32_t rate_hz = 48000;  ///< of the spectra as loaded: their last bin lies at half of it
  friend bool operator==(const FrictionSection&, const FrictionSection&) = default;
};

inline constexpr double kDefaultGrammage_kg_per_m2 = 0.080;  ///< printer paper's: of a pack that names none

struct SoundPack {
  std::string name;
  std::string version;
  std::string material;                                    ///< "printer-paper"
  std::string touched_surface;                             ///< "wooden-table"
  double grammage_kg_per_m2 = kDefaultGrammage_kg_per_m2;  ///< of the material: heavier sheets tear louder (T6)
  std::string licence;
  std::string origin;             ///< "generated" or who recorded it
  std::uint32_t rate_hz = 48000;  ///< of the units as loaded
  std::uint32_t stored_rate_hz = 48000;
  std::optional<CrumplingSection> crumpling;
  std::optional<FrictionSection> friction;
  std::shared_ptr<const ClothCorpus> cloth;  ///< cloth_corpus.h; null: not a pack of cloth
  std::filesystem::path folder;              ///< where it was loaded from
  std::vector<std::string> notices;          ///< sections and fields that this version does not know and left alone
  /// Also by what the corpus holds.
  friend bool operator==(const SoundPack& a, const SoundPack& b);
};

}  // namespace rustle::pack
