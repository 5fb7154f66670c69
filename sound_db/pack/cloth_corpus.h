#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sound_db/dsp/thin_plate_spline.h"
#include "sound_db/pack/energy_histogram.h"
#include "sound_db/pack/friction_sweep.h"

/// What cloth's sound is made of (An et al. 2012; method C3, C4, C8): the source recordings that units are taken from, the
/// features that they are found by, the warp from target features to theirs, and the measurements that the target is made
/// of. The "cloth" section of a pack.
namespace rustle::pack {

/// One stretch of sound without a pause, all channels of one moment; units follow one another within it and never across
/// its ends. High-passed (5th-order Butterworth, 100 Hz), pauses cut out.
struct SourceRecording {
  std::string file;
  std::vector<std::vector<float>> channels;  ///< [channels][samples], equally long, at the loaded rate
  std::size_t samples() const noexcept { return channels.empty() ? 0 : channels.front().size(); }
  friend bool operator==(const SourceRecording&, const SourceRecording&) = default;
};

/// Features of all units, filtered over time: columns are dsp::kUnitFeatures of the first channel, then of the second.
struct UnitFeatureSet {
  std::string file;
  std::vector<float> values;  ///< [units][dims], row-major
  std::string warp_file;      ///< empty: the identity
  dsp::ThinPlateSpline warp;  ///< from target features, filtered alike, to these; dsp::warp() evaluates it
  std::span<const float> unit(std::size_t index, std::size_t dims) const noexcept {
    return std::span(values).subspan(index * dims, dims);
  }
  friend bool operator==(const UnitFeatureSet&, const UnitFeatureSet&) = default;
};

/// Parameters of Table 3 and of section 4.4.
struct SelectionParameters {
  std::vector<int> filter_widths = {20, 50, 10};  ///< of each of a channel's features, in units; σ = width/4
  double lambda = 100;                            ///< the warp's regularization, in squared feature units
  int look_ahead = 5;                             ///< L
  double greatest_distance = 2.0;                 ///< d_max
  int cool_off = 20;                              ///< L_c
  friend bool operator==(const SelectionParameters&, const SelectionParameters&) = default;
};

/// A recorded pop.
struct ClothCrumplingUnit {
  std::string file;
  std::vector<float> samples;  ///< mono, at the loaded rate, the manifest's gain applied
  double energy_s = 0;         ///< Σ x² / rate of `samples`
  friend bool operator==(const ClothCrumplingUnit&, const ClothCrumplingUnit&) = default;
};

/// Crumpling: recorded pops, and which of them an event of the sheet takes.
struct ClothCrumpling {
  std::vector<ClothCrumplingUnit> units;  ///< by rising energy
  EnergyHistogram unit_energies;          ///< of `units`
  /// Of a calibration animation: amplitudes Σ A |ΔH| of P2's events, in m. Events below events.least (E_min) are silent.
  EnergyHistogram event_amplitudes;
  friend bool operator==(const ClothCrumpling&, const ClothCrumpling&) = default;
};

/// The unit for an event: histogram matching, then the nearest in log E, ties to the lower index; nothing below E_min or
/// where there are no units. An event without calibration takes the middle unit. Allocates nothing.
std::optional<std::size_t> crumpling_unit_for(const ClothCrumpling& crumpling, double event_amplitude_m) noexcept;

struct ClothCorpus {
  std::uint32_t rate_hz = 48000;  ///< of everything here, as loaded
  double unit_s = 1.0 / 240;      ///< 4.2 ms; corduroy 1/60 s
  int unit_samples = 200;         ///< dsp::unit_length(unit_s, rate_hz)
  int channels = 1;               ///< of every recording; each goes through the whole pipeline
  std::vector<SourceRecording> recordings;
  /// [recordings + 1], from 0: recording r has the units [first_unit[r], first_unit[r + 1]). Unit j of it covers the samples
  /// [(j - first_unit[r]) * unit_samples, + unit_samples); what is left at a recording's end is not a unit, but joins may
  /// reach into it.
  std::vector<std::uint32_t> first_unit = {0};
  SelectionParameters selection;
  UnitFeatureSet causal;     ///< half-Gaussian, the default everywhere
  UnitFeatureSet symmetric;  ///< as published; offline only
  /// Added to what is heard of the units. Samples and features are without it.
  double gain_db = 0;

  FrictionSweep friction;
  std::optional<ClothCrumpling> crumpling;  ///< absent: crumpling is silent (corduroy)
  double wale_spacing_m = 0;                ///< of the ribs that pulse at speed / spacing; 0: none

  std::size_t units() const noexcept { return first_unit.back(); }
  std::size_t dims() const noexcept;
  /// Number of the recording that holds a unit. \pre unit < units()
  std::size_t recording_of(std::size_t unit) const noexcept;
  friend bool operator==(const ClothCorpus&, const ClothCorpus&) = default;
};

/// Fills unit_samples and first_unit from the recordings. \pre as for measure_units
void count_units(ClothCorpus& corpus);

/// count_units, then fills both sets of features from the recordings; the warps stay. Allocates; control side. Costs less
/// than 5 ms per second of recording. \pre rate_hz, unit_s, channels and recordings are set
void measure_units(ClothCorpus& corpus);

}  // namespace rustle::pack
