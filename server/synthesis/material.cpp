#include "server/synthesis/material.h"

#include <cassert>
#include <utility>

#include "sound_db/pack/emission.h"

namespace rustle::synthesis {

Material::Material(std::shared_ptr<const pack::SoundPack> pack, std::uint32_t rate_hz) : pack_(std::move(pack)) {
  assert(pack_ && pack_->rate_hz == rate_hz && "a pack is loaded at the session's rate");
  if (!pack_->friction) return;
  const int bins = friction_fft_size(rate_hz) / 2 + 1;
  emissions_.reserve(pack_->friction->spectra.size());
  for (const pack::Spectrum& spectrum : pack_->friction->spectra) {
    emissions_.push_back(pack::emission_spectrum(*pack_->friction, spectrum, bins, rate_hz));
  }
}

const float* Material::emission(const pack::Spectrum& spectrum) const noexcept {
  const auto index = static_cast<std::size_t>(&spectrum - pack_->friction->spectra.data());
  assert(index < emissions_.size());
  return emissions_[index].data();
}

}  // namespace rustle::synthesis
