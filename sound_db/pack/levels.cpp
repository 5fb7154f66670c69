#include "sound_db/pack/levels.h"

#include <cmath>

#include "sound_db/dsp/level.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/query.h"
#include "sound_db/pack/spectra.h"

namespace rustle::pack {

std::optional<double> reference_flap_peak_dbfs(const CrumplingSection& section) {
  const auto variants = nearest_variants(section, kReferencePoint);
  if (variants.empty()) return std::nullopt;
  double sum_db = 0;
  for (const std::uint32_t i : variants) {
    const Unit& unit = section.units[i];
    const double amplitude = section.reference_amplitude_m(kReferencePoint) / section.reference_amplitude_m(unit.point);
    sum_db += dsp::peak_dbfs(unit.samples) + dsp::gain_to_db(amplitude);
  }
  return sum_db / static_cast<double>(variants.size()) + dsp::gain_to_db(emission_gain(section.geometry));
}

std::optional<double> reference_friction_dbfs(const FrictionSection& section) {
  const Spectrum* spectrum = nearest_spectrum(section, kReferencePoint);
  if (!spectrum) return std::nullopt;
  const auto emission = emission_spectrum(section, *spectrum, static_cast<int>(section.fft_size / 2 + 1), section.rate_hz);
  const double speed = std::pow(0.1 / section.reference_speed_m_per_s, section.speed_exponent);
  return dsp::gain_to_db(noise_rms(emission) * speed);
}

}  // namespace rustle::pack
