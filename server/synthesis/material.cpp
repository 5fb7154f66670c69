#include "server/synthesis/material.h"

#include <algorithm>
#include <cassert>
#include <map>
#include <mutex>
#include <tuple>
#include <utility>

#include "server/synthesis/stick_slip.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/query.h"

namespace rustle::synthesis {

Material::Material(std::shared_ptr<const pack::SoundPack> pack, std::uint32_t rate_hz, int friction_fft_size_or_0,
                   cloth::Search search)
    : pack_(std::move(pack)) {
  assert(pack_ && pack_->rate_hz == rate_hz && "a pack is loaded at the session's rate");
  if (pack_->cloth) {
    cloth_ = search == cloth::Search::kCausal ? cloth::prepared(pack_->cloth)
                                              : std::make_shared<const cloth::PreparedCorpus>(pack_->cloth, search);
  }
  if (pack_->crumpling) clacs_ = pack::nearest_variants(*pack_->crumpling, {});
  if (!pack_->friction) return;
  const int bins = friction_fft_size(rate_hz, friction_fft_size_or_0) / 2 + 1;
  emissions_.reserve(pack_->friction->spectra.size());
  slips_.reserve(emissions_.capacity());
  const int slip_bins = friction_fft_size(rate_hz) / 2 + 1;
  for (const pack::Spectrum& spectrum : pack_->friction->spectra) {
    emissions_.push_back(pack::emission_spectrum(*pack_->friction, spectrum, bins, rate_hz));
    const auto slipping = pack::emission_spectrum(*pack_->friction, spectrum, slip_bins, rate_hz);
    slips_.push_back(slip_unit(slipping, rate_hz, slips_.size()));
  }
}

std::size_t Material::index_of(const pack::Spectrum& spectrum) const noexcept {
  const auto index = static_cast<std::size_t>(&spectrum - pack_->friction->spectra.data());
  assert(index < emissions_.size());
  return index;
}

const float* Material::emission(const pack::Spectrum& spectrum) const noexcept {
  return emissions_[index_of(spectrum)].data();
}

bool Material::has_emission(const float* emission) const noexcept {
  return std::any_of(emissions_.begin(), emissions_.end(), [&](const auto& own) { return own.data() == emission; });
}

std::int64_t Material::longest_unit() const noexcept {
  std::size_t longest = cloth_ ? 2 * static_cast<std::size_t>(cloth_->unit_samples()) : 0;
  if (pack_->crumpling) {
    for (const pack::Unit& unit : pack_->crumpling->units) longest = std::max(longest, unit.samples.size());
  }
  return static_cast<std::int64_t>(longest);
}

const std::vector<float>& Material::slip(const pack::Spectrum& spectrum) const noexcept {
  return slips_[index_of(spectrum)];
}

std::shared_ptr<const Material> shared_material(const std::shared_ptr<const pack::SoundPack>& pack, std::uint32_t rate_hz,
                                                int friction_fft_size_or_0, cloth::Search search) {
  using Wanted = std::tuple<const pack::SoundPack*, int, cloth::Search>;
  static std::mutex mutex;
  static std::map<Wanted, std::weak_ptr<const Material>> known;
  const Wanted wanted{pack.get(), friction_fft_size(rate_hz, friction_fft_size_or_0), search};
  const std::lock_guard lock(mutex);
  std::erase_if(known, [](const auto& entry) { return entry.second.expired(); });
  if (const auto found = known.find(wanted); found != known.end()) {
    if (auto held = found->second.lock()) return held;
  }
  auto made = std::make_shared<const Material>(pack, rate_hz, friction_fft_size_or_0, search);
  known[wanted] = made;
  return made;
}

}  // namespace rustle::synthesis
