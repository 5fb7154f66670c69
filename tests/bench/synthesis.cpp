#include <sched.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <optional>
#include <vector>

#include "bench.h"
#include "scsynth.h"
#include "server/synthesis/friction_noise.h"
#include "server/synthesis/mixer.h"
#include "server/synthesis/planner.h"
#include "sound_db/dsp/random.h"

/// Synthesis on one core (P8-P10), in quanta of 64 samples at 48 kHz, above a table:
///   synthesis/voices           512 crumpling voices at rest, heard by one microphone: CPU time of one voice for one second.
///                              A voice is one unit read twice, directly and by its image in the table, each through 4-point
///                              interpolation; the direct way to a single microphone is a whole number of samples long,
///                              where interpolation comes down to one weight. Units begin and end all the time, 0.9 s long
///                              each
///   synthesis/voices_stereo    the same, heard by two microphones: four readings a voice, none of them whole
///   synthesis/voices_moving    as voices, the listener moving all the time: every delay and gain slides in every quantum
///   reference of these         one PlayBuf voice of SuperCollider's scsynth for one second: one reading of the same units
///                              with its 4-point interpolation, at rate 1.0001, in a loop; in its non-real-time mode, the
///                              time without voices taken off. Run in turn with ours, on the same core
///   synthesis/friction         2048 samples of 64 friction sources by a table, control points 60 times a second
///   synthesis/friction_still   the same sources at rest
///   synthesis/silence          a quantum of a mixer for 16 sheets in which nothing sounds
///   synthesis/session          a quantum of a busy stereo session: 24 voices, 6 friction sources, listener at rest
namespace rustle::bench {
namespace {

using namespace synthesis;

constexpr int kRate_hz = 48000;
constexpr int kVoices = 512;
constexpr int kUnits = 24;
constexpr SampleTime kUnitSamples = 38400;
constexpr int kRounds = 5;

double checksum = 0;

void require(bool holds, std::string_view what) {
  if (holds) return;
  fmt::print(stderr, "bench_synthesis: {}\n", what);
  std::exit(1);
}

std::vector<std::vector<float>> make_units() {
  dsp::Random random(1);
  std::vector<std::vector<float>> units(kUnits);
  for (auto& unit : units) {
    unit.resize(kUnitSamples);
    for (float& x : unit) x = static_cast<float>(random.uniform(-0.3, 0.3));
  }
  return units;
}

RenderOptions options_of(spatial::Layout layout) {
  RenderOptions options;
  options.rate_hz = kRate_hz;
  options.layout = layout;
  options.max_voices = kVoices + 16;
  return options;
}

spatial::Listener listener_at(double time_s) {
  return {{0.3 * std::sin(2 * time_s), -0.8, 0.7 + 0.1 * std::cos(3 * time_s)}, {0, 0.8, -0.6}, {0, 0.6, 0.8}};
}

spatial::Emitter emitter(dsp::Random& random) {
  spatial::Emitter out;
  out.position_m = {random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), random.uniform(0.02, 0.3)};
  out.normal = spatial::normalized({random.normal(), random.normal(), 1}, {0, 0, 1});
  return out;
}

/// A mixer above a table, its clock, and what it is kept busy with.
class Session {
 public:
  Session(spatial::Layout layout, const std::vector<std::vector<float>>& units, int voices, bool moving)
      : mixer_(options_of(layout)), units_(units), out_(mixer_.quantum_size()), voices_(voices), moving_(moving) {
    mixer_.apply(ListenerCue{0, 0, listener_at(0)});
    mixer_.apply(PlaneCue{0, 0, 0, true, {}});
    run(2 * kUnitSamples / kQuantum);
  }

  void run(SampleTime quanta) {
    for (; quanta > 0; --quanta, now_ += kQuantum) {
      while (voices_ > 0 && next_ < static_cast<double>(now_ + kQuantum)) start_voice();
      if (moving_ && now_ % 800 < kQuantum)
        mixer_.apply(ListenerCue{now_, now_ + 800, listener_at(static_cast<double>(now_ + 800) / kRate_hz)});
      mixer_.render(now_, out_);
    }
    checksum += static_cast<double>(out_[0]);
  }

  Mixer& mixer() { return mixer_; }
  SampleTime now() const { return now_; }

 private:
  void start_voice() {
    CrumpleCue cue;
    cue.onset = static_cast<SampleTime>(next_);
    cue.start = cue.onset - kQuantum;
    cue.event = ++events_;
    const auto& unit = units_[random_.index(kUnits)];
    cue.unit = unit.data();
    cue.unit_samples = static_cast<std::uint32_t>(unit.size());
    cue.gain = 0.01F;
    cue.emitter = emitter(random_);
    mixer_.apply(cue);
    next_ += static_cast<double>(kUnitSamples) / voices_;
  }

  Mixer mixer_;
  const std::vector<std::vector<float>>& units_;
  std::vector<float> out_;
  int voices_;
  bool moving_;
  SampleTime now_ = 0;
  double next_ = 0;
  std::uint64_t events_ = 0;
  dsp::Random random_{3};
};

/// CPU time of one voice for one second of sound, in each round.
struct VoiceCosts {
  Timings times;
  std::unique_ptr<Session> session;

  void measure(SampleTime quanta) {
    const double before_us = thread_time_us();
    session->run(quanta);
    const double spent_us = thread_time_us() - before_us;
    const auto sounding = static_cast<double>(session->mixer().counters().voices);
    require(std::abs(sounding - kVoices) < 24, "not so many voices sound");
    times.add(spent_us / sounding / static_cast<double>(quanta * kQuantum) * kRate_hz);
  }
};

/// The same of a PlayBuf voice.
void measure_playbuf(const Scsynth& scsynth, Timings& times) {
  constexpr double kDuration_s = 3;
  const auto without = scsynth.run(0, kDuration_s);
  const auto with = scsynth.run(kVoices, kDuration_s);
  if (without && with) times.add((*with - *without) * 1e6 / kVoices / kDuration_s);
}

double measure_voices(const std::vector<std::vector<float>>& units, Report& report) {
  VoiceCosts mono, stereo, moving;
  mono.session = std::make_unique<Session>(spatial::Layout::kMono, units, kVoices, false);
  stereo.session = std::make_unique<Session>(spatial::Layout::kStereo, units, kVoices, false);
  moving.session = std::make_unique<Session>(spatial::Layout::kMono, units, kVoices, true);
  Timings playbuf;
  std::optional<Scsynth> scsynth;
  if (Scsynth::installed()) scsynth.emplace(units, kRate_hz);
  for (int round = 0; round < kRounds; ++round) {
    mono.measure(10000);
    if (scsynth) measure_playbuf(*scsynth, playbuf);
    stereo.measure(5000);
    moving.measure(1000);
  }
  if (!scsynth) report.note("no /usr/bin/scsynth to compare with; as root: apt-get install supercollider-server");
  if (scsynth && playbuf.empty()) report.note("scsynth failed; see: scsynth -N");
  const double reference_us = playbuf.median_us();
  const auto add = [&](const char* name, const VoiceCosts& costs) {
    report.add({name, kVoices, costs.times.median_us(), costs.times.quantile_us(0.95), reference_us, "voices"});
    report.note(fmt::format("{:.0f} voices a core, {:.1f} x PlayBuf's {:.0f}", 1e6 / costs.times.median_us(),
                            reference_us / costs.times.median_us(), 1e6 / reference_us));
  };
  add("synthesis/voices", mono);
  add("synthesis/voices_stereo", stereo);
  add("synthesis/voices_moving", moving);
  return reference_us / mono.times.median_us();
}

double measure_friction(const char* name, bool controlled, const Options& options, Report& report) {
  constexpr int kSources = 64;
  constexpr SampleTime kBlock = 2048;
  RenderOptions render = options_of(spatial::Layout::kMono);
  Mixer mixer(render);
  std::vector<float> out(mixer.quantum_size());
  const std::vector<float> emission(static_cast<std::size_t>(friction_fft_size(kRate_hz)) / 2 + 1, 0.01F);
  mixer.apply(ListenerCue{0, 0, listener_at(0)});
  mixer.apply(PlaneCue{0, 0, 0, true, {}});
  dsp::Random random(5);
  std::vector<FrictionCue> sources(kSources);
  for (std::size_t k = 0; k < kSources; ++k) {
    FrictionCue& cue = sources[k];
    cue.source = 100 + k;
    cue.bus = bus_of(0, SoundKind::kFriction);
    cue.gain = 0.1F;
    cue.speed_ratio = 1;
    cue.emission = emission.data();
    cue.gain_sigma = 0.35F;
    cue.gain_cutoff_hz = 80;
    cue.emitter = emitter(random);
    cue.emitter.covariance_m2.zz = 1e-5;
    cue.end = controlled ? 0 : INT64_MAX / 4;
    mixer.apply(cue);
  }
  Timings times;
  constexpr int kDiscarded = 10;
  SampleTime now = 0;
  for (int block = 0; block < kDiscarded + options.frames; ++block) {
    if (block == kDiscarded) times.discard();
    double spent_us = 0;
    for (const SampleTime end = now + kBlock; now < end; now += kQuantum) {
      if (controlled && now % 800 < kQuantum) {
        for (FrictionCue& cue : sources) {
          cue.start = now;
          cue.end = now + 800;
          cue.gain = static_cast<float>(0.1 + 0.02 * random.normal());
          cue.emitter.position_m.x += 0.001 * random.normal();
          mixer.apply(cue);
        }
      }
      const double before_us = thread_time_us();
      mixer.render(now, out);
      spent_us += thread_time_us() - before_us;
    }
    times.add(spent_us);
    require(mixer.counters().voices == kSources, "not so many friction sources sound");
    checksum += static_cast<double>(out[kQuantum * static_cast<std::size_t>(bus_of(0, SoundKind::kFriction))]);
  }
  report.add({name, kSources, times.median_us(), times.quantile_us(0.95), std::nan(""), "sources"});
  return times.median_us();
}

double measure_silence(const Options& options, Report& report) {
  Mixer mixer(options_of(spatial::Layout::kStereo));
  std::vector<float> out(mixer.quantum_size());
  mixer.apply(ListenerCue{0, 0, listener_at(0)});
  mixer.apply(PlaneCue{0, 0, 0, true, {}});
  Timings times;
  SampleTime now = 0;
  constexpr int kQuanta = 1000;
  for (int k = 0; k < options.frames; ++k) {
    const double before_us = thread_time_us();
    for (int q = 0; q < kQuanta; ++q, now += kQuantum) mixer.render(now, out);
    times.add((thread_time_us() - before_us) / kQuanta);
  }
  require(mixer.silent(), "the mixer is not silent");
  report.add({"synthesis/silence", 0, times.median_us(), times.quantile_us(0.95), std::nan(""), "voices"});
  return times.median_us();
}

void measure_session(const std::vector<std::vector<float>>& units, const Options& options, Report& report) {
  constexpr int kBusyVoices = 24;
  constexpr std::size_t kBusySources = 6;
  Session session(spatial::Layout::kStereo, units, kBusyVoices, false);
  const std::vector<float> emission(static_cast<std::size_t>(friction_fft_size(kRate_hz)) / 2 + 1, 0.01F);
  dsp::Random random(6);
  for (std::size_t k = 0; k < kBusySources; ++k) {
    FrictionCue cue;
    cue.source = 100 + k;
    cue.start = session.now();
    cue.end = INT64_MAX / 4;
    cue.bus = bus_of(0, SoundKind::kFriction);
    cue.gain = 0.1F;
    cue.speed_ratio = 1;
    cue.emission = emission.data();
    cue.gain_sigma = 0.35F;
    cue.gain_cutoff_hz = 80;
    cue.emitter = emitter(random);
    session.mixer().apply(cue);
  }
  Timings times;
  for (int k = 0; k < options.frames; ++k) {
    constexpr int kQuanta = 40;
    const double before_us = thread_time_us();
    session.run(kQuanta);
    times.add((thread_time_us() - before_us) / kQuanta);
  }
  report.add(
      {"synthesis/session", kBusyVoices + kBusySources, times.median_us(), times.quantile_us(0.95), std::nan(""), "voices"});
}

/// Everything on the core that this thread runs on, scsynth too.
void stay_on_this_core() {
  cpu_set_t core;
  CPU_ZERO(&core);
  CPU_SET(static_cast<std::size_t>(sched_getcpu()), &core);
  sched_setaffinity(0, sizeof core, &core);
}

}  // namespace
}  // namespace rustle::bench

int main(int argc, char** argv) {
  using namespace rustle::bench;
  const Options options = read_options(argc, argv);
  stay_on_this_core();
  Report report(options);
  const auto units = make_units();
  const double times_playbuf = measure_voices(units, report);
  const double friction_us = measure_friction("synthesis/friction", true, options, report);
  measure_friction("synthesis/friction_still", false, options, report);
  const double silence_us = measure_silence(options, report);
  measure_session(units, options, report);
  report.goal_at_least("voices beside PlayBuf voices", times_playbuf, 20);
  report.goal("friction, 2048 samples of 64 sources, us", friction_us, 250);
  report.goal("a silent quantum, us", silence_us, 0.1);
  if (!std::isfinite(checksum)) fmt::print(stderr, "a result was not finite\n");
  return report.finish();
}
