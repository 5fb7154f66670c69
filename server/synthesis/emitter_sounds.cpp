#include "server/synthesis/emitter_sounds.h"

#include <algorithm>

#include "server/synthesis/material.h"
#include "sound_db/dsp/random.h"

namespace rustle::synthesis {

EmitterSounds::EmitterSounds(const RenderOptions& options)
    : sounds_(kMostEmitters),
      added_(kMostEmitters),
      table_(kTable, kFree),
      noise_(options.max_friction_sources, friction_fft_size(options.rate_hz, options.friction_fft_size)) {}

std::size_t EmitterSounds::place_of(std::uint64_t id) const noexcept {
  std::size_t place = dsp::hash(id, 0) % kTable;
  while (table_[place] != kFree && sounds_[table_[place]].id != id) place = (place + 1) % kTable;
  return place;
}

void EmitterSounds::fill_table() noexcept {
  std::ranges::fill(table_, kFree);
  for (std::size_t k = 0; k < count_; ++k) table_[place_of(sounds_[k].id)] = static_cast<std::uint16_t>(k);
}

void EmitterSounds::begin_quantum() noexcept {
  const std::size_t before = count_;
  count_ = 0;
  for (std::size_t k = 0; k < before; ++k) {
    if (sounds_[k].last) continue;
    if (count_ != k) sounds_[count_] = sounds_[k];
    added_[count_++] = 0;
  }
  if (count_ != before) fill_table();
}

void EmitterSounds::end_quantum() noexcept {
  for (std::size_t k = 0; k < count_; ++k) {
    if (added_[k] != 0) continue;
    sounds_[k].last = true;
    sounds_[k].samples.fill(0);
  }
}

float* EmitterSounds::add_to(std::uint64_t id, Bus bus, const spatial::Emitter& emitter) noexcept {
  const std::size_t place = place_of(id);
  if (table_[place] == kFree) {
    if (count_ == kMostEmitters) {
      left_out_ += kQuantum;
      return nullptr;
    }
    table_[place] = static_cast<std::uint16_t>(count_);
    sounds_[count_].id = id;
    sounds_[count_].bus = bus;
    sounds_[count_].last = false;
    added_[count_++] = 0;
  }
  const std::size_t k = table_[place];
  EmitterSound& sound = sounds_[k];
  if (added_[k] == 0) {
    added_[k] = 1;
    sound.position_m = emitter.position_m;
    sound.normal = emitter.normal;
    sound.samples.fill(0);
  }
  return sound.samples.data();
}

}  // namespace rustle::synthesis
