#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "sound_db/dsp/thin_plate_spline.h"
#include "sound_db/pack/cloth_corpus.h"

/// Fitting the warp from target features to a corpus' (An et al. 2012, 4.3; C4).
namespace rustle::pack {

/// An interval of the target and one of the corpus that shall sound like it, unit by unit in their order.
struct Correspondence {
  double target_s = 0;    ///< t_k, from the target's start
  double database_s = 0;  ///< d_k, in the corpus: its recordings' whole units one after another
  double length_s = 0.1;  ///< Δ_k; 0.1 to 0.2 are usual
  friend bool operator==(const Correspondence&, const Correspondence&) = default;
};

/// A target signal's features, filtered in both ways as the corpus' are.
struct TargetFeatures {
  std::size_t units = 0, dims = 0;
  std::vector<float> causal, symmetric;  ///< [units][dims]
};

/// Features of a target of as many channels as the corpus has, at its rate. Allocates.
/// \pre channels are corpus.channels and equally long
TargetFeatures target_features(const ClothCorpus& corpus, std::span<const std::vector<float>> channels);

/// The intervals in units: the same number on both sides, cut where either ends.
struct UnitInterval {
  std::size_t target = 0, database = 0, count = 0;
};
/// count is 0 where nothing is left.
UnitInterval units_of(const Correspondence& correspondence, const ClothCorpus& corpus, std::size_t target_units) noexcept;

/// How well one correspondence is met, in feature distance; RMS over its units.
struct CorrespondenceResidual {
  double before = 0;  ///< ‖f - g‖
  double after = 0;   ///< ‖W(f) - g‖
  std::size_t units = 0;
};

struct WarpFit {
  dsp::ThinPlateSpline warp;
  std::vector<CorrespondenceResidual> residuals;  ///< of each correspondence
};

/// The warp of one feature set that minimises eq. 7 with the corpus' λ. Without any unit in the intervals the identity.
WarpFit fit_warp(const ClothCorpus& corpus, std::span<const float> target, std::span<const float> database,
                 std::span<const Correspondence> correspondences);

/// Proposed correspondences: clips of `length_s` at equal ranks of loudness among those that sound on both sides, in the
/// corpus one whose other features stand in the same place of their distribution; the quietest first. The steadier are
/// preferred. On causal features. Fewer where either side is short. Where λ is 0 a clip's middle unit stands for it: its
/// units differ by chance, and a warp that met them all would magnify what is between them.
/// The paper's future work; 14 of 0.125 s for units of 1/240 s are what its cotton was given.
std::vector<Correspondence> proposed_correspondences(const ClothCorpus& corpus, const TargetFeatures& target, int count = 13,
                                                     double length_s = 0.1);

/// Fits both warps of a corpus. Returns the residuals of the causal set.
std::vector<CorrespondenceResidual> calibrate(ClothCorpus& corpus, const TargetFeatures& target,
                                              std::span<const Correspondence> correspondences);

/// What calibration plays when there is no target of an animation: sliding at `speed_at` (m/s) over one patch, blocks of
/// random phases with a sine window (C1), and crumpling at `events`, each unit started whole. At the corpus' rate, mono.
/// The same seed gives the same bits. Allocates.
struct PlainEvent {
  double time_s = 0;
  std::size_t unit = 0;  ///< of corpus.crumpling
  double gain = 1;
};
std::vector<float> plain_target(const ClothCorpus& corpus, double duration_s, const std::function<double(double)>& speed_at,
                                std::span<const PlainEvent> events, std::uint64_t seed);

/// 30 s of it: strokes over the measured speeds with rests between, and bursts of crumpling units of all energies.
std::vector<float> plain_calibration_target(const ClothCorpus& corpus, std::uint64_t seed);

/// Crumpling events of cloth that is waved, dropped and dragged, for packs that were not calibrated: amplitudes Σ A |ΔH|
/// (P2) from 4 mm, below which half of the events lie, to 0.4 m, a power law of exponent 1.6.
EnergyHistogram usual_event_amplitudes();

}  // namespace rustle::pack
