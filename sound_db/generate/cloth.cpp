#include "sound_db/generate/cloth.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"
#include "sound_db/generate/cloth_motion.h"
#include "sound_db/generate/cloth_sound.h"
#include "sound_db/pack/calibration.h"
#include "sound_db/pack/corpus_source.h"
#include "sound_db/pack/sweep_measure.h"

namespace rustle::generate {

namespace {

enum UnitStream : std::uint64_t {
  kCorpusStream = 11,
  kSweepStream = 12,
  kPopStream = 13,
  kTargetStream = 14,
  kNoiseStream = 15
};

std::uint64_t seed_of(const ClothMaterial& material, std::uint64_t seed, std::uint64_t stream) {
  std::uint64_t name = 0;
  for (const char c : material.name) name = name * 131 + static_cast<unsigned char>(c);
  return dsp::hash(seed, stream, name);
}

pack::FrictionSweep measured_sweep(const ClothMaterial& material, const ClothOptions& options) {
  const ClothMotion motion = roller_motion(options.sweep_s);
  const std::vector<float> sound =
      cloth_friction(material, motion, options.rate_hz, dsp::Random(seed_of(material, options.seed, kSweepStream)));
  pack::SweepMeasure measure(options.rate_hz,
                             pack::geometric_speeds(kSlowestCloth_m_per_s, kFastestCloth_m_per_s, options.speeds));
  measure.add(sound, [&](double t) { return motion.speed_at(t); });
  pack::FrictionSweep sweep = measure.sweep();
  sweep.file = "cloth/friction.npy";
  sweep.patch_area_m2 = kClothPatch_m2;
  sweep.speed_threshold_m_per_s = material.speed_threshold_m_per_s;
  return sweep;
}

pack::ClothCrumpling crumpling_units(const ClothMaterial& material, const ClothOptions& options) {
  dsp::Random random(seed_of(material, options.seed, kPopStream));
  pack::ClothCrumpling crumpling;
  std::vector<double> energies;
  for (int i = 0; i < options.pops; ++i) {
    pack::ClothCrumplingUnit unit;
    unit.samples = cloth_pops(material, options.rate_hz, random);
    const auto fade = std::min<std::size_t>(unit.samples.size(), options.rate_hz / 1000);
    for (std::size_t n = 0; n < fade; ++n) {
      unit.samples[unit.samples.size() - 1 - n] *= static_cast<float>(n) / static_cast<float>(fade);
    }
    for (const float x : unit.samples) unit.energy_s += static_cast<double>(x) * x / options.rate_hz;
    crumpling.units.push_back(std::move(unit));
  }
  std::stable_sort(crumpling.units.begin(), crumpling.units.end(),
                   [](const auto& a, const auto& b) { return a.energy_s < b.energy_s; });
  for (std::size_t i = 0; i < crumpling.units.size(); ++i) {
    crumpling.units[i].file = fmt::format("cloth/crumpling_{:03}.flac", i + 1);
    energies.push_back(crumpling.units[i].energy_s);
  }
  crumpling.unit_energies = pack::energy_histogram(energies);
  crumpling.event_amplitudes = pack::usual_event_amplitudes();
  return crumpling;
}

/// A target of another motion than the corpus': what the warp is fitted to.
std::vector<float> calibration_target(const ClothMaterial& material, const pack::ClothCorpus& corpus, std::uint64_t seed) {
  constexpr double kTarget_s = 30;
  dsp::Random random(seed_of(material, seed, kTargetStream));
  const ClothMotion motion = varied_motion(kTarget_s, dsp::Random(random.next()));
  std::vector<pack::PlainEvent> events;
  for (std::size_t step = 0; corpus.crumpling && step < motion.crumpling.size(); ++step) {
    const double activity = motion.crumpling[step];
    if (!(random.uniform() < activity * material.pops_per_s / 3 * motion.step_s)) continue;
    const auto unit = random.index(static_cast<std::uint32_t>(corpus.crumpling->units.size()));
    events.push_back({static_cast<double>(step) * motion.step_s, unit, 0.5 + activity});
  }
  return pack::plain_target(
      corpus, kTarget_s, [&](double t) { return motion.speed_at(t); }, events, seed_of(material, seed, kNoiseStream));
}

}  // namespace

pack::SoundPack make_cloth_pack(const ClothMaterial& material, const ClothOptions& options, const Progress& progress) {
  const auto tell = [&](double share) {
    if (progress) progress(share);
  };
  pack::SoundPack result;
  result.name = fmt::format("{}-on-{}", material.name, material.name);
  result.version = "1.0.0";
  result.material = material.name;
  result.touched_surface = material.name;
  result.grammage_kg_per_m2 = material.grammage_kg_per_m2;
  result.licence = "CC0-1.0";
  result.origin = "generated";
  result.rate_hz = result.stored_rate_hz = options.rate_hz;

  auto corpus = std::make_shared<pack::ClothCorpus>();
  corpus->rate_hz = options.rate_hz;
  corpus->unit_s = 1 / material.units_per_s;
  corpus->wale_spacing_m = material.wale_spacing_m;
  corpus->selection = {{material.filter_widths.begin(), material.filter_widths.end()},
                       material.lambda,
                       material.look_ahead,
                       material.greatest_distance,
                       20};
  corpus->causal.file = "cloth/features_causal.npy";
  corpus->symmetric.file = "cloth/features_symmetric.npy";
  const std::uint64_t seed = seed_of(material, options.seed, kCorpusStream);
  const ClothMotion motion = varied_motion(options.corpus_s, dsp::Random(seed));
  corpus->recordings = pack::source_recordings({cloth_recording(material, motion, options.rate_hz, seed)}, options.rate_hz,
                                               {}, "cloth/source");
  tell(0.6);
  corpus->friction = measured_sweep(material, options);
  if (material.pops_per_s > 0) corpus->crumpling = crumpling_units(material, options);
  tell(0.7);
  pack::measure_units(*corpus);
  tell(0.8);
  const std::vector<std::vector<float>> target = {calibration_target(material, *corpus, options.seed)};
  const pack::TargetFeatures features = pack::target_features(*corpus, target);
  pack::calibrate(*corpus, features, pack::proposed_correspondences(*corpus, features));
  tell(1);
  result.cloth = std::move(corpus);
  return result;
}

}  // namespace rustle::generate
