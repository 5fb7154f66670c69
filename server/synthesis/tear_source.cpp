#include "server/synthesis/tear_source.h"

#include <algorithm>
#include <cmath>

#include "server/sheet/simd.h"
#include "server/synthesis/source_paths.h"
#include "server/synthesis/tear_colour.h"
#include "server/synthesis/tear_noise.h"

namespace rustle::synthesis {
namespace {

using spatial::Vec3;

constexpr std::uint64_t kNoiseStream = 1, kBreakStream = 2;

Vec3 mixed(const Vec3& a, const Vec3& b, double t) noexcept {
  return t >= 1 ? b : a + t * (b - a);
}

/// out[n] = Σ_j h[j] x[n - j], tap after tap. \pre x has taps samples before its first
RUSTLE_SIMD void convolve(const float* h, std::size_t taps, const float* x, float* out) noexcept {
  std::fill_n(out, kQuantum, 0.0F);
  for (std::size_t j = 0; j < taps; ++j) {
    const float gain = h[j];
    const float* from = x - j;
    for (int n = 0; n < kQuantum; ++n) out[n] += gain * from[n];
  }
}

}  // namespace

TearSource::TearSource(Mode mode, std::uint32_t rate_hz)
    : mode_(mode),
      rate_hz_(rate_hz),
      taps_(static_cast<std::size_t>(tear_colour_taps(rate_hz))),
      colour_from_(taps_),
      excitation_(taps_ + kQuantum),
      past_(SourcePaths::past_samples(rate_hz)) {}

TearSource::Control TearSource::at(SampleTime time) const noexcept {
  const double t = control_.progress(time);
  Control now = control_.to;
  now.speed_m_per_s = std::lerp(control_.from.speed_m_per_s, control_.to.speed_m_per_s, t);
  now.gain = std::lerp(control_.from.gain, control_.to.gain, t);
  now.emitter = emitter(time);
  const double overdue = static_cast<double>(time - control_.end) / rate_hz_ - kTearUnrenewed_s;
  if (overdue > 0) now.speed_m_per_s *= std::max(0.0, 1 - overdue / kTearUnrenewedFade_s);
  return now;
}

spatial::Emitter TearSource::emitter(SampleTime time) const noexcept {
  const double t = control_.progress(time);
  const spatial::Emitter &a = control_.from.emitter, &b = control_.to.emitter;
  spatial::Emitter out = b;
  out.position_m = mixed(a.position_m, b.position_m, t);
  out.normal = t >= 1 ? b.normal : spatial::normalized(mixed(a.normal, b.normal, t), b.normal);
  out.cosine_floor = std::lerp(a.cosine_floor, b.cosine_floor, t);
  return out;
}

void TearSource::begin(const TearCue& cue, SampleTime quantum_start) noexcept {
  active_ = true;
  sounding_ = ends_ = false;
  tip_ = cue.tip;
  bus_ = cue.bus;
  noise_ = dsp::Random(dsp::hash(cue.tip, kNoiseStream));
  gate_ = TearGate(dsp::hash(cue.tip, kBreakStream));
  published_gate_ = PublishedTearGate(dsp::hash(cue.tip, kBreakStream));
  const Control silent{0, static_cast<double>(cue.gain), cue.emitter};
  control_ = {quantum_start, quantum_start, silent, silent};
  colour_to_ = cue.colour;
  std::ranges::fill(excitation_, 0.0F);
  past_.clear();
  heard_until_ = quantum_start;
}

void TearSource::apply(const TearCue& cue, SampleTime quantum_start) noexcept {
  const Control now = at(quantum_start);
  const Control goal{std::clamp(static_cast<double>(cue.speed_m_per_s), 0.0, kMostTearSpeed_m_per_s),
                     std::max(0.0, static_cast<double>(cue.gain)), cue.emitter};
  if (colour_to_ && cue.colour) {
    const auto t = static_cast<float>(control_.progress(quantum_start));
    for (std::size_t j = 0; j < taps_; ++j) colour_from_[j] = std::lerp(colour_from_[j], colour_to_[j], t);
  }
  colour_to_ = cue.colour;
  control_ = {std::max(cue.start, quantum_start), std::max(cue.end, quantum_start), now, goal};
  ends_ = cue.ends;
  if (goal.speed_m_per_s > 0) sounding_ = true;
}

double TearSource::advance(double step_m) noexcept {
  return mode_ == Mode::kPublished ? published_gate_.advance(step_m) : gate_.advance(step_m);
}

void TearSource::excite(SampleTime quantum_start, std::span<float, kQuantum> out) noexcept {
  const Control first = at(quantum_start), last = at(quantum_start + kQuantum);
  if (first.speed_m_per_s == 0 && last.speed_m_per_s == 0) {
    std::ranges::fill(out, 0.0F);
    return;
  }
  for (std::size_t n = 0; n < out.size(); ++n) {
    const double t = static_cast<double>(n) / kQuantum;
    const double speed = std::lerp(first.speed_m_per_s, last.speed_m_per_s, t), gain = std::lerp(first.gain, last.gain, t);
    const double gate = advance(speed / rate_hz_);
    out[n] = static_cast<float>(gain * speed / kReferenceTearSpeed_m_per_s * gate * noise_.normal());
  }
  heard_until_ = quantum_start + kQuantum + static_cast<SampleTime>(taps_);
}

void TearSource::colour(SampleTime quantum_start, std::span<float> sound) noexcept {
  const float* x = excitation_.data() + taps_;
  if (!colour_to_) {
    std::copy_n(x, kQuantum, sound.begin());
    return;
  }
  convolve(colour_to_, taps_, x, sound.data());
  if (control_.progress(quantum_start) >= 1) return;
  std::array<float, kQuantum> before;
  convolve(colour_from_.data(), taps_, x, before.data());
  for (std::size_t n = 0; n < sound.size(); ++n) {
    const auto t = static_cast<float>(control_.progress(quantum_start + static_cast<SampleTime>(n)));
    sound[n] = std::lerp(before[n], sound[n], t);
  }
}

void TearSource::make(SampleTime quantum_start) noexcept {
  const std::span<float> here = past_.quantum(quantum_start);
  const bool still = quantum_start >= heard_until_ && at(quantum_start).speed_m_per_s == 0 &&
                     at(quantum_start + kQuantum).speed_m_per_s == 0;
  if (still) {
    std::ranges::fill(here, 0.0F);
  } else {
    std::copy(excitation_.begin() + kQuantum, excitation_.end(), excitation_.begin());
    excite(quantum_start, std::span(excitation_).subspan(taps_).first<kQuantum>());
    colour(quantum_start, here);
  }
  const bool over = quantum_start >= heard_until_ + past_.reach();
  const bool rests = control_.to.speed_m_per_s == 0 && quantum_start >= control_.end;
  const double unrenewed_s = static_cast<double>(quantum_start - control_.end) / rate_hz_;
  const bool unrenewed = unrenewed_s > kTearUnrenewed_s + kTearUnrenewedFade_s;
  sounding_ = !over || !(rests || unrenewed);
  if (over && (unrenewed || (rests && ends_))) active_ = false;
}

}  // namespace rustle::synthesis
