#include "server/engine/render.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace rustle::engine {
namespace {

using synthesis::kQuantum;

synthesis::RenderOptions render_options(const Options& options) {
  synthesis::RenderOptions out;
  out.mode = options.mode == Mode::kPublished ? synthesis::Mode::kPublished : synthesis::Mode::kCorrected;
  out.rate_hz = static_cast<std::uint32_t>(options.rate_hz);
  out.layout = spatial_layout(options.layout);
  out.hrtf = options.hrtf;
  out.friction_fft_size = options.friction_fft_size;
  out.max_voices = options.max_voices;
  out.max_sheets = options.max_sheets;
  return out;
}

}  // namespace

Render::Render(const Options& options)
    : options_(options),
      channels_(channels_of(options.layout)),
      gain_(static_cast<float>(std::pow(10.0, options.gain_db / 20))),
      mixer_(render_options(options)),
      limiter_(options.rate_hz),
      buses_(mixer_.quantum_size()),
      sum_(static_cast<std::size_t>(channels_) * kQuantum) {
  sheets_.reserve(static_cast<std::size_t>(options.max_sheets));
}

AudioQuantum Render::make_quantum() const {
  AudioQuantum quantum;
  quantum.channels = channels_;
  quantum.mix.resize(sum_.size());
  if (options_.stems) quantum.stems.assign(static_cast<std::size_t>(mixer_.buses()), std::vector<float>(sum_.size()));
  return quantum;
}

std::unique_ptr<synthesis::EmitterSounds> Render::make_emitters() const {
  return std::make_unique<synthesis::EmitterSounds>(render_options(options_));
}

void Render::accept(const CueBatch& batch) noexcept {
  for (const auto& cue : batch.cues) mixer_.apply(cue);
  if (batch.new_sheet && sheets_.size() < sheets_.capacity()) sheets_.push_back(*batch.new_sheet);
  horizon_ = std::max(horizon_, batch.horizon);
  if (batch.end && !ending_) {
    ending_ = true;
    end_ = std::max(horizon_, position_);
  }
}

bool Render::complete() const noexcept {
  if (!ending_ || position_ < end_) return false;
  return mixer_.silent() || position_ - end_ > static_cast<synthesis::SampleTime>(kLongestTail_s * options_.rate_hz);
}

RenderCounters Render::counters() const noexcept {
  return {mixer_.counters(), voices_most_, limiter_.limited(), limiter_.not_finite()};
}

std::optional<synthesis::Bus> Render::bus_of(sheet::SheetId sheet, synthesis::SoundKind kind) const noexcept {
  const auto found = std::find(sheets_.begin(), sheets_.end(), sheet);
  if (found == sheets_.end()) return std::nullopt;
  return synthesis::bus_of(static_cast<int>(found - sheets_.begin()), kind);
}

void Render::stem(synthesis::Bus bus, std::span<float> out) const noexcept {
  const bool sounding = mixer_.sounding(bus);
  const float* samples = buses_.data() + static_cast<std::size_t>(bus) * sum_.size();
  for (int channel = 0; channel < channels_; ++channel) {
    for (int i = 0; i < kQuantum; ++i) {
      out[static_cast<std::size_t>(i * channels_ + channel)] = sounding ? samples[channel * kQuantum + i] : 0.0f;
    }
  }
}

void Render::next(AudioQuantum& out) noexcept {
  mixer_.render(position_, buses_, out.emitters);
  if (out.emitters) {
    for (auto& sound : out.emitters->sounds())
      for (float& x : sound.samples) x *= gain_;
  }
  voices_most_ = std::max(voices_most_, mixer_.counters().voices);
  std::fill(sum_.begin(), sum_.end(), 0.0f);
  const std::size_t bus_size = sum_.size();
  const int buses = options_.stems ? mixer_.buses() : mixer_.buses_told_of();
  for (int bus = 0; bus < buses; ++bus) {
    const bool sounding = mixer_.sounding(static_cast<synthesis::Bus>(bus));
    float* samples = buses_.data() + static_cast<std::size_t>(bus) * bus_size;
    if (sounding) {
      for (std::size_t i = 0; i < bus_size; ++i) {
        samples[i] *= gain_;
        sum_[i] += samples[i];
      }
    }
    if (options_.stems) stem(static_cast<synthesis::Bus>(bus), out.stems[static_cast<std::size_t>(bus)]);
  }
  std::array<float*, 2> planes{sum_.data(), sum_.data() + kQuantum};
  limiter_.process(std::span(planes.data(), static_cast<std::size_t>(channels_)), kQuantum);
  for (int channel = 0; channel < channels_; ++channel) {
    for (int i = 0; i < kQuantum; ++i) {
      out.mix[static_cast<std::size_t>(i * channels_ + channel)] = sum_[static_cast<std::size_t>(channel * kQuantum + i)];
    }
  }
  out.first_sample = position_;
  out.sheets = sheets_;
  position_ += kQuantum;
}

}  // namespace rustle::engine
