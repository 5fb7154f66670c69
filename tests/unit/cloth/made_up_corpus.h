#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/random.h"
#include "sound_db/pack/calibration.h"
#include "sound_db/pack/cloth_corpus.h"
#include "sound_db/pack/spectra.h"

/// A corpus made up for the tests of cloth, in milliseconds.
namespace rustle::cloth::made_up {

/// Low-passed noise that swells and fades without a rhythm, some 40 dB.
inline std::vector<float> rustling(double seconds, double level, std::uint64_t seed, double rate_hz = 48000) {
  dsp::Random random(seed);
  std::vector<float> out(static_cast<std::size_t>(seconds * rate_hz));
  double swell = 0;
  for (std::size_t n = 0; n < out.size(); ++n) {
    if (n % 480 == 0) swell = 0.93 * swell + 0.55 * random.normal();
    out[n] = static_cast<float>(level * std::exp(swell) * random.normal());
  }
  for (const auto& filter : {dsp::butterworth_lowpass(3, 3000, rate_hz), dsp::butterworth_highpass(5, 100, rate_hz)}) {
    dsp::CascadeState state;
    dsp::filter(filter, state, out);
  }
  return out;
}

struct CorpusOptions {
  int channels = 1;
  double seconds = 6;
  double units_per_s = 240;
  int look_ahead = 5;
  bool crumples = true;
  double speed_threshold_m_per_s = 0;
  pack::SpeedCompression compression = {};
  std::uint64_t seed = 1;
};

/// Friction that is brown and louder with speed, pops of 10 ms, a warp fitted to plain calibration.
inline std::shared_ptr<const pack::ClothCorpus> corpus(const CorpusOptions& options = {}) {
  auto made = std::make_shared<pack::ClothCorpus>();
  made->channels = options.channels;
  made->unit_s = 1 / options.units_per_s;
  made->selection.look_ahead = options.look_ahead;
  for (std::uint64_t r = 0; r < 2; ++r) {
    pack::SourceRecording recording;
    recording.file = "source_" + std::to_string(r);
    for (int c = 0; c < options.channels; ++c)
      recording.channels.push_back(
          rustling(options.seconds / 2, 0.05, options.seed + 10 * r + static_cast<std::uint64_t>(100 * c)));
    made->recordings.push_back(recording);
  }
  made->friction.speeds_m_per_s = {0.1, 0.4, 1.0};
  made->friction.speed_threshold_m_per_s = options.speed_threshold_m_per_s;
  made->friction.compression = options.compression;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < made->friction.bins(); ++k) {
      made->friction.magnitudes.push_back(
          static_cast<float>(0.02 * static_cast<double>(i + 1) /
                             (1 + std::pow(static_cast<double>(k) / (60.0 + 60.0 * static_cast<double>(i)), 2))));
    }
    made->friction.rms.push_back(pack::noise_rms(made->friction.spectrum(i)));
  }
  if (options.crumples) {
    made->crumpling.emplace();
    std::vector<double> energies;
    for (int i = 0; i < 4; ++i) {
      pack::ClothCrumplingUnit unit{"pop_" + std::to_string(i), rustling(0.01, 0.02 * std::pow(2.0, i), 40), 0};
      for (const float x : unit.samples) unit.energy_s += static_cast<double>(x) * x / 48000;
      energies.push_back(unit.energy_s);
      made->crumpling->units.push_back(unit);
    }
    made->crumpling->unit_energies = pack::energy_histogram(energies);
    made->crumpling->event_amplitudes = {0.01, 1, {4, 3, 2, 1}};
  }
  pack::measure_units(*made);
  const auto target = pack::plain_calibration_target(*made, options.seed);
  const std::vector<std::vector<float>> targets(static_cast<std::size_t>(options.channels), target);
  const auto features = pack::target_features(*made, targets);
  pack::calibrate(*made, features, pack::proposed_correspondences(*made, features));
  return made;
}

}  // namespace rustle::cloth::made_up
