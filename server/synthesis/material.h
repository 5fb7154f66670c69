#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "sound_db/pack/sound_pack.h"

namespace rustle::synthesis {

/// FFT size of the friction noise: what is asked for, or by default (0) 1024 up to 48 kHz, 2048 above. The hop is half of
/// it. \pre asked is 0 or a power of two, kLeastFrictionFft to kMostFrictionFft
constexpr int friction_fft_size(std::uint32_t rate_hz, int asked = 0) noexcept {
  if (asked != 0) return asked;
  return rate_hz <= 50000 ? 1024 : 2048;
}
inline constexpr int kLeastFrictionFft = 128;
inline constexpr int kMostFrictionFft = 8192;

/// A sound pack made ready for one session rate: its friction spectra as emission (1 m, on the axis) in the session's bins.
/// Construction allocates. [analysis worker]
class Material {
 public:
  /// \pre pack is not null, pack->rate_hz == rate_hz
  Material(std::shared_ptr<const pack::SoundPack> pack, std::uint32_t rate_hz, int friction_fft_size_or_0 = 0);

  const pack::SoundPack& pack() const noexcept { return *pack_; }
  const std::shared_ptr<const pack::SoundPack>& shared() const noexcept { return pack_; }
  /// friction_fft_size(rate) / 2 + 1 magnitudes of one of the pack's spectra; they live as long as this object.
  const float* emission(const pack::Spectrum& spectrum) const noexcept;
  /// What a slip sounds like where friction has this spectrum; lives as long as this object.
  const std::vector<float>& slip(const pack::Spectrum& spectrum) const noexcept;

 private:
  std::shared_ptr<const pack::SoundPack> pack_;
  std::size_t index_of(const pack::Spectrum& spectrum) const noexcept;

  std::vector<std::vector<float>> emissions_;
  std::vector<std::vector<float>> slips_;
};

}  // namespace rustle::synthesis
