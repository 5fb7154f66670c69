#include "server/synthesis/friction_noise.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <complex>
#include <numbers>
#include <span>
#include <vector>

#include "server/synthesis/emitter_sounds.h"
#include "server/synthesis/noise_spectrum.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/window.h"

namespace rustle::synthesis {
namespace {

using spatial::Vec3;

constexpr double kLeastSpread_s = 1e-9;
constexpr std::uint64_t kPublishedPhases = 0x7061706572ULL;
constexpr std::uint64_t kImagePhases = 2;
constexpr std::size_t kHopParts = 8;

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

/// Unit-variance Gaussian noise over the line: independent normals at the integers, Catmull-Rom between them, its weights
/// scaled to unit power. Keeps the four nodes it last used. \pre x is at least 0 and never falls
class SlowNoise {
 public:
  double at(std::uint64_t seed, double x) noexcept {
    const double whole = std::floor(x);
    const auto node = static_cast<std::int64_t>(whole);
    for (; node_ < node; ++node_) {
      if (node - node_ > 4) node_ = node - 4;
      std::copy(normals_.begin() + 1, normals_.end(), normals_.begin());
      normals_[3] = normal(seed, node_ + 3);
    }
    const double f = x - whole;
    const std::array<double, 4> w{((2 - f) * f - 1) * f / 2, ((3 * f - 5) * f * f + 2) / 2, ((4 - 3 * f) * f + 1) * f / 2,
                                  (f - 1) * f * f / 2};
    double sum = 0, power = 0;
    for (std::size_t j = 0; j < 4; ++j) {
      sum += w[j] * normals_[j];
      power += w[j] * w[j];
    }
    return sum / std::sqrt(power);
  }

 private:
  static double normal(std::uint64_t seed, std::int64_t node) noexcept {
    return dsp::Random(dsp::hash(seed, static_cast<std::uint64_t>(node), 1)).normal();
  }

  std::int64_t node_ = -5;
  std::array<double, 4> normals_{};  ///< at node_ - 1 to node_ + 2
};

struct Source {
  bool active = false;
  std::uint64_t key = 0;
  Bus bus = 0;
  Ramp<Control> control;
  const float* emission = nullptr;
  double sigma = 0;
  double cutoff_hz = 0;
  double drift = 0;  ///< how far the slow random gain has come, in its nodes
  SlowNoise slow;

  Control at(SampleTime time, double hold, double fade) const noexcept {
    const double t = control.progress(time);
    Control now{mixed(control.from.gain, control.to.gain, t), mixed(control.from.speed_ratio, control.to.speed_ratio, t),
                mixed(control.from.emitter, control.to.emitter, t)};
    const double overdue = static_cast<double>(time - control.end) - hold;
    if (overdue > 0) now.gain *= std::max(0.0, 1 - overdue / fade);
    return now;
  }
};

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
        size_(friction_fft_size(options.rate_hz, options.friction_fft_size)),
        hop_(size_ / 2),
        history_(std::max<std::size_t>(2, static_cast<std::size_t>(std::ceil(kLongestDelay_s * rate_hz_ / hop_)))),
        bins_(static_cast<std::size_t>(size_ / 2)),
        hrtf_(options.layout == spatial::Layout::kBinaural ? options.hrtf : nullptr),
        fft_(size_),
        window_(static_cast<std::size_t>(size_)),
        gamma_(bins_),
        rest_(bins_),
        own_(bins_),
        way_(bins_),
        ear_(bins_),
        response_(bins_),
        spectra_(static_cast<std::size_t>(channels_) * kHopParts, ComplexBins(bins_)),
        sources_(static_cast<std::size_t>(options.max_friction_sources)),
        amplitudes_(sources_.size() * history_) {
    assert(hop_ % kQuantum == 0 && bins_ % (2 * kBinLanes) == 0);
    dsp::sine_window(window_);
    outputs_.reserve(static_cast<std::size_t>(options.max_sheets * channels_));
    for (int i = 0; i < options.max_sheets * channels_; ++i) outputs_.emplace_back(3 * bins_);
    hops_left_.resize(static_cast<std::size_t>(options.max_sheets));
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
    if (within == 0) next_block(scene.before, quantum_start, out.emitters);
    if (out.emitters) give_off(static_cast<std::size_t>(within), *out.emitters);
    if (buses_sounding_ == 0) return;
    for (std::size_t sheet = 0; sheet < hops_left_.size(); ++sheet) {
      if (hops_left_[sheet] == 0) continue;
      const Bus bus = bus_of(static_cast<int>(sheet), SoundKind::kFriction);
      for (int c = 0; c < channels_; ++c) {
        float* samples = out.add_to(bus, c);
        const float* ready = output(sheet, c).data() + within;
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
  /// Three hops of one channel of one sheet, the first of which is being heard.
  std::vector<float>& output(std::size_t sheet, int channel) noexcept {
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
    std::ranges::fill(amplitudes(*chosen), 0.0F);
    chosen->active = true;
    chosen->key = cue.source;
    const Control silent{0, cue.speed_ratio, cue.emitter};
    chosen->control = {now, now, silent, silent};
    return chosen;
  }

  /// Every source by itself.
  static void give_off(std::size_t within, EmitterSounds& emitters) noexcept {
    for (const DryNoise::Source& source : emitters.noise().sources()) {
      if (source.hops_left == 0) continue;
      float* samples = emitters.add_to(source.id, source.bus, source.emitter);
      if (!samples) continue;
      const auto ready = emitters.noise().heard(source).subspan(within, kQuantum);
      for (std::size_t n = 0; n < kQuantum; ++n) samples[n] += ready[n];
    }
  }

  void next_block(const AcousticScene& scene, SampleTime start, EmitterSounds* emitters) noexcept {
    buses_sounding_ = 0;
    if (emitters) emitters->noise().next_hop();
    for (std::size_t sheet = 0; sheet < hops_left_.size(); ++sheet) {
      made_.fill(false);
      if (sources_active_ > 0) {
        for (Source& source : sources_) {
          if (source.active && static_cast<std::size_t>(sheet_of(source.bus)) == sheet)
            add_source(source, scene, start, emitters);
        }
      }
      const bool late = std::any_of(made_.begin() + 1, made_.end(), [](bool made) { return made; });
      if (hops_left_[sheet] == 0 && !late && !made_[0]) continue;
      for (int c = 0; c < channels_; ++c) overlap(output(sheet, c), c);
      hops_left_[sheet] = std::max(hops_left_[sheet] - 1, late ? 3 : made_[0] ? 2 : 0);
      if (hops_left_[sheet] > 0) ++buses_sounding_;
    }
  }

  /// Moves on by a hop and adds what was made.
  void overlap(std::vector<float>& sum, int channel) noexcept {
    std::copy(sum.begin() + hop_, sum.end(), sum.begin());
    std::fill(sum.end() - hop_, sum.end(), 0.0F);
    for (std::size_t part = 0; part < kHopParts; ++part) {
      if (!made_[part]) continue;
      ComplexBins& made = spectrum(channel, part);
      add_block(made, sum.data() + part * bins_ / kHopParts);
      set_zero(made);
    }
  }

  /// Adds a spectrum as a windowed block.
  void add_block(const ComplexBins& made, float* out) noexcept {
    const auto bins = fft_.spectrum();
    const float scale = std::sqrt(static_cast<float>(size_));
    for (std::size_t g = 0, k = 0; k < bins_; ++g) {
      for (std::size_t j = 0; j < kBinLanes; ++j, ++k) bins[k] = {scale * made.re[g].at[j], scale * made.im[g].at[j]};
    }
    bins[0] = bins[bins_] = 0;
    fft_.inverse();
    const auto block = fft_.time();
    for (std::size_t n = 0; n < block.size(); ++n) out[n] += window_[n] * block[n];
  }

  /// A source's amplitude in its last blocks, this one first.
  std::span<float> amplitudes(const Source& source) noexcept {
    return std::span(amplitudes_).subspan(static_cast<std::size_t>(&source - sources_.data()) * history_, history_);
  }

  void add_source(Source& source, const AcousticScene& scene, SampleTime start, EmitterSounds* emitters) noexcept {
    const Control now = source.at(start, kUnrenewed_s * rate_hz_, kUnrenewedFade_s * rate_hz_);
    double gain = now.gain;
    if (source.sigma > 0 && gain > 0)
      gain *= std::exp(source.sigma * source.slow.at(source.key, source.drift) - source.sigma * source.sigma);
    source.drift += 2 * source.cutoff_hz * now.speed_ratio * hop_ / rate_hz_;
    const std::span<float> past = amplitudes(source);
    std::copy_backward(past.begin(), past.end() - 1, past.end());
    past[0] = static_cast<float>(gain);
    const bool heard = std::any_of(past.begin(), past.end(), [](float a) { return a != 0; });
    if (!heard && start >= source.control.end && now.gain == 0) {
      source.active = false;
      --sources_active_;
      return;
    }
    const std::int64_t block = floor_divide(start, hop_);
    if (emitters && past[0] != 0) add_dry(source, now.emitter, past[0], block, emitters->noise());
    if (heard) add_paths(source, now.emitter, scene, block);
  }

  /// What a path without gain and delay would bring.
  void add_dry(const Source& source, const spatial::Emitter& emitter, float amplitude, std::int64_t block,
               DryNoise& noise) noexcept {
    const std::span<float> sum = noise.block(source.key, source.bus, emitter);
    if (sum.empty()) return;
    set_zero(way_);
    add_turned_delayed(dsp::hash(phases_of(source), static_cast<std::uint64_t>(block)), source.emission, amplitude, 0, way_);
    add_block(way_, sum.data());
  }

  static std::int64_t floor_divide(SampleTime a, SampleTime b) noexcept { return a / b - (a % b < 0 ? 1 : 0); }

  /// One path as it reaches the channels.
  struct Way {
    std::size_t back = 0;  ///< how many blocks ago what arrives now was sent
    std::size_t part = 0;  ///< of a hop, that it comes later still
    bool heard = false;
    double spread_s = 0;
    spatial::Hrtf::Place place;
    std::array<double, spatial::kMaxChannels> gain{}, rest_s{};  ///< per channel; the delay beyond these
  };
  using Ways = std::array<Way, spatial::kMaxPaths>;

  std::size_t find_ways(const Source& source, const spatial::Emitter& emitter, const AcousticScene& scene,
                        Ways& ways) noexcept {
    std::array<spatial::Path, spatial::kMaxPaths> paths;
    const auto planes = scene.used_planes();
    const spatial::Vec3& centre_m = scene.listener.position_m;
    const double hop_s = hop_ / rate_hz_, part_s = hop_s / kHopParts;
    const std::span<float> past = amplitudes(source);
    const std::size_t count = spatial::paths(emitter, {centre_m}, centre_m, planes, paths);
    for (std::size_t p = 0; p < count; ++p) {
      const double parts = std::clamp(paths[p].delay_s / part_s, 0.0, static_cast<double>(kHopParts * history_ - 1));
      const auto whole = static_cast<std::size_t>(std::llround(parts));
      ways[p].back = std::min(whole / kHopParts, history_ - 1);
      ways[p].part = whole % kHopParts;
      ways[p].spread_s = paths[p].spread_s;
      ways[p].heard = false;
      if (hrtf_) ways[p].place = hrtf_->place(spatial::head_coordinates(scene.listener, paths[p].arrival_m));
    }
    for (std::size_t c = 0; c < static_cast<std::size_t>(channels_); ++c) {
      if (channels_ > 1 && !hrtf_) spatial::paths(emitter, scene.receivers[c], centre_m, planes, paths);
      for (std::size_t p = 0; p < count; ++p) {
        Way& way = ways[p];
        const double delay_s = paths[p].delay_s + (hrtf_ ? hrtf_->delay_s(way.place, static_cast<int>(c)) : 0);
        way.gain[c] = past[way.back] * paths[p].gain;
        const auto parts = static_cast<double>(kHopParts * way.back + way.part);
        way.rest_s[c] = std::clamp(delay_s - parts * part_s, -hop_s, hop_s);
        way.heard = way.heard || way.gain[c] != 0;
      }
    }
    return count;
  }

  /// The paths of a source to the spectra of their parts. Those that left at the same time have the source's phases of then
  /// in common.
  void add_paths(const Source& source, const spatial::Emitter& emitter, const AcousticScene& scene,
                 std::int64_t block) noexcept {
    Ways ways;
    const std::size_t count = find_ways(source, emitter, scene, ways);
    for (std::size_t p = 0; p < count; ++p) {
      if (!ways[p].heard) continue;
      const auto sent = static_cast<std::uint64_t>(block - static_cast<std::int64_t>(ways[p].back));
      const std::uint64_t seed = dsp::hash(phases_of(source), sent);
      const std::uint64_t own_seed = dsp::hash(phases_of(source), sent, kImagePhases + p);
      if (hrtf_) {
        add_heard(source, ways[p], seed, own_seed);
      } else {
        add_free(source, ways[p], seed, own_seed);
      }
      made_[ways[p].part] = true;
    }
  }

  /// One way as microphones hear it.
  void add_free(const Source& source, const Way& way, std::uint64_t seed, std::uint64_t own_seed) noexcept {
    for (std::size_t c = 0; c < static_cast<std::size_t>(channels_); ++c) {
      ComplexBins& out = spectrum(static_cast<int>(c), way.part);
      const double turn = radians_per_bin(way.rest_s[c]);
      if (way.spread_s > kLeastSpread_s) {
        add_turned_delayed(seed, own_seed, source.emission, way.gain[c], turn, radians_per_bin(way.spread_s), out);
      } else {
        add_turned_delayed(seed, source.emission, way.gain[c], turn, out);
      }
    }
  }

  /// One way as the ears of a head hear it.
  void add_heard(const Source& source, const Way& way, std::uint64_t seed, std::uint64_t own_seed) noexcept {
    const bool extended = way.spread_s > kLeastSpread_s;
    if (extended) coherence(radians_per_bin(way.spread_s), gamma_, rest_);
    for (std::size_t c = 0; c < static_cast<std::size_t>(channels_); ++c) {
      ComplexBins& out = spectrum(static_cast<int>(c), way.part);
      const double turn = radians_per_bin(way.rest_s[c]);
      set_zero(way_);
      if (extended) {
        set_zero(own_);
        add_delayed(way.gain[c], turn, gamma_, rest_, way_, own_);
      } else {
        add_delayed(way.gain[c], turn, way_);
      }
      respond(way.place, static_cast<int>(c));
      add_responding(seed, source.emission, way_, out);
      if (extended) add_responding(own_seed, source.emission, own_, out);
    }
  }

  /// A transfer function through the ear in response_.
  void add_responding(std::uint64_t seed, const float* emission, const ComplexBins& transfer, ComplexBins& out) noexcept {
    set_zero(ear_);
    add_product(response_, transfer, ear_);
    add_turned(seed, emission, ear_, out);
  }

  /// The ear's response to a direction, in response_.
  void respond(const spatial::Hrtf::Place& place, int ear) noexcept {
    const auto taps = static_cast<std::size_t>(hrtf_->taps());
    const auto time = fft_.time();
    std::fill(time.begin(), time.end(), 0.0F);
    if (taps <= time.size()) {
      hrtf_->filter(place, ear, time.first(taps));
    } else {
      std::array<float, spatial::Hrtf::kMostTaps> filter;
      hrtf_->filter(place, ear, std::span(filter).first(taps));
      for (std::size_t n = 0; n < taps; ++n) time[n % time.size()] += filter[n];
    }
    fft_.forward();
    const auto spectrum = fft_.spectrum();
    for (std::size_t g = 0, k = 0; k < bins_; ++g) {
      for (std::size_t j = 0; j < kBinLanes; ++j, ++k) {
        response_.re[g].at[j] = spectrum[k].real();
        response_.im[g].at[j] = spectrum[k].imag();
      }
    }
  }

  std::uint64_t phases_of(const Source& source) const noexcept { return published_ ? kPublishedPhases : source.key; }

  ComplexBins& spectrum(int channel, std::size_t part) noexcept {
    return spectra_[static_cast<std::size_t>(channel) * kHopParts + part];
  }

  double radians_per_bin(double delay_s) const noexcept { return 2 * std::numbers::pi * delay_s * rate_hz_ / size_; }

  bool published_;
  int channels_;
  double rate_hz_;
  int size_, hop_;
  std::size_t history_;  ///< blocks whose amplitude is kept
  std::size_t bins_;     ///< all but the Nyquist frequency's
  std::shared_ptr<const spatial::Hrtf> hrtf_;
  dsp::RealFft fft_;
  std::vector<float> window_;
  RealBins gamma_, rest_;
  ComplexBins own_, way_, ear_, response_;
  std::vector<ComplexBins> spectra_;    ///< [channel][part of a hop] of the block and sheet in the making
  std::array<bool, kHopParts> made_{};  ///< which parts are not empty
  std::vector<Source> sources_;
  std::vector<float> amplitudes_;            ///< [source][history_]
  std::vector<std::vector<float>> outputs_;  ///< [sheet][channel]
  std::vector<int> hops_left_;               ///< per sheet: still to be heard
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
