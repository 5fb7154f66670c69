#include "server/synthesis/dense_bursts.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "sound_db/dsp/random.h"

namespace rustle::synthesis {
namespace {

constexpr SampleTime kMostSamples = SampleTime{1} << 52;
constexpr std::size_t kKept = 1;  // of a slot as they are, beside the one that sounds for the rest

/// Whether a CrumpleRaiseCue may still come for it: the ids of fine events have the highest bit set.
bool may_grow(std::uint64_t event) {
  return event >> 63 == 0;
}

}  // namespace

std::int64_t slot_of(SampleTime sample, std::uint32_t rate_hz) noexcept {
  const std::int64_t scaled = std::clamp(sample, -kMostSamples, kMostSamples) * kSlots_per_s;
  const std::int64_t slot = scaled / rate_hz;
  return scaled % rate_hz < 0 ? slot - 1 : slot;
}

SampleTime first_sample_of(std::int64_t slot, std::uint32_t rate_hz) noexcept {
  const std::int64_t scaled = slot * rate_hz;
  const std::int64_t sample = scaled / kSlots_per_s;
  return scaled % kSlots_per_s > 0 ? sample + 1 : sample;
}

std::int64_t DenseBursts::slot_at(SampleTime sample) const noexcept {
  const std::int64_t slot = slot_of(sample, options_.rate_hz);
  return slot >= 0 ? slot / joined_ : -((joined_ - 1 - slot) / joined_);
}

SampleTime DenseBursts::first_sample_at(std::int64_t slot) const noexcept {
  return first_sample_of(slot * joined_, options_.rate_hz);
}

SampleTime DenseBursts::whole_slots(SampleTime until) const noexcept {
  if (options_.mode == Mode::kPublished || until >= kMostSamples || until <= -kMostSamples) return until;
  return first_sample_at(slot_at(until + kQuantum - 1) + 1) - kQuantum;
}

void DenseBursts::merge(std::vector<Cue>& cues, std::size_t first) {
  if (options_.mode == Mode::kPublished || cues.size() - first <= kKept + 1) return;
  members_.clear();
  for (std::size_t i = first; i < cues.size(); ++i) {
    const auto* cue = std::get_if<CrumpleCue>(&cues[i]);
    if (cue == nullptr) continue;
    const auto gain = static_cast<double>(cue->gain);
    const double energy = gain * gain * loudness_.of(cue->unit, cue->unit_samples).energy;
    members_.push_back({slot_at(cue->onset), cue->bus, cue->event, energy});
  }
  const auto key = [](const Member& m) { return std::tuple(m.slot, m.bus, m.event); };
  std::stable_sort(members_.begin(), members_.end(), [&](const Member& a, const Member& b) { return key(a) < key(b); });
  std::size_t events = 0;  // the units of an event go together
  for (std::size_t i = 0; i < members_.size(); ++i) {
    if (events > 0 && key(members_[events - 1]) == key(members_[i])) {
      members_[events - 1].energy += members_[i].energy;
    } else {
      members_[events++] = members_[i];
    }
  }
  members_.resize(events);
  factors_.assign(events, 1.0F);
  bool changes = false;
  for (std::size_t from = 0, to = 0; from < events; from = to) {
    while (to < events && members_[to].slot == members_[from].slot && members_[to].bus == members_[from].bus) ++to;
    if (to - from > kKept + 1) merge_slot(from, to), changes = true;
  }
  if (!changes) return;
  std::size_t kept = first;
  for (std::size_t i = first; i < cues.size(); ++i) {
    if (auto* cue = std::get_if<CrumpleCue>(&cues[i])) {
      const Member wanted{slot_at(cue->onset), cue->bus, cue->event, 0};
      const auto found = std::lower_bound(members_.begin(), members_.end(), wanted,
                                          [&](const Member& a, const Member& b) { return key(a) < key(b); });
      const float factor = factors_[static_cast<std::size_t>(found - members_.begin())];
      if (factor == 0) {
        ++merged_;
        continue;
      }
      cue->gain *= factor;
    }
    if (kept != i) cues[kept] = cues[i];
    ++kept;
  }
  cues.erase(cues.begin() + static_cast<std::ptrdiff_t>(kept), cues.end());
}

void DenseBursts::merge_slot(std::size_t from, std::size_t to) {
  std::size_t strongest = from;
  double total = 0;
  for (std::size_t i = from; i < to; ++i) {
    total += members_[i].energy;
    if (members_[i].energy > members_[strongest].energy) strongest = i;
  }
  total -= members_[strongest].energy;
  const Member& any = members_[from];
  const double draw = total * dsp::to_uniform(dsp::hash(options_.seed, static_cast<std::uint64_t>(any.slot), any.bus));
  std::size_t sounding = to;
  double passed = 0;
  bool remembered = false;
  for (std::size_t i = from; i < to; ++i) {
    if (i == strongest) continue;
    factors_[i] = 0;
    remembered = remembered || may_grow(members_[i].event);
    const bool reached = sounding != to && passed > draw;
    passed += members_[i].energy;
    if (!reached && members_[i].energy > 0) sounding = i;
  }
  if (sounding == to) return;  // nothing but silence beside the strongest
  const Member& one = members_[sounding];
  factors_[sounding] = static_cast<float>(std::sqrt(total / one.energy));
  if (!remembered) return;
  mergers_[next_merger_] = {one.event, total, first_sample_at(one.slot)};
  for (std::size_t i = from; i < to; ++i) {
    if (i != strongest && may_grow(members_[i].event)) {
      merged_events_[{members_[i].bus, members_[i].event}] = {next_merger_, members_[i].energy};
    }
  }
  ++next_merger_;
}

void DenseBursts::redirect_raises(std::vector<Cue>& cues, std::size_t first) {
  if (merged_events_.empty()) return;
  for (std::size_t i = first; i < cues.size(); ++i) {
    auto* raise = std::get_if<CrumpleRaiseCue>(&cues[i]);
    if (raise == nullptr) continue;
    const auto merged = merged_events_.find({raise->bus, raise->event});
    if (merged == merged_events_.end()) continue;
    Merger& merger = mergers_.at(merged->second.merger);
    const double power = static_cast<double>(raise->factor) * static_cast<double>(raise->factor);
    const double before = merger.energy;
    merger.energy += merged->second.energy * (power - 1);
    merged->second.energy *= power;
    raise->event = merger.sounding;
    raise->factor = static_cast<float>(std::sqrt(merger.energy / before));
  }
}

void DenseBursts::forget(SampleTime now) {
  if (mergers_.empty()) return;
  const SampleTime old = now - options_.rate_hz;
  std::erase_if(mergers_, [&](const auto& item) { return item.second.onset < old; });
  std::erase_if(merged_events_, [&](const auto& item) { return !mergers_.contains(item.second.merger); });
}

}  // namespace rustle::synthesis
