#include "server/synthesis/mixer.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <tuple>

#include "server/synthesis/denormals.h"
#include "server/synthesis/emitter_sounds.h"
#include "server/synthesis/model_registry.h"

namespace rustle::synthesis {
namespace {

/// Whether the cue can lead to sound by itself.
bool sounds(const Cue& cue) noexcept {
  if (const auto* friction = std::get_if<FrictionCue>(&cue)) return friction->gain > 0;
  if (const auto* tear = std::get_if<TearCue>(&cue)) return tear->speed_m_per_s > 0;
  return std::holds_alternative<CrumpleCue>(cue) || std::holds_alternative<ClothPieceCue>(cue);
}

bool within(const spatial::Vec3& v) noexcept {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

/// Whether the cue fits this mixer.
bool usable(const Cue& cue, int buses) noexcept {
  if (const auto* listener = std::get_if<ListenerCue>(&cue)) {
    return within(listener->listener.position_m) && within(listener->listener.forward) && within(listener->listener.up);
  }
  if (const auto* plane = std::get_if<PlaneCue>(&cue)) {
    return plane->slot < spatial::kMaxPlanes && within(plane->plane.point_m) && within(plane->plane.normal) &&
           std::isfinite(plane->plane.reflection);
  }
  if (const auto* gain = std::get_if<GainCue>(&cue)) return gain->bus < buses && std::isfinite(gain->gain);
  if (const auto* friction = std::get_if<FrictionCue>(&cue)) return friction->bus < buses;
  if (const auto* tear = std::get_if<TearCue>(&cue)) return tear->bus < buses;
  if (const auto* piece = std::get_if<ClothPieceCue>(&cue)) return piece->bus < buses;
  if (const auto* raise = std::get_if<CrumpleRaiseCue>(&cue)) return raise->bus < buses;
  if (const auto* motion = std::get_if<EmitterMotionCue>(&cue)) return motion->bus < buses;
  if (const auto* limit = std::get_if<VoiceLimitCue>(&cue)) return limit->most >= 0;
  return std::get<CrumpleCue>(cue).bus < buses;
}

using Order = std::tuple<SampleTime, std::size_t, int, std::uint64_t, int>;

Order order_of(const Cue& cue) noexcept {
  const SampleTime start = start_of(cue);
  const std::size_t kind = cue.index();
  if (const auto* c = std::get_if<CrumpleCue>(&cue)) return {start, kind, c->bus, c->event, c->resonator};
  if (const auto* c = std::get_if<CrumpleRaiseCue>(&cue)) return {start, kind, c->bus, c->event, 0};
  if (const auto* c = std::get_if<FrictionCue>(&cue)) return {start, kind, c->bus, c->source, 0};
  if (const auto* c = std::get_if<TearCue>(&cue)) return {start, kind, c->bus, c->tip, 0};
  if (const auto* c = std::get_if<ClothPieceCue>(&cue)) return {start, kind, c->bus, c->patch, 0};
  if (const auto* c = std::get_if<PlaneCue>(&cue)) return {start, kind, c->slot, 0, 0};
  if (const auto* c = std::get_if<GainCue>(&cue)) return {start, kind, c->bus, 0, 0};
  if (const auto* c = std::get_if<EmitterMotionCue>(&cue)) return {start, kind, c->bus, 0, 0};
  return {start, kind, 0, 0, 0};
}

}  // namespace

Mixer::Mixer(const RenderOptions& options)
    : options_(options),
      scene_(options.layout),
      gains_(static_cast<std::size_t>(options.buses())),
      sounding_(static_cast<std::size_t>(options.buses())) {
  for (const SoundModel& model : sound_models()) models_.push_back(model.make_render(options));
  waiting_.reserve(kMaxWaitingCues);
  due_.reserve(kMaxWaitingCues);
}

Mixer::~Mixer() = default;

std::size_t Mixer::quantum_size() const noexcept {
  return static_cast<std::size_t>(buses() * channels() * kQuantum);
}

void Mixer::apply(const Cue& cue) noexcept {
  if (waiting_.size() >= kMaxWaitingCues || !usable(cue, buses())) {
    ++dropped_;
    return;
  }
  waiting_.push_back(cue);
  std::visit(
      [&](const auto& c) {
        if constexpr (requires { c.bus; }) told_of_ = std::max(told_of_, std::size_t{c.bus} + 1);
      },
      cue);
  sounds_waiting_ += sounds(cue) ? 1 : 0;
}

void Mixer::act(const Cue& cue, SampleTime quantum_start) noexcept {
  sounds_waiting_ -= sounds(cue) ? 1 : 0;
  if (const auto* gain = std::get_if<GainCue>(&cue)) {
    gains_[gain->bus].next = *gain;
    return;
  }
  for (const auto& model : models_) model->apply(cue, scene_.scene(), quantum_start);
}

void Mixer::act_on_due(SampleTime quantum_start) noexcept {
  due_.clear();
  if (waiting_.empty()) {
    scene_.advance(quantum_start);
    return;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    if (start_of(waiting_[i]) < quantum_start + kQuantum) {
      due_.push_back(waiting_[i]);
    } else {
      if (kept != i) waiting_[kept] = waiting_[i];
      ++kept;
    }
  }
  waiting_.resize(kept);
  // Insertion sort: stable, in place, and cues mostly come in order.
  for (std::size_t i = 1; i < due_.size(); ++i) {
    const Cue cue = due_[i];
    const Order order = order_of(cue);
    std::size_t j = i;
    for (; j > 0 && order < order_of(due_[j - 1]); --j) due_[j] = due_[j - 1];
    due_[j] = cue;
  }
  for (const Cue& cue : due_) {
    if (const auto* listener = std::get_if<ListenerCue>(&cue)) scene_.apply(*listener, quantum_start);
    if (const auto* plane = std::get_if<PlaneCue>(&cue)) scene_.apply(*plane, quantum_start);
  }
  scene_.advance(quantum_start);
  for (const Cue& cue : due_) act(cue, quantum_start);
}

void Mixer::render(SampleTime quantum_start, std::span<float> out, EmitterSounds* emitters) noexcept {
  assert(quantum_start % kQuantum == 0);
  assert(out.size() == quantum_size());
  const FlushDenormals flush_denormals;
  std::fill_n(sounding_.begin(), told_of_, std::uint8_t{0});
  act_on_due(quantum_start);
  const BusSamples samples{out.data(), sounding_.data(), channels(), emitters};
  if (emitters) emitters->begin_quantum();
  for (const auto& model : models_) model->render(scene_.scene(), quantum_start, samples);
  apply_gains(quantum_start, out);
  if (!emitters) return;
  emitters->end_quantum();
  apply_gains(quantum_start, *emitters);
}

void Mixer::fill_factors(std::size_t bus, SampleTime quantum_start, Factors& factors) const noexcept {
  const Ramp<float>& way = gains_[bus].way;
  if (way.end <= quantum_start) {
    factors.fill(way.to);
    return;
  }
  for (int n = 0; n < kQuantum; ++n) {
    const double t = way.progress(quantum_start + n);
    factors[static_cast<std::size_t>(n)] = way.from + static_cast<float>(t * t * (3 - 2 * t)) * (way.to - way.from);
  }
}

void Mixer::apply_gains(SampleTime quantum_start, std::span<float> out) noexcept {
  Factors factors;
  for (std::size_t bus = 0; bus < told_of_; ++bus) {
    BusGain& gain = gains_[bus];
    Ramp<float>& way = gain.way;
    if (gain.next && way.end <= quantum_start) {
      const SampleTime start = std::max(gain.next->start, quantum_start);
      const SampleTime length = std::max<SampleTime>(0, gain.next->end - gain.next->start);
      way = {start, start + length, way.to, gain.next->gain};
      gain.next.reset();
    }
    if (!sounding_[bus] || (way.from == 1 && way.to == 1)) continue;
    fill_factors(bus, quantum_start, factors);
    for (int c = 0; c < channels(); ++c) {
      float* samples = out.data() + (bus * static_cast<std::size_t>(channels()) + static_cast<std::size_t>(c)) * kQuantum;
      for (std::size_t n = 0; n < kQuantum; ++n) samples[n] *= factors[n];
    }
  }
}

void Mixer::apply_gains(SampleTime quantum_start, EmitterSounds& emitters) const noexcept {
  Factors factors;
  for (EmitterSound& sound : emitters.sounds()) {
    fill_factors(sound.bus, quantum_start, factors);
    for (std::size_t n = 0; n < factors.size(); ++n) sound.samples[n] *= factors[n];
  }
}

bool Mixer::silent() const noexcept {
  return sounds_waiting_ == 0 &&
         std::all_of(models_.begin(), models_.end(), [](const auto& model) { return model->silent(); });
}

RenderCounters Mixer::counters() const noexcept {
  RenderCounters counters;
  counters.cues_dropped = dropped_;
  for (const auto& model : models_) model->add_counters(counters);
  return counters;
}

}  // namespace rustle::synthesis
