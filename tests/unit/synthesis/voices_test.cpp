#include "server/synthesis/voices.h"

#include <catch2/catch.hpp>

#include <Eigen/Geometry>
#include <array>
#include <cfenv>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <vector>

#include "server/synthesis/limiter.h"
#include "server/synthesis/mixer.h"
#include "sound_db/dsp/random.h"

namespace voices_test {

using namespace rustle::synthesis;
namespace spatial = rustle::spatial;
namespace dsp = rustle::dsp;
using spatial::Vec3;

namespace {

constexpr double kRate_hz = 48000;

std::vector<float> tone(double frequency_hz, std::size_t samples, double amplitude = 0.1) {
  std::vector<float> x(samples);
  for (std::size_t n = 0; n < samples; ++n)
    x[n] = static_cast<float>(amplitude * std::sin(2 * std::numbers::pi * frequency_hz * static_cast<double>(n) / kRate_hz));
  return x;
}

CrumpleCue cue_of(const std::vector<float>& unit, std::uint64_t event, SampleTime onset, float gain = 1) {
  CrumpleCue cue;
  cue.onset = onset;
  cue.start = onset - kQuantum;
  cue.event = event;
  cue.unit = unit.data();
  cue.unit_samples = static_cast<std::uint32_t>(unit.size());
  cue.gain = gain;
  return cue;
}

/// A mixer whose first bus is listened to, [channel][sample].
struct Heard {
  Mixer mixer;
  std::vector<float> quantum;
  SampleTime now = 0;
  std::vector<std::vector<float>> out;

  explicit Heard(spatial::Layout layout = spatial::Layout::kMono, int max_voices = 512)
      : mixer([&] {
          RenderOptions options;
          options.layout = layout;
          options.max_sheets = 2;
          options.max_voices = max_voices;
          return options;
        }()),
        quantum(mixer.quantum_size(), 7.0F),
        out(static_cast<std::size_t>(mixer.channels())) {
    mixer.apply(ListenerCue{0, 0, {{0, 0, 1}, {0, 0, -1}, {0, 1, 0}}});
  }

  void run(SampleTime samples) {
    for (const SampleTime end = now + samples; now < end; now += kQuantum) {
      mixer.render(now, quantum);
      for (std::size_t c = 0; c < out.size(); ++c) {
        for (std::size_t n = 0; n < kQuantum; ++n) out[c].push_back(mixer.sounding(0) ? quantum[c * kQuantum + n] : 0.0F);
      }
    }
  }
};

double power(const std::vector<double>& x) {
  double sum = 0;
  for (const double s : x) sum += s * s;
  return sum;
}

/// Five slow oscillations of random pace and phase.
class Wandering {
 public:
  Wandering(std::uint64_t seed, double size) : size_(size) {
    dsp::Random random(seed);
    for (auto& [pace, phase] : parts_) {
      pace = 2 * std::numbers::pi * random.uniform(0.05, 0.6);
      phase = random.uniform(0, 6.28);
    }
  }
  double at(double time_s) const {
    double sum = 0;
    for (const auto& [pace, phase] : parts_) sum += std::sin(pace * time_s + phase);
    return size_ * sum / std::sqrt(2.5);
  }

 private:
  double size_;
  std::array<std::pair<double, double>, 5> parts_;
};

Vec3 mixed(const Vec3& a, const Vec3& b, double t) {
  return a + t * (b - a);
}

}  // namespace

TEST_CASE(
    "Nothing clicks: a minute of listener, sheet and planes in motion leaves tones with their Doppler, -60 dB of else") {
  constexpr double kLength_s = 60;
  constexpr SampleTime kFrame = 800;
  constexpr double kFrequency_hz = 1000;
  const auto unit = tone(kFrequency_hz, static_cast<std::size_t>((kLength_s + 1) * kRate_hz));
  const Wandering x(1, 0.5), y(2, 0.5), z(3, 0.25), sheet_x(4, 0.2), sheet_y(5, 0.2), sheet_z(6, 0.1), tilt(7, 0.5),
      turn(8, 0.8), wall(9, 0.2), table(10, 0.05), reflection(11, 0.2), look(12, 0.8);
  struct Frame {
    spatial::Listener listener;
    std::array<spatial::Plane, 2> planes;
    Vec3 centre_m;
    Eigen::Matrix3d attitude;
  };
  const auto frame_at = [&](int k) {
    const double t = static_cast<double>(k) * kFrame / kRate_hz;
    Frame f;
    f.listener.position_m = {x.at(t), y.at(t), 1.6 + z.at(t)};
    f.listener.forward = spatial::normalized({std::sin(look.at(t)), std::cos(look.at(t)), -0.4}, {0, 1, 0});
    f.listener.up = {0, 0, 1};
    f.planes[0] = {{0, 0, -0.3 + table.at(t)}, {0, 0, 1}, 0.9};
    f.planes[1] = {
        {-2.5 + wall.at(t), 0, 0}, spatial::normalized({1, 0.2 * tilt.at(t), 0}, {1, 0, 0}), 0.5 + reflection.at(t)};
    f.centre_m = {sheet_x.at(t), sheet_y.at(t), 0.2 + sheet_z.at(t)};
    f.attitude = (Eigen::AngleAxisd(0.6 * tilt.at(t), Eigen::Vector3d::UnitX()) *
                  Eigen::AngleAxisd(turn.at(t), Eigen::Vector3d::UnitZ()))
                     .toRotationMatrix();
    return f;
  };
  const auto turn_between = [](const Frame& a, const Frame& b) -> Vec3 {
    const Eigen::AngleAxisd way(Eigen::Matrix3d(b.attitude * a.attitude.transpose()));
    return Eigen::Vector3d(way.angle() * way.axis());
  };

  Heard heard(spatial::Layout::kStereo);
  std::vector<Frame> frames{frame_at(0)};
  heard.mixer.apply(ListenerCue{0, 0, frames[0].listener});
  for (std::uint16_t k = 0; k < 2; ++k) heard.mixer.apply(PlaneCue{0, 0, k, true, frames[0].planes[k]});
  CrumpleCue cue = cue_of(unit, 1, 0);
  cue.start = 0;
  cue.emitter.position_m = frames[0].centre_m + Vec3{0.05, 0.03, 0};
  cue.emitter.normal = spatial::normalized({0.2, 0.1, 1}, {0, 0, 1});
  const spatial::Emitter first = cue.emitter;
  heard.mixer.apply(cue);
  const int count = static_cast<int>(kLength_s * kRate_hz / kFrame);
  for (int k = 1; k <= count; ++k) {
    frames.push_back(frame_at(k));
    const Frame &before = frames[frames.size() - 2], &now = frames.back();
    const SampleTime start = (k - 1) * kFrame, end = k * kFrame;
    heard.mixer.apply(ListenerCue{start, end, now.listener});
    for (std::uint16_t p = 0; p < 2; ++p) heard.mixer.apply(PlaneCue{start, end, p, false, now.planes[p]});
    heard.mixer.apply(EmitterMotionCue{start, end, 0, before.centre_m, now.centre_m, turn_between(before, now)});
    heard.run(std::max<SampleTime>(0, start - heard.now));
  }
  heard.run(count * kFrame - heard.now);

  std::array<std::vector<double>, 2> wanted, rest;
  spatial::Emitter at_frame = first;
  for (int k = 1; k <= count; ++k) {
    const Frame &before = frames[static_cast<std::size_t>(k - 1)], &now = frames[static_cast<std::size_t>(k)];
    const Vec3 turn_rad = turn_between(before, now);
    const double angle = spatial::norm(turn_rad);
    const Vec3 axis = spatial::normalized(turn_rad, {0, 0, 1});
    const auto emitter_at = [&](double t) {
      const auto turned = [&](const Vec3& a) -> Vec3 {
        return Eigen::Vector3d(Eigen::AngleAxisd(t * angle, Eigen::Vector3d(axis.x, axis.y, axis.z)) *
                               Eigen::Vector3d(a.x, a.y, a.z));
      };
      spatial::Emitter out = at_frame;
      out.position_m = mixed(before.centre_m, now.centre_m, t) + turned(at_frame.position_m - before.centre_m);
      out.normal = turned(at_frame.normal);
      return out;
    };
    for (SampleTime n = (k - 1) * kFrame; k > 2 && n < k * kFrame; ++n) {
      const double t = static_cast<double>(n - (k - 1) * kFrame) / kFrame;
      spatial::Listener listener;
      listener.position_m = mixed(before.listener.position_m, now.listener.position_m, t);
      listener.forward = spatial::normalized(mixed(before.listener.forward, now.listener.forward, t), {0, 1, 0});
      listener.up = {0, 0, 1};
      std::array<spatial::Plane, 2> planes;
      for (std::size_t p = 0; p < 2; ++p) {
        planes[p] = {mixed(before.planes[p].point_m, now.planes[p].point_m, t),
                     spatial::normalized(mixed(before.planes[p].normal, now.planes[p].normal, t), {0, 0, 1}),
                     before.planes[p].reflection + t * (now.planes[p].reflection - before.planes[p].reflection)};
      }
      const auto receivers = spatial::receivers(listener, spatial::Layout::kStereo);
      const spatial::Emitter emitter = emitter_at(t);
      for (std::size_t c = 0; c < 2; ++c) {
        std::array<spatial::Path, 3> ways;
        spatial::paths(emitter, receivers[c], listener.position_m, planes, ways);
        double sum = 0;
        for (const spatial::Path& way : ways) {
          const double age_s = static_cast<double>(n) / kRate_hz - way.delay_s;
          sum += 0.1 * way.gain * std::sin(2 * std::numbers::pi * kFrequency_hz * age_s);
        }
        wanted[c].push_back(sum);
        rest[c].push_back(static_cast<double>(heard.out[c][static_cast<std::size_t>(n)]) - sum);
      }
    }
    at_frame = emitter_at(1);
  }
  for (std::size_t c = 0; c < 2; ++c) {
    CHECK(power(wanted[c]) / static_cast<double>(wanted[c].size()) > 1e-5);
    CHECK(10 * std::log10(power(rest[c]) / power(wanted[c])) < -66);
    double largest = 0;
    for (const double r : rest[c]) largest = std::max(largest, std::abs(r));
    CHECK(20 * std::log10(largest / std::sqrt(power(wanted[c]) / static_cast<double>(wanted[c].size()))) < -60);
  }
}

TEST_CASE("A voice goes along with its sheet, and with no other") {
  const auto unit = tone(500, 96000);
  Heard still, moved, others;
  for (Heard* h : {&still, &moved, &others}) h->mixer.apply(cue_of(unit, 1, 0));
  EmitterMotionCue away{4800, 9600, 0, {0, 0, 0}, {0, 0, -1}, {}};
  moved.mixer.apply(away);
  away.bus = bus_of(1, SoundKind::kCrumpling);
  others.mixer.apply(away);
  for (Heard* h : {&still, &moved, &others}) h->run(48000);
  const auto level = [](const Heard& h, std::size_t from) {
    double sum = 0;
    for (std::size_t n = from; n < from + 9600; ++n) sum += static_cast<double>(h.out[0][n]) * h.out[0][n];
    return 10 * std::log10(sum);
  };
  CHECK(level(moved, 20000) - level(still, 20000) == Approx(-6.02).margin(0.02));
  CHECK(std::memcmp(still.out[0].data(), others.out[0].data(), still.out[0].size() * sizeof(float)) == 0);
  CHECK(std::memcmp(still.out[0].data(), moved.out[0].data(), 4800 * sizeof(float)) == 0);
}

TEST_CASE("The sum is that of the voices by themselves, whatever comes and goes beside them") {
  dsp::Random random(4);
  std::vector<std::vector<float>> units;
  for (int k = 0; k < 5; ++k) {
    units.emplace_back(static_cast<std::size_t>(200 + 3000 * k));
    for (float& s : units.back()) s = static_cast<float>(0.1 * random.normal());
  }
  std::vector<CrumpleCue> cues;
  for (std::uint64_t k = 0; k < 90; ++k) {
    cues.push_back(cue_of(units[k % units.size()], k + 1, 64 + random.index(12000), static_cast<float>(random.uniform())));
    cues.back().bus = bus_of(0, SoundKind::kCrumpling);
    cues.back().emitter.position_m = {random.normal(), random.normal(), random.uniform(0.01, 0.5)};
  }
  const auto render = [&](std::span<const CrumpleCue> some) {
    Heard h(spatial::Layout::kStereo);
    h.mixer.apply(PlaneCue{0, 0, 0, true, {}});
    for (const CrumpleCue& cue : some) h.mixer.apply(cue);
    h.mixer.apply(CrumpleRaiseCue{5000, 3, 0, 1.5F});
    h.mixer.apply(CrumpleRaiseCue{6000, 50, 0, 0.5F});
    h.run(32000);
    CHECK(h.mixer.silent());
    return h.out;
  };
  const auto together = render(cues);
  std::vector<std::vector<double>> sum(2, std::vector<double>(together[0].size()));
  for (const CrumpleCue& cue : cues) {
    const auto alone = render(std::span(&cue, 1));
    for (std::size_t c = 0; c < 2; ++c) {
      for (std::size_t n = 0; n < sum[c].size(); ++n) sum[c][n] += static_cast<double>(alone[c][n]);
    }
  }
  double largest = 0;
  for (std::size_t c = 0; c < 2; ++c) {
    for (std::size_t n = 0; n < sum[c].size(); ++n)
      largest = std::max(largest, std::abs(sum[c][n] - static_cast<double>(together[c][n])));
  }
  CHECK(largest < 2e-6);
}

TEST_CASE("Of 512 voices the one that is quietest over the next 10 ms makes room, within 2 ms and without a step") {
  constexpr int kVoices = 512;
  const auto low = tone(200, 48000, 0.01);
  auto pausing = low;  // loud but for the 10 ms in which it is judged
  for (std::size_t n = 7600; n < 8200; ++n) pausing[n] = 0;
  Heard heard, without;
  for (std::uint64_t k = 1; k <= kVoices; ++k) {
    const CrumpleCue cue = cue_of(k == 300 ? pausing : low, k, 64, k == 300 ? 1.0F : 0.2F + 0.001F * static_cast<float>(k));
    heard.mixer.apply(cue);
    if (k != 300) without.mixer.apply(cue);
  }
  const CrumpleCue late = cue_of(low, 1000, 64 + 7680, 0.5F);
  heard.mixer.apply(late);
  without.mixer.apply(late);
  heard.run(24000);
  without.run(24000);
  CHECK(heard.mixer.counters().voices_stolen == 1);
  CHECK(heard.mixer.counters().voices == kVoices);
  CHECK(without.mixer.counters().voices_stolen == 0);
  const auto &x = heard.out[0], &y = without.out[0];
  double apart = 0, steepest = 0, loudest = 0;
  for (std::size_t n = 7744 + 192; n < x.size(); ++n) apart = std::max(apart, std::abs(static_cast<double>(x[n] - y[n])));
  for (std::size_t n = 1; n < x.size(); ++n) {
    steepest = std::max(steepest, std::abs(static_cast<double>(x[n] - x[n - 1])));
    loudest = std::max(loudest, std::abs(static_cast<double>(x[n])));
  }
  CHECK(apart < 1e-4 * loudest);
  CHECK(steepest < 1.01 * loudest * 2 * std::numbers::pi * 200 / kRate_hz);
}

TEST_CASE("A voice of gain 0 makes room too") {
  const auto unit = tone(200, 9600);
  Heard heard(spatial::Layout::kMono, 2);
  heard.mixer.apply(cue_of(unit, 1, 64, 0));
  heard.mixer.apply(cue_of(unit, 2, 64, 1));
  heard.mixer.apply(cue_of(unit, 3, 640, 1));
  heard.run(1280);
  CHECK(heard.mixer.counters().voices_stolen == 1);
  CHECK(heard.mixer.counters().voices == 2);
  heard.run(19200);
  CHECK(heard.mixer.silent());
}

TEST_CASE("Whatever is in units and gains, what leaves the limiter is finite and within ±1") {
  constexpr float kInf = std::numeric_limits<float>::infinity(), kMax = std::numeric_limits<float>::max();
  dsp::Random random(9);
  std::vector<float> wild(9600);
  for (float& s : wild) {
    const std::array<float, 8> values{0, 1, -1, kMax, -kMax, kInf, std::nanf(""), 1e-42F};
    s = values[random.index(8)];
  }
  for (const float gain : {1.0F, 1e-30F, 1e30F, kMax, -kMax, kInf, std::nanf("")}) {
    Heard heard(spatial::Layout::kStereo);
    heard.mixer.apply(PlaneCue{0, 0, 0, true, {}});
    heard.mixer.apply(cue_of(wild, 1, 100, gain));
    heard.mixer.apply(CrumpleRaiseCue{3000, 1, 0, kMax});
    heard.mixer.apply(CrumpleRaiseCue{4000, 1, 0, kMax});
    heard.mixer.apply(EmitterMotionCue{2000, 8000, 0, {}, {1e200, -1e200, 1e300}, {1e10, 0, 0}});
    heard.mixer.apply(GainCue{5000, 6000, 0, 1e30F});
    heard.run(16000);
    Limiter limiter(kRate_hz);
    float* channels[] = {heard.out[0].data(), heard.out[1].data()};
    limiter.process(channels, heard.out[0].size());
    for (const auto& channel : heard.out) {
      CHECK(std::all_of(channel.begin(), channel.end(), [](float s) { return std::isfinite(s) && std::abs(s) <= 1; }));
    }
  }
}

TEST_CASE("What dies away to denormal numbers comes out as 0, on a thread whose own setting stays") {
  std::vector<float> dying(24000);
  for (std::size_t n = 0; n < dying.size(); ++n) dying[n] = 1e-37F * std::exp(-1e-3F * static_cast<float>(n));
  Heard heard;
  heard.mixer.apply(cue_of(dying, 1, 64, 0.5F));
  heard.run(24000);
  for (const float s : heard.out[0]) CHECK((s == 0 || std::abs(s) >= std::numeric_limits<float>::min()));
  volatile float small = std::numeric_limits<float>::min();
  CHECK(small / 4 != 0);
}

}  // namespace voices_test
