#include "server/synthesis/friction_noise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstring>
#include <numbers>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/window.h"

namespace rustle::synthesis {
namespace {

using spatial::Vec3;

constexpr double kLeastCoherence = 1e-4;
constexpr double kLeastSpread_s = 1e-9;
constexpr std::uint64_t kPublishedPhases = 0x7061706572ULL;
constexpr int kLanes = 8;

/// A complex number per bin, real and imaginary parts apart. [padded to kLanes]
struct Bins {
  std::vector<float> re, im;
  explicit Bins(std::size_t count) : re(count), im(count) {}
};

/// Random unit phasors, drawn from a circle of 1024.
class PhaseTable {
 public:
  PhaseTable() {
    for (std::size_t i = 0; i < cos_.size(); ++i) {
      const double angle = 2 * std::numbers::pi * (static_cast<double>(i) + 0.5) / static_cast<double>(cos_.size());
      cos_[i] = static_cast<float>(std::cos(angle));
      sin_[i] = static_cast<float>(std::sin(angle));
    }
  }
  /// One per bin, from (seed, block) alone: six bins share 64 random bits.
  void draw(std::uint64_t seed, std::int64_t block, Bins& out) const noexcept {
    dsp::Random random(dsp::hash(seed, static_cast<std::uint64_t>(block)));
    float *re = out.re.data(), *im = out.im.data();
    const std::size_t count = out.re.size();
    for (std::size_t k = 0; k < count; k += 6) {
      std::uint64_t bits = random.next();
      const std::size_t end = std::min(count, k + 6);
      for (std::size_t j = k; j < end; ++j, bits >>= 10) {
        const std::size_t i = bits & 1023;
        re[j] = cos_[i];
        im[j] = sin_[i];
      }
    }
  }

 private:
  std::array<float, 1024> cos_, sin_;
};

/// out_k = amplitude exp(-iωτ), ω the bin's. Each group of lanes follows from the one before by one rotation.
void phase_ramp(double amplitude, double radians_per_bin, Bins& out) noexcept {
  if (radians_per_bin == 0) {
    std::fill(out.re.begin(), out.re.end(), static_cast<float>(amplitude));
    std::fill(out.im.begin(), out.im.end(), 0.0F);
    return;
  }
  const std::complex<double> turn = std::polar(1.0, -radians_per_bin);
  std::array<float, kLanes> re, im;
  std::complex<double> value = amplitude, whole = 1;
  for (std::size_t j = 0; j < kLanes; ++j) {
    re[j] = static_cast<float>(value.real());
    im[j] = static_cast<float>(value.imag());
    value *= turn;
    whole *= turn;
  }
  const auto c = static_cast<float>(whole.real()), s = static_cast<float>(whole.imag());
  float* __restrict out_re = out.re.data(), * __restrict out_im = out.im.data();
  const std::size_t count = out.re.size();
  for (std::size_t k = 0; k < count; k += kLanes) {
    for (std::size_t j = 0; j < kLanes; ++j) {
      out_re[k + j] = re[j];
      out_im[k + j] = im[j];
      const float next = re[j] * c - im[j] * s;
      im[j] = re[j] * s + im[j] * c;
      re[j] = next;
    }
  }
}

/// phases = γ phases + √(1 - γ²) other, γ_k = exp(-(k x)²/2).
void spread(double x, const Bins& other, Bins& phases) noexcept {
  const double shrink = std::exp(-x * x);
  double coherence = 1, ratio = std::exp(-0.5 * x * x);
  for (std::size_t k = 0; k < phases.re.size(); ++k) {
    const auto kept = static_cast<float>(coherence);
    const float own = std::sqrt(std::max(0.0F, 1 - kept * kept));
    phases.re[k] = kept * phases.re[k] + own * other.re[k];
    phases.im[k] = kept * phases.im[k] + own * other.im[k];
    coherence = coherence > kLeastCoherence ? coherence * ratio : 0;
    ratio *= shrink;
  }
}

double mixed(double a, double b, double t) noexcept {
  return t >= 1 ? b : a + t * (b - a);
}
Vec3 mixed(const Vec3& a, const Vec3& b, double t) noexcept {
  return t >= 1 ? b : a + t * (b - a);
}

spatial::Emitter mixed(const spatial::Emitter& a, const spatial::Emitter& b, double t) noexcept {
  spatial::Emitter out = b;
  if (t >= 1) return out;
  out.position_m = mixed(a.position_m, b.position_m, t);
  out.normal = spatial::normalized(mixed(a.normal, b.normal, t), b.normal);
  out.cosine_floor = mixed(a.cosine_floor, b.cosine_floor, t);
  const spatial::SymmetricMatrix &p = a.covariance_m2, &q = b.covariance_m2;
  spatial::SymmetricMatrix& m = out.covariance_m2;
  m.xx = mixed(p.xx, q.xx, t);
  m.xy = mixed(p.xy, q.xy, t);
  m.xz = mixed(p.xz, q.xz, t);
  m.yy = mixed(p.yy, q.yy, t);
  m.yz = mixed(p.yz, q.yz, t);
  m.zz = mixed(p.zz, q.zz, t);
  return out;
}

/// What a cue controls, straight from one control point to the next.
struct Control {
  double gain = 0;
  double speed_ratio = 0;
  spatial::Emitter emitter;
};

struct Source {
  bool active = false;
  std::uint64_t key = 0;
  Bus bus = 0;
  Ramp<Control> control;
  const float* emission = nullptr;
  double sigma = 0;
  double cutoff_hz = 0;
  double drift = 0;                            ///< how far the slow random gain has come, in its nodes
  std::array<float, kDelayHops> amplitudes{};  ///< of the last blocks, this one first

  Control at(SampleTime time, double hold, double fade) const noexcept {
    const double t = control.progress(time);
    Control now{mixed(control.from.gain, control.to.gain, t), mixed(control.from.speed_ratio, control.to.speed_ratio, t),
                mixed(control.from.emitter, control.to.emitter, t)};
    const double overdue = static_cast<double>(time - control.end) - hold;
    if (overdue > 0) now.gain *= std::max(0.0, 1 - overdue / fade);
    return now;
  }
};

double normal_from(std::uint64_t seed, std::int64_t node) noexcept {
  return dsp::Random(dsp::hash(seed, static_cast<std::uint64_t>(node), 1)).normal();
}

/// Unit-variance Gaussian noise over the line: independent normals at the integers, Catmull-Rom between them, its weights
/// scaled to unit power.
double slow_noise(std::uint64_t seed, double x) noexcept {
  const double whole = std::floor(x);
  const auto node = static_cast<std::int64_t>(whole);
  const double f = x - whole;
  const std::array<double, 4> w{((2 - f) * f - 1) * f / 2, ((3 * f - 5) * f * f + 2) / 2, ((4 - 3 * f) * f + 1) * f / 2,
                                (f - 1) * f * f / 2};
  double sum = 0, power = 0;
  for (int j = 0; j < 4; ++j) {
    sum += w[static_cast<std::size_t>(j)] * normal_from(seed, node + j - 1);
    power += w[static_cast<std::size_t>(j)] * w[static_cast<std::size_t>(j)];
  }
  return sum / std::sqrt(power);
}

bool finite(const FrictionCue& cue) noexcept {
  const Vec3& p = cue.emitter.position_m;
  const Vec3& n = cue.emitter.normal;
  return std::isfinite(cue.gain) && std::isfinite(cue.speed_ratio) && std::isfinite(p.x + p.y + p.z) &&
         std::isfinite(n.x + n.y + n.z) && std::isfinite(cue.emitter.cosine_floor) && std::isfinite(cue.gain_sigma) &&
         std::isfinite(cue.gain_cutoff_hz) && std::isfinite(quadratic_form(cue.emitter.covariance_m2, {1, 1, 1}));
}

class FrictionNoise final : public RenderModel {
 public:
  explicit FrictionNoise(const RenderOptions& options)
      : published_(options.mode == Mode::kPublished),
        channels_(options.channels()),
        rate_hz_(options.rate_hz),
        size_(friction_fft_size(options.rate_hz)),
        hop_(size_ / 2),
        bins_(static_cast<std::size_t>(size_ / 2 + 1)),
        padded_((bins_ + kLanes - 1) / kLanes * kLanes),
        fft_(size_),
        window_(static_cast<std::size_t>(size_)),
        phases_(padded_),
        shifted_(padded_),
        image_phases_(padded_),
        ramp_(padded_),
        sources_(static_cast<std::size_t>(options.max_friction_sources)) {
    dsp::sine_window(window_);
    outputs_.reserve(static_cast<std::size_t>(options.max_sheets * channels_));
    for (int i = 0; i < options.max_sheets * channels_; ++i) outputs_.emplace_back(padded_, static_cast<std::size_t>(hop_));
    hops_left_.resize(static_cast<std::size_t>(options.max_sheets));
    touched_.resize(hops_left_.size());
  }

  void apply(const Cue& any, const SceneSpan&, SampleTime quantum_start) noexcept override {
    const auto* cue = std::get_if<FrictionCue>(&any);
    if (!cue) return;
    if (!finite(*cue) || !cue->emission) {
      ++unusable_;
      return;
    }
    Source* source = find(cue->source);
    if (!source) {
      if (cue->gain <= 0) return;
      source = room_for(*cue, quantum_start);
      if (!source) return;
    }
    Control now = source->at(quantum_start, kUnrenewed_s * rate_hz_, kUnrenewedFade_s * rate_hz_);
    const Control goal{std::max(0.0, static_cast<double>(cue->gain)), std::max(0.0, static_cast<double>(cue->speed_ratio)),
                       cue->emitter};
    source->control = {std::max(cue->start, quantum_start), std::max(cue->end, quantum_start), now, goal};
    source->bus = cue->bus;
    source->emission = cue->emission;
    source->sigma = std::clamp(static_cast<double>(cue->gain_sigma), 0.0, 1.0);
    source->cutoff_hz = std::max(0.0, static_cast<double>(cue->gain_cutoff_hz));
  }

  void render(const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept override {
    const SampleTime within = ((quantum_start % hop_) + hop_) % hop_;
    if (within == 0) next_block(scene.before, quantum_start);
    if (buses_sounding_ == 0) return;
    for (std::size_t sheet = 0; sheet < hops_left_.size(); ++sheet) {
      if (hops_left_[sheet] == 0) continue;
      const Bus bus = bus_of(static_cast<int>(sheet), SoundKind::kFriction);
      for (int c = 0; c < channels_; ++c) {
        float* samples = out.add_to(bus, c);
        const float* ready = output(sheet, c).ready.data() + within;
        for (int n = 0; n < kQuantum; ++n) samples[n] += ready[n];
      }
    }
  }

  bool silent() const noexcept override { return sources_active_ == 0 && buses_sounding_ == 0; }

  void add_counters(RenderCounters& counters) const noexcept override {
    counters.voices += static_cast<std::uint64_t>(sources_active_);
    counters.sources_dropped += dropped_;
    counters.cues_dropped += unusable_;
  }

 private:
  /// One channel of one bus: the spectrum of the block in the making, its first half to be heard, its second to be
  /// overlapped.
  struct Output {
    Bins spectrum;
    std::vector<float> ready, tail;
    Output(std::size_t bins, std::size_t hop) : spectrum(bins), ready(hop), tail(hop) {}
  };

  Output& output(std::size_t sheet, int channel) noexcept {
    return outputs_[sheet * static_cast<std::size_t>(channels_) + static_cast<std::size_t>(channel)];
  }

  Source* find(std::uint64_t key) noexcept {
    for (Source& source : sources_) {
      if (source.active && source.key == key) return &source;
    }
    return nullptr;
  }

  /// A free source, else the quietest one's place if the new one is louder. What is replaced fades with its last block.
  Source* room_for(const FrictionCue& cue, SampleTime now) noexcept {
    Source* chosen = nullptr;
    for (Source& source : sources_) {
      if (!source.active) {
        chosen = &source;
        ++sources_active_;
        break;
      }
      if (!chosen || source.control.to.gain < chosen->control.to.gain) chosen = &source;
    }
    if (!chosen) return nullptr;
    if (chosen->active) {
      ++dropped_;
      if (chosen->control.to.gain >= cue.gain) return nullptr;
    }
    *chosen = Source{};
    chosen->active = true;
    chosen->key = cue.source;
    const Control silent{0, cue.speed_ratio, cue.emitter};
    chosen->control = {now, now, silent, silent};
    return chosen;
  }

  void next_block(const AcousticScene& scene, SampleTime start) noexcept {
    if (sources_active_ > 0) {
      for (Source& source : sources_) {
        if (source.active) add_source(source, scene, start);
      }
    }
    buses_sounding_ = 0;
    for (std::size_t sheet = 0; sheet < hops_left_.size(); ++sheet) {
      if (touched_[sheet]) {
        for (int c = 0; c < channels_; ++c) transform(output(sheet, c));
        hops_left_[sheet] = 2;
        touched_[sheet] = 0;
      } else if (hops_left_[sheet] > 0 && --hops_left_[sheet] > 0) {
        for (int c = 0; c < channels_; ++c) {
          Output& o = output(sheet, c);
          std::swap(o.ready, o.tail);
          std::fill(o.tail.begin(), o.tail.end(), 0.0F);
        }
      }
      if (hops_left_[sheet] > 0) ++buses_sounding_;
    }
  }

  void transform(Output& o) noexcept {
    const auto spectrum = fft_.spectrum();
    const float scale = std::sqrt(static_cast<float>(size_));
    for (std::size_t k = 0; k < bins_; ++k) spectrum[k] = {scale * o.spectrum.re[k], scale * o.spectrum.im[k]};
    spectrum[0] = spectrum[bins_ - 1] = 0;
    fft_.inverse();
    const auto block = fft_.time();
    const auto hop = static_cast<std::size_t>(hop_);
    for (std::size_t n = 0; n < hop; ++n) {
      o.ready[n] = o.tail[n] + window_[n] * block[n];
      o.tail[n] = window_[hop + n] * block[hop + n];
    }
    std::fill(o.spectrum.re.begin(), o.spectrum.re.end(), 0.0F);
    std::fill(o.spectrum.im.begin(), o.spectrum.im.end(), 0.0F);
  }

  void add_source(Source& source, const AcousticScene& scene, SampleTime start) noexcept {
    const Control now = source.at(start, kUnrenewed_s * rate_hz_, kUnrenewedFade_s * rate_hz_);
    double gain = now.gain;
    if (source.sigma > 0 && gain > 0)
      gain *= std::exp(source.sigma * slow_noise(source.key, source.drift) - source.sigma * source.sigma);
    source.drift += 2 * source.cutoff_hz * now.speed_ratio * hop_ / rate_hz_;
    std::copy_backward(source.amplitudes.begin(), source.amplitudes.end() - 1, source.amplitudes.end());
    source.amplitudes[0] = static_cast<float>(gain);
    const bool heard = std::any_of(source.amplitudes.begin(), source.amplitudes.end(), [](float a) { return a != 0; });
    if (!heard && start >= source.control.end && now.gain == 0) {
      source.active = false;
      --sources_active_;
      return;
    }
    if (heard) add_paths(source, now.emitter, scene, floor_divide(start, hop_));
  }

  static std::int64_t floor_divide(SampleTime a, SampleTime b) noexcept { return a / b - (a % b < 0 ? 1 : 0); }

  void add_paths(const Source& source, const spatial::Emitter& emitter, const AcousticScene& scene,
                 std::int64_t block) noexcept {
    std::array<std::array<spatial::Path, spatial::kMaxPaths>, spatial::kMaxChannels> ways;
    std::array<spatial::Path, spatial::kMaxPaths> at_centre;
    spatial::Receiver centre;
    centre.position_m = scene.listener.position_m;
    const auto planes = scene.used_planes();
    const std::size_t count = spatial::paths(emitter, centre, centre.position_m, planes, at_centre);
    for (std::size_t c = 0; c < static_cast<std::size_t>(channels_); ++c) {
      spatial::paths(emitter, scene.receivers[c], centre.position_m, planes, ways[c]);
    }
    const std::uint64_t seed = published_ ? kPublishedPhases : source.key;
    std::int64_t drawn = -1;  // how many blocks back the phases in phases_ are
    for (std::size_t p = 0; p < count; ++p) {
      const double delay_hops = at_centre[p].delay_s * rate_hz_ / hop_;
      const std::int64_t back = std::clamp<std::int64_t>(std::llround(std::min(delay_hops, 1e6)), 0, kDelayHops - 1);
      const float amplitude = source.amplitudes[static_cast<std::size_t>(back)];
      bool reaches = false;
      for (std::size_t c = 0; c < static_cast<std::size_t>(channels_); ++c) {
        reaches = reaches || ways[c][p].gain != 0;
      }
      if (amplitude == 0 || !reaches) continue;
      if (drawn != back) table_.draw(seed, block - back, phases_);
      drawn = back;
      const Bins* phases = &phases_;
      if (at_centre[p].spread_s > kLeastSpread_s) {
        shifted_ = phases_;
        table_.draw(dsp::hash(seed, p, 2), block - back, image_phases_);
        spread(radians_per_bin(at_centre[p].spread_s), image_phases_, shifted_);
        phases = &shifted_;
      }
      const std::size_t sheet = static_cast<std::size_t>(sheet_of(source.bus));
      touched_[sheet] = 1;
      for (std::size_t c = 0; c < static_cast<std::size_t>(channels_); ++c) {
        const spatial::Path& way = ways[c][p];
        const double rest_s =
            std::clamp(way.delay_s - static_cast<double>(back) * hop_ / rate_hz_, -hop_ / rate_hz_, hop_ / rate_hz_);
        Bins& spectrum = output(sheet, static_cast<int>(c)).spectrum;
        phase_ramp(amplitude * way.gain, radians_per_bin(rest_s), ramp_);
        accumulate(source.emission, *phases, spectrum);
      }
    }
  }

  double radians_per_bin(double delay_s) const noexcept { return 2 * std::numbers::pi * delay_s * rate_hz_ / size_; }

  void accumulate(const float* emission, const Bins& phases, Bins& spectrum) const noexcept {
    const float* __restrict a = ramp_.re.data(), * __restrict b = ramp_.im.data();
    const float* __restrict p = phases.re.data(), * __restrict q = phases.im.data(), * __restrict e = emission;
    float* __restrict re = spectrum.re.data(), * __restrict im = spectrum.im.data();
    for (std::size_t k = 0; k < bins_; ++k) {
      re[k] += e[k] * (a[k] * p[k] - b[k] * q[k]);
      im[k] += e[k] * (a[k] * q[k] + b[k] * p[k]);
    }
  }

  bool published_;
  int channels_;
  double rate_hz_;
  int size_, hop_;
  std::size_t bins_, padded_;
  dsp::RealFft fft_;
  PhaseTable table_;
  std::vector<float> window_;
  Bins phases_, shifted_, image_phases_, ramp_;
  std::vector<Source> sources_;
  std::vector<Output> outputs_;          ///< [sheet][channel]
  std::vector<std::uint8_t> hops_left_;  ///< per sheet: blocks still to be heard
  std::vector<std::uint8_t> touched_;    ///< per sheet: the block in the making is not empty
  int sources_active_ = 0;
  int buses_sounding_ = 0;
  std::uint64_t dropped_ = 0;
  std::uint64_t unusable_ = 0;
};

}  // namespace

std::unique_ptr<RenderModel> make_friction_noise(const RenderOptions& options) {
  return std::make_unique<FrictionNoise>(options);
}

}  // namespace rustle::synthesis
