#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "sound_db/pack/sound_pack.h"

namespace rustle::synthesis {

/// FFT size of the friction noise: 1024 up to 48 kHz, 2048 above. The hop is half of it.
constexpr int friction_fft_size(std::uint32_t rate_hz) noexcept {
  return rate_hz <= 50000 ? 1024 : 2048;
}

/// A sound pack made ready for one session rate: its friction spectra as emission (1 m, on the axis) in the session's bins.
/// Construction allocates. [analysis worker]
class Material {
 public:
  /// \pre pack is not null, pack->rate_hz == rate_hz
  Material(std::shared_ptr<const pack::SoundPack> pack, std::uint32_t rate_hz);

  const pack::SoundPack& pack() const noexcept { return *pack_; }
  const std::shared_ptr<const pack::SoundPack>& shared() const noexcept { return pack_; }
  /// friction_fft_size(rate) / 2 + 1 magnitudes of one of the pack's spectra; they live as long as this object.
  const float* emission(const pack::Spectrum& spectrum) const noexcept;

 private:
  std::shared_ptr<const pack::SoundPack> pack_;
  std::vector<std::vector<float>> emissions_;
};

}  // namespace rustle::synthesis
