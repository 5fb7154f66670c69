#include "sound_db/generate/cloth_sound.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/window.h"

namespace rustle::generate {

namespace {

using std::numbers::pi;

constexpr int kBlock = 512;
constexpr double kReferenceSpeed_m_per_s = 0.5;
constexpr double kRoomLevel = 3e-5;

enum ClothStream : std::uint64_t { kFrictionStream = 1, kCrumplingStream = 2, kRoomStream = 3 };

/// A random walk that returns to 0: unit variance, correlated over `memory_s`.
class Wandering {
 public:
  Wandering(double step_s, double memory_s, dsp::Random random) : keep_(std::exp(-step_s / memory_s)), random_(random) {
    value_ = random_.normal();
  }
  double next() { return value_ = keep_ * value_ + std::sqrt(1 - keep_ * keep_) * random_.normal(); }

 private:
  double keep_;
  dsp::Random random_;
  double value_ = 0;
};

/// How friction's spectrum differs from its mean for a moment.
struct Colouring {
  double shift_octaves = 0, tilt_db = 0, balance_db = 0;
};

/// Amplitude per bin of friction at a speed; the block it makes has an RMS of material.level · (speed / 0.5)^exponent.
class BandSpectrum {
 public:
  BandSpectrum(const ClothMaterial& material, double rate_hz) : material_(material) {
    for (int k = 0; k <= kBlock / 2; ++k) {
      const double octave = std::log2(std::max(20.0, k * rate_hz / kBlock));
      octaves_.push_back(octave);
      soft_.push_back(gaussian(octave, std::log2(1800.0), 1.8));
      tilts_.push_back(std::clamp((octave - 10) / 3, -1.0, 1.5));
    }
    normalise(soft_);
    power_.resize(octaves_.size());
    band_.resize(octaves_.size());
  }

  void operator()(double speed_m_per_s, const Colouring& colouring, std::span<float> amplitudes) {
    const double ratio = speed_m_per_s / kReferenceSpeed_m_per_s;
    for (std::size_t k = 0; k < power_.size(); ++k) power_[k] = material_.floor * soft_[k];
    double gain = 1;
    for (const ClothBand& band : material_.bands) {
      const double centre = std::log2(band.centre_hz) + band.speed_exponent * std::log2(ratio) + colouring.shift_octaves;
      for (std::size_t k = 0; k < band_.size(); ++k) band_[k] = gaussian(octaves_[k], centre, band.width_octaves);
      normalise(band_);
      for (std::size_t k = 0; k < band_.size(); ++k) power_[k] += gain * (1 - material_.floor) * band.share * band_[k];
      gain = std::pow(10.0, colouring.balance_db / 10);
    }
    double sum = 0;
    for (std::size_t k = 0; k < power_.size(); ++k) sum += power_[k] *= std::pow(10.0, colouring.tilt_db / 10 * tilts_[k]);
    sum -= power_.front() + power_.back();
    power_.front() = power_.back() = 0;
    const double rms = material_.level * std::pow(ratio, material_.level_exponent);
    const double scale = rms * kBlock / std::sqrt(2 * sum);
    for (std::size_t k = 0; k < power_.size(); ++k) amplitudes[k] = static_cast<float>(scale * std::sqrt(power_[k]));
  }

 private:
  static double gaussian(double x, double centre, double width) {
    const double z = (x - centre) / width;
    return std::exp(-0.5 * z * z);
  }
  static void normalise(std::vector<double>& values) {
    double sum = 0;
    for (const double v : values) sum += v;
    for (double& v : values) v /= sum;
  }

  const ClothMaterial& material_;
  std::vector<double> octaves_, soft_, tilts_, power_, band_;
};

/// Loudness of the friction as a rib passes, at phase [0, 1) of it: a quick rise, then a fall. Mean square about 1.
double rib_gate(double phase) {
  constexpr double kRise = 40, kFall = 4.5;
  static const double rms = [] {
    double sum = 0;
    for (int i = 0; i < 1000; ++i) {
      const double x = (i + 0.5) / 1000, g = std::exp(-x * kFall) * (1 - std::exp(-x * kRise));
      sum += g * g / 1000;
    }
    return std::sqrt(sum);
  }();
  return std::exp(-phase * kFall) * (1 - std::exp(-phase * kRise)) / rms;
}

/// Ribs: the noise pulses as each passes, irregular in time and strength, and clicks.
void add_ribs(const ClothMaterial& material, const ClothMotion& motion, double rate_hz, dsp::Random random,
              std::vector<float>& sound) {
  const double ring_s = 0.0006, ring_hz = 1900;
  std::vector<double> click;
  for (int n = 0; n < static_cast<int>(0.004 * rate_hz); ++n) {
    const double t = n / rate_hz;
    click.push_back(std::exp(-t / ring_s) * std::sin(2 * pi * ring_hz * t));
  }
  std::vector<float> clicks(sound.size(), 0.0F);
  const auto drawn_offset = [&] { return 0.06 * random.normal(); };
  const auto drawn_strength = [&] { return std::exp(0.25 * random.normal()); };
  double place = 0, from = drawn_offset(), to = drawn_offset(), strength = drawn_strength();
  std::int64_t rib = 0, clicked = 0;
  for (std::size_t n = 0; n < sound.size(); ++n) {
    const double speed = motion.speed_at(static_cast<double>(n) / rate_hz);
    place += speed / rate_hz / material.wale_spacing_m;
    for (; rib < static_cast<std::int64_t>(place); ++rib) {
      from = to;
      to = drawn_offset();
      strength = drawn_strength();
    }
    const double at = place + from + (to - from) * (place - static_cast<double>(rib));
    const double whole = std::floor(at);
    sound[n] = static_cast<float>(0.85 * sound[n] * rib_gate(at - whole) * strength);
    if (static_cast<std::int64_t>(whole) > clicked) {
      clicked = static_cast<std::int64_t>(whole);
      const double gain = 0.5 / 0.35 * material.level * strength *
                          std::pow(std::max(speed, 1e-3) / kReferenceSpeed_m_per_s, material.level_exponent);
      for (std::size_t i = 0; i < click.size() && n + i < clicks.size(); ++i)
        clicks[n + i] += static_cast<float>(gain * click[i]);
    }
  }
  for (std::size_t n = 0; n < sound.size(); ++n) sound[n] += clicks[n];
}

/// A pop of a size in [0, 1]: noise through one resonance, dying away; the larger the longer and the lower. Peak 1.
std::vector<double> pop(const ClothMaterial& material, double size, double rate_hz, dsp::Random& random) {
  const double place = std::clamp(0.75 - 0.6 * size + 0.25 * random.normal(), 0.0, 1.0);
  const double centre_hz = material.pop_low_hz * std::pow(material.pop_high_hz / material.pop_low_hz, place);
  const double decay_s =
      1e-3 * (material.pop_short_ms + (material.pop_long_ms - material.pop_short_ms) * std::pow(size, 1.5));
  const double radius = std::exp(-pi * centre_hz / rate_hz / 1.6);
  const double a1 = -2 * radius * std::cos(2 * pi * centre_hz / rate_hz), a2 = radius * radius;
  std::vector<double> out(static_cast<std::size_t>(8 * decay_s * rate_hz) + 1);
  double x1 = 0, x2 = 0, y1 = 0, y2 = 0, peak = 1e-12;
  for (std::size_t n = 0; n < out.size(); ++n) {
    const double t = static_cast<double>(n) / rate_hz;
    const double x = random.normal() * std::exp(-t / decay_s) * (1 - std::exp(-t / 4e-5));
    const double y = x - x2 - a1 * y1 - a2 * y2;
    x2 = x1;
    x1 = x;
    y2 = y1;
    y1 = y;
    out[n] = y;
    peak = std::max(peak, std::abs(y));
  }
  for (double& y : out) y /= peak;
  return out;
}

}  // namespace

std::vector<float> cloth_friction(const ClothMaterial& material, const ClothMotion& motion, double rate_hz,
                                  dsp::Random random) {
  constexpr int kHop = kBlock / 2;
  const auto count = static_cast<std::size_t>(motion.duration_s() * rate_hz);
  std::vector<float> out(count + kBlock), window(kBlock), amplitudes(kBlock / 2 + 1);
  dsp::sine_window(window);
  dsp::RealFft fft(kBlock);
  BandSpectrum spectrum(material, rate_hz);
  const double step_s = kHop / rate_hz;
  Wandering grain(step_s, 0.003, dsp::Random(random.next())), drift(step_s, 0.15, dsp::Random(random.next()));
  Wandering shift(step_s, 0.06, dsp::Random(random.next())), tilt(step_s, 0.04, dsp::Random(random.next()));
  Wandering balance(step_s, 0.05, dsp::Random(random.next()));
  dsp::Random phases(random.next()), ribs(random.next());
  for (std::size_t at = 0; at < count + kHop; at += kHop) {
    const double loudness_db = material.grain_db * grain.next() + 1.5 * drift.next();
    const Colouring colouring{material.wander_octaves * shift.next(), material.tilt_db * tilt.next(),
                              material.balance_db * balance.next()};
    const double speed = motion.speed_at(static_cast<double>(at) / rate_hz);
    if (speed < 1e-3) continue;
    spectrum(speed, colouring, amplitudes);
    const auto gain = static_cast<float>(dsp::db_to_gain(loudness_db));
    for (std::size_t k = 0; k < amplitudes.size(); ++k) {
      const auto phase = static_cast<float>(2 * pi * phases.uniform());
      fft.spectrum()[k] = std::polar(gain * amplitudes[k], phase);
    }
    fft.inverse();
    for (std::size_t n = 0; n < kBlock; ++n) out[std::min(at + n, out.size() - 1)] += fft.time()[n] * window[n];
  }
  // A block is centred on the time that its speed is of.
  std::vector<float> sound(out.begin() + kHop, out.begin() + kHop + static_cast<std::ptrdiff_t>(count));
  if (material.wale_spacing_m > 0) add_ribs(material, motion, rate_hz, ribs, sound);
  return sound;
}

std::vector<float> cloth_pops(const ClothMaterial& material, double rate_hz, dsp::Random& random, double gain) {
  std::vector<float> out;
  double at_s = 0;
  const int pops = 1 + static_cast<int>(random.index(4));
  for (int i = 0; i < pops; ++i) {
    const double energy = random.truncated_pareto(material.pop_exponent, 1, 1e4);
    const std::vector<double> one = pop(material, std::log10(energy) / 4, rate_hz, random);
    const double amplitude = gain * material.pop_level * std::sqrt(energy / 1e4);
    const auto first = static_cast<std::size_t>(at_s * rate_hz);
    out.resize(std::max(out.size(), first + one.size()));
    for (std::size_t n = 0; n < one.size(); ++n) out[first + n] += static_cast<float>(amplitude * one[n]);
    at_s -= 0.006 * std::log(1 - random.uniform());
  }
  return out;
}

std::vector<float> cloth_crumpling(const ClothMaterial& material, const ClothMotion& motion, double rate_hz,
                                   dsp::Random random) {
  std::vector<float> out(static_cast<std::size_t>(motion.duration_s() * rate_hz));
  if (!(material.pops_per_s > 0)) return out;
  for (std::size_t step = 0; step < motion.crumpling.size(); ++step) {
    const double activity = motion.crumpling[step];
    if (!(random.uniform() < activity * material.pops_per_s / 3 * motion.step_s)) continue;
    const std::vector<float> burst = cloth_pops(material, rate_hz, random, 0.5 + activity);
    const auto first = static_cast<std::size_t>(static_cast<double>(step) * motion.step_s * rate_hz);
    for (std::size_t n = 0; n < burst.size() && first + n < out.size(); ++n) out[first + n] += burst[n];
  }
  return out;
}

std::vector<float> cloth_recording(const ClothMaterial& material, const ClothMotion& motion, double rate_hz,
                                   std::uint64_t seed) {
  constexpr double kLoudest = 0.95, kRoom_hz = 1500;
  std::vector<float> sound = cloth_friction(material, motion, rate_hz, dsp::Random(dsp::hash(seed, kFrictionStream)));
  const std::vector<float> pops = cloth_crumpling(material, motion, rate_hz, dsp::Random(dsp::hash(seed, kCrumplingStream)));
  dsp::Random noise(dsp::hash(seed, kRoomStream));
  std::vector<float> room(sound.size());
  for (float& x : room) x = static_cast<float>(kRoomLevel * noise.normal());
  dsp::CascadeState state;
  dsp::filter(dsp::butterworth_lowpass(1, kRoom_hz, rate_hz), state, room);
  for (std::size_t n = 0; n < sound.size(); ++n) sound[n] += pops[n] + room[n];
  const double peak = dsp::peak(sound);
  if (peak > kLoudest) {
    for (float& x : sound) x = static_cast<float>(x * kLoudest / peak);
  }
  return sound;
}

}  // namespace rustle::generate
