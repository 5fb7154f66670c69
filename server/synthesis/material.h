#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "server/synthesis/cloth/prepared_corpus.h"
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
  Material(std::shared_ptr<const pack::SoundPack> pack, std::uint32_t rate_hz, int friction_fft_size_or_0 = 0,
           cloth::Search search = cloth::Search::kCausal);

  const pack::SoundPack& pack() const noexcept { return *pack_; }
  const std::shared_ptr<const pack::SoundPack>& shared() const noexcept { return pack_; }
  /// friction_fft_size(rate) / 2 + 1 magnitudes of one of the pack's spectra; they live as long as this object.
  const float* emission(const pack::Spectrum& spectrum) const noexcept;
  /// What a slip sounds like where friction has this spectrum; lives as long as this object.
  const std::vector<float>& slip(const pack::Spectrum& spectrum) const noexcept;
  /// All of those.
  const std::vector<std::vector<float>>& slips() const noexcept { return slips_; }
  /// Whether it is one of the emissions.
  bool has_emission(const float* emission) const noexcept;
  /// Places of the units that a constrained resonator sounds like, in pack().crumpling; none: the pack has no clacs.
  const std::vector<std::uint32_t>& clacs() const noexcept { return clacs_; }
  /// What a pack of cloth is made of, ready to be played; null: it is not one.
  const std::shared_ptr<const cloth::PreparedCorpus>& corpus() const noexcept { return cloth_; }
  /// Samples of the longest crumpling unit, or of the longest piece of cloth.
  std::int64_t longest_unit() const noexcept;

 private:
  std::shared_ptr<const pack::SoundPack> pack_;
  std::size_t index_of(const pack::Spectrum& spectrum) const noexcept;

  std::shared_ptr<const cloth::PreparedCorpus> cloth_;
  std::vector<std::uint32_t> clacs_;
  std::vector<std::vector<float>> emissions_;
  std::vector<std::vector<float>> slips_;
};

/// The material of a pack, one for all sessions that want the same, while any of them holds it. [any thread]
/// \pre as of Material's constructor
std::shared_ptr<const Material> shared_material(const std::shared_ptr<const pack::SoundPack>& pack, std::uint32_t rate_hz,
                                                int friction_fft_size_or_0 = 0,
                                                cloth::Search search = cloth::Search::kCausal);

}  // namespace rustle::synthesis
