#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include "server/spatial/structural_head.h"
#include "server/synthesis/cloth_patches.h"
#include "server/synthesis/emitter_sounds.h"
#include "server/synthesis/mixer.h"
#include "server/synthesis/planner.h"
#include "server/synthesis/source_paths.h"
#include "tests/unit/cloth/made_up_corpus.h"

namespace rustle::synthesis::cloth_tests {
namespace {

using cloth::made_up::CorpusOptions;
using observation::FrictionContact;
using observation::Observation;

constexpr double kFrame_s = 1.0 / 60;

std::shared_ptr<const pack::SoundPack> pack_of(const std::string& material, const CorpusOptions& options) {
  static std::map<std::uint64_t, std::shared_ptr<const pack::ClothCorpus>> corpora;
  const std::uint64_t key =
      options.seed + 100 * static_cast<std::uint64_t>(options.channels) + 1000 * (options.crumples ? 1 : 0);
  auto& corpus = corpora[key];
  if (!corpus) corpus = cloth::made_up::corpus(options);
  auto made = std::make_shared<pack::SoundPack>();
  made->name = made->material = material;
  made->cloth = corpus;
  return made;
}

FrictionContact contact(std::uint64_t id, double speed_m_per_s, const sheet::Vec3d& position_m = {0, 0, 0},
                        std::uint32_t vertices = 20, double area_m2 = 0.02) {
  FrictionContact out;
  out.id = id;
  out.speed_m_per_s = speed_m_per_s;
  out.area_m2 = area_m2;
  out.position_m = position_m;
  for (std::uint32_t v = 0; v < vertices; ++v) {
    out.vertices.push_back({static_cast<std::uint32_t>(1000 * id) + v,
                            {static_cast<float>(speed_m_per_s), 0, 0},
                            static_cast<float>(area_m2 / vertices)});
  }
  return out;
}

Observation frame(int k, double begin_s = 0) {
  Observation out;
  out.sheet = 1;
  out.previous_time_s = begin_s + std::max(0, k - 1) * kFrame_s;
  out.time_s = begin_s + k * kFrame_s;
  return out;
}

/// Strokes with rests between, and pops.
Observation stroking(int k, double begin_s = 0) {
  Observation out = frame(k, begin_s);
  const double speed = k % 60 < 40 ? 0.6 * std::pow(std::sin(k % 60 / 40.0 * std::numbers::pi), 2) : 0;
  out.friction.push_back(contact(1, speed, {0.1 * std::sin(0.1 * k), 0, 0}));
  if (k % 7 == 3) {
    observation::CrumplingEvent event;
    event.id = static_cast<std::uint64_t>(k);
    event.time_s = out.time_s - 0.3 * kFrame_s;
    event.amplitude_m = 0.05 * (1 + k % 5);
    event.position_m = {0.05, 0, 0};
    out.crumpling.push_back(event);
  }
  return out;
}

struct ClothRig {
  PlanOptions plan_options;
  RenderOptions render_options;
  Planner planner;
  Mixer mixer;
  std::vector<Cue> cues;
  SampleTime now = 0;

  explicit ClothRig(const std::shared_ptr<const pack::SoundPack>& pack, spatial::Layout layout = spatial::Layout::kMono,
                    std::shared_ptr<const spatial::Hrtf> hrtf = nullptr)
      : plan_options{7, Mode::kCorrected, 48000, 0, false, 0, cloth::Search::kCausal, layout, hrtf},
        render_options{Mode::kCorrected, 48000, layout, 2, 64, 16, 0, hrtf, 4},
        planner(plan_options),
        mixer(render_options) {
    planner.add_sheet({1, 0, pack, {}}, 0, cues);
    planner.listener({{0, 0, 1}, {0, 0, -1}, {0, 1, 0}}, 0, 0, cues);
  }

  /// Plans observations one after another, rendering after each as far as is settled, or everything afterwards.
  template <class Frames>
  std::vector<std::vector<float>> play(const Frames& frames, int count, double begin_s = 0, bool eager = true) {
    std::vector<std::vector<float>> out(static_cast<std::size_t>(mixer.channels()));
    for (int k = 0; k < count; ++k) {
      planner.plan(frames(k, begin_s), 0, cues);
      if (eager) render(std::max<SampleTime>(0, planner.settled(1)) / kQuantum * kQuantum, out);
    }
    planner.end_sheet(1, 0, cues);
    const auto end = static_cast<SampleTime>((begin_s + count * kFrame_s + 0.5) * 48000);
    render(end / kQuantum * kQuantum, out);
    return out;
  }

  void render(SampleTime until, std::vector<std::vector<float>>& out) {
    for (const Cue& cue : cues) mixer.apply(cue);
    cues.clear();
    std::vector<float> quantum(mixer.quantum_size());
    for (; now + kQuantum <= until; now += kQuantum) {
      mixer.render(now, quantum);
      for (std::size_t c = 0; c < out.size(); ++c) {
        out[c].resize(static_cast<std::size_t>(now + kQuantum));
        for (std::size_t bus = 0; bus < static_cast<std::size_t>(mixer.buses()); ++bus) {
          if (!mixer.sounding(static_cast<Bus>(bus))) continue;
          const float* from = quantum.data() + (bus * out.size() + c) * kQuantum;
          for (std::size_t n = 0; n < kQuantum; ++n) out[c][static_cast<std::size_t>(now) + n] += from[n];
        }
      }
    }
  }
};

double rms(std::span<const float> x) {
  double sum = 0;
  for (const float s : x) sum += static_cast<double>(s) * s;
  return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, x.size())));
}

std::vector<ClothPieceCue> pieces(const std::vector<Cue>& cues) {
  std::vector<ClothPieceCue> out;
  for (const Cue& cue : cues) {
    if (const auto* piece = std::get_if<ClothPieceCue>(&cue)) out.push_back(*piece);
  }
  return out;
}

}  // namespace

TEST_CASE("Cloth sounds while it slides and is silent at rest") {
  ClothRig rig(pack_of("cotton", {.crumples = false}));
  const auto sliding = [](int k, double begin_s) {
    Observation out = frame(k, begin_s);
    out.friction.push_back(contact(1, k >= 60 && k < 120 ? 0.5 : 0));
    return out;
  };
  const auto sound = rig.play(sliding, 240)[0];
  const auto part = [&](double from_s, double to_s) {
    const auto from = static_cast<std::size_t>(from_s * 48000), to = static_cast<std::size_t>(to_s * 48000);
    return std::span(sound).subspan(from, to - from);
  };
  CHECK(rms(part(0, 0.95)) == 0);
  CHECK(rms(part(1.1, 1.9)) > 1e-3);
  CHECK(rms(part(2.5, 4)) == 0);
  CHECK(rig.mixer.silent());
}

TEST_CASE("Cloth is the same however its frames and its sound take turns, and whenever it begins") {
  const auto cotton = pack_of("cotton", {});
  const auto eager = ClothRig(cotton).play(stroking, 150)[0];
  CHECK(rms(eager) > 1e-3);
  CHECK(ClothRig(cotton).play(stroking, 150, 0, false)[0] == eager);
  // 4416 samples, a latency that is declared, later, and as much again.
  constexpr SampleTime kLater = 69 * kQuantum;
  const auto once = ClothRig(cotton).play(stroking, 150, kLater / 48000.0)[0];
  const auto twice = ClothRig(cotton).play(stroking, 150, 2 * kLater / 48000.0)[0];
  CHECK(std::all_of(once.begin(), once.begin() + kLater - 200, [](float x) { return x == 0; }));
  CHECK(std::equal(once.begin(), once.end() - kLater, twice.begin() + kLater));
  // What begins with the session lacks what comes before its first unit.
  CHECK(std::equal(eager.begin() + 4800, eager.end() - kLater, once.begin() + 4800 + kLater));
}

/// Triangles of 20 vertices, numbered upwards or downwards.
std::shared_ptr<const sheet::Topology> numbered(bool upwards) {
  sheet::Topology::Input input;
  input.id = upwards ? 1 : 2;
  input.vertex_count = 20;
  for (std::uint32_t v = 0; v + 2 < 20; ++v)
    input.triangles.push_back(upwards ? sheet::Triangle{v, v + 1, v + 2} : sheet::Triangle{19 - v, 18 - v, 17 - v});
  return *sheet::Topology::make(std::move(input));
}

TEST_CASE("Cloth whose mesh is made anew sounds on as its material slides") {
  const auto up = numbered(true), down = numbered(false);
  enum { kSame, kFollowed, kUnknown };
  const auto play = [&](int remeshed) {
    ClothRig rig(pack_of("cotton", {.crumples = false}));
    const auto sliding = [&](int k, double begin_s) {
      Observation out = frame(k, begin_s);
      // One half of the vertices slides, the other one rests.
      const bool turned = remeshed != kSame && k >= 30;
      out.topology = turned ? down : up;
      out.friction.push_back(contact(0, 0.2 + 0.3 * (k % 2)));
      for (auto& vertex : out.friction[0].vertices) {
        if ((turned ? 19 - vertex.vertex : vertex.vertex) >= 10) vertex.slip_velocity_m_per_s *= 0;
      }
      if (k == 30 && remeshed == kFollowed) {
        for (std::uint32_t v = 0; v < 20; ++v) out.origins.push_back(19 - v);
      }
      return out;
    };
    return rig.play(sliding, 60)[0];
  };
  const auto same = play(kSame);
  REQUIRE(rms(same) > 1e-4);
  CHECK(play(kFollowed) == same);
  CHECK(play(kUnknown) != same);
}

TEST_CASE("Nothing starts before what was settled, and the declared latency is enough at 60 frames a second") {
  ClothRig rig(pack_of("cotton", {}));
  SampleTime settled = rig.planner.settled(1);
  const SampleTime latency = rig.planner.latency();
  CHECK(latency == (6 * 200 + 100 + 1200 + 1200) + kPathLag);
  for (int k = 0; k < 120; ++k) {
    rig.planner.plan(stroking(k), 0, rig.cues);
    if (k > 0) {
      for (const ClothPieceCue& piece : pieces(rig.cues)) REQUIRE(piece.start >= settled);
    }
    rig.cues.clear();
    settled = rig.planner.settled(1);
    REQUIRE(settled >= 800 * k - latency);
  }
}

TEST_CASE("What is due is made of what is known, and no frame is waited for") {
  ClothRig rig(pack_of("cotton", {}));
  for (int k = 0; k < 40; ++k) rig.planner.plan(stroking(k), 0, rig.cues);
  const SampleTime settled = rig.planner.settled(1);
  rig.cues.clear();
  rig.planner.complete(settled + 9600, rig.cues);
  CHECK(rig.planner.settled(1) >= settled + 9600);
  const auto made = pieces(rig.cues);
  REQUIRE_FALSE(made.empty());
  for (const ClothPieceCue& piece : made) CHECK(piece.start >= settled);
  rig.cues.clear();
  rig.planner.complete(settled + 9600, rig.cues);
  CHECK(rig.cues.empty());
}

TEST_CASE("No unit comes again before it has cooled off, in any patch of a sheet") {
  const auto cotton = pack_of("cotton", {});
  ClothRig rig(cotton);
  std::vector<ClothPieceCue> all;
  for (int k = 0; k < 200; ++k) {
    Observation o = stroking(k);
    o.friction.push_back(contact(2, 0.3, {0.4, 0, 0}));
    rig.planner.plan(o, 0, rig.cues);
  }
  all = pieces(rig.cues);
  const auto unit_of = [&](const ClothPieceCue& piece) {
    std::int64_t unit = -1, first = 0;
    for (const auto& recording : cotton->cloth->recordings) {
      const auto& samples = recording.channels[0];
      // The unit of a piece is where its last samples lie; extensions are of their neighbours.
      const float* last = piece.samples + piece.count - 1;
      if (last >= samples.data() && last < samples.data() + samples.size()) unit = first + (last - samples.data()) / 200;
      first += static_cast<std::int64_t>(samples.size() / 200);
    }
    return unit;
  };
  std::map<std::int64_t, std::vector<SampleTime>> when;
  std::set<std::uint64_t> patches;
  for (const ClothPieceCue& piece : all) {
    patches.insert(piece.patch);
    const SampleTime place = piece.until - 200;
    if (piece.first + piece.count == piece.until && unit_of(piece) >= 0) when[unit_of(piece)].push_back(place / 200);
  }
  CHECK(patches.size() == 2);
  CHECK(when.size() > 100);
  for (auto& [unit, places] : when) {
    std::ranges::sort(places);
    for (std::size_t i = 1; i < places.size(); ++i) REQUIRE(places[i] - places[i - 1] > 20);
  }
}

TEST_CASE("Patches are heard from where they are") {
  const auto head = std::make_shared<const spatial::Hrtf>(spatial::structural_head(48000));
  for (const auto layout : {spatial::Layout::kStereo, spatial::Layout::kBinaural}) {
    ClothRig rig(pack_of("cotton", {.crumples = false}), layout, head);
    rig.planner.listener({{0, 0, 0}, {0, 1, 0}, {0, 0, 1}}, 0, 0, rig.cues);
    const auto beside = [](int k, double begin_s) {
      Observation out = frame(k, begin_s);
      out.friction.push_back(contact(1, 0.4, {1, 0, 0}));
      return out;
    };
    const auto sound = rig.play(beside, 120);
    CHECK(rms(sound[1]) > 1.3 * rms(sound[0]));
  }
}

TEST_CASE("A corpus of two channels is chosen for both ears at once and heard as it was recorded") {
  ClothRig rig(pack_of("worn", {.channels = 2}), spatial::Layout::kStereo);
  rig.planner.listener({{0, 0, 0}, {0, 1, 0}, {0, 0, 1}}, 0, 0, rig.cues);
  for (int k = 0; k < 120; ++k) rig.planner.plan(stroking(k), 0, rig.cues);
  std::map<std::int8_t, std::vector<std::pair<SampleTime, std::ptrdiff_t>>> choices;
  const auto pack = pack_of("worn", {.channels = 2});
  const auto& recordings = pack->cloth->recordings;
  for (const ClothPieceCue& piece : pieces(rig.cues)) {
    REQUIRE(piece.channel >= 0);
    if (piece.first + piece.count != piece.until) continue;
    for (const auto& recording : recordings) {
      const auto& samples = recording.channels[static_cast<std::size_t>(piece.channel)];
      const auto at = piece.samples + piece.count - samples.data();
      if (at > 0 && at <= static_cast<std::ptrdiff_t>(samples.size())) choices[piece.channel].emplace_back(piece.until, at);
    }
  }
  CHECK(choices[0].size() > 50);
  CHECK(choices[0] == choices[1]);
  const auto sound = ClothRig(pack_of("worn", {.channels = 2}), spatial::Layout::kStereo).play(stroking, 120);
  CHECK(rms(sound[0]) > 1e-4);
  CHECK(rms(sound[1]) > 1e-4);
}

TEST_CASE("Where cloth touches cloth of another material both sound, by area") {
  const auto cotton = pack_of("cotton", {.crumples = false}), nylon = pack_of("nylon", {.crumples = false, .seed = 5});
  const auto rub = [](int k, double begin_s) {
    Observation out = frame(k, begin_s);
    out.friction.push_back(contact(1, 0.5));
    out.friction.back().touched_surface = "nylon";
    return out;
  };
  ClothRig rig(cotton);
  rig.planner.add_partner(1, "nylon", nylon);
  for (int k = 0; k < 60; ++k) rig.planner.plan(rub(k, 0), 0, rig.cues);
  std::map<std::string, std::size_t> heard;
  for (const ClothPieceCue& piece : pieces(rig.cues)) {
    for (const auto& pack : {cotton, nylon}) {
      for (const auto& recording : pack->cloth->recordings) {
        const auto& samples = recording.channels[0];
        if (piece.samples >= samples.data() && piece.samples < samples.data() + samples.size())
          heard[pack->material] += piece.count;
      }
    }
  }
  CHECK(heard["cotton"] > 20000);
  CHECK(heard["nylon"] > 20000);
  // A surface that is no such cloth is the sheet's own business.
  ClothRig alone(cotton);
  for (int k = 0; k < 60; ++k) alone.planner.plan(rub(k, 0), 0, alone.cues);
  for (const ClothPieceCue& piece : pieces(alone.cues)) {
    for (const auto& recording : nylon->cloth->recordings) {
      const auto& samples = recording.channels[0];
      REQUIRE_FALSE((piece.samples >= samples.data() && piece.samples < samples.data() + samples.size()));
    }
  }
}

TEST_CASE("Cloth makes no paper's sound, and a sheet that becomes paper stops being cloth") {
  ClothRig rig(pack_of("cotton", {}));
  for (int k = 0; k < 60; ++k) rig.planner.plan(stroking(k), 0, rig.cues);
  for (const Cue& cue : rig.cues) {
    CHECK_FALSE(std::holds_alternative<CrumpleCue>(cue));
    CHECK_FALSE(std::holds_alternative<FrictionCue>(cue));
  }
  CHECK(rig.planner.counters().sounds_missing == 0);
  auto paper = std::make_shared<pack::SoundPack>();
  paper->name = paper->material = "paper";
  rig.planner.add_sheet({1, 0, paper, {}}, 0, rig.cues);
  CHECK(rig.planner.latency() == 0);
  rig.cues.clear();
  for (int k = 60; k < 80; ++k) rig.planner.plan(stroking(k), 0, rig.cues);
  CHECK(rig.planner.settled(1) == std::numeric_limits<SampleTime>::max());
  for (const ClothPieceCue& piece : pieces(rig.cues)) CHECK(piece.first < 61 * 800 + 4800);
}

TEST_CASE("Every patch is an emitter, dry") {
  ClothRig rig(pack_of("cotton", {.crumples = false}));
  EmitterSounds emitters(rig.render_options);
  for (int k = 0; k < 60; ++k) {
    Observation o = frame(k);
    o.friction = {contact(1, 0.4, {0, 0, 0}), contact(2, 0.4, {0.5, 0, 0})};
    rig.planner.plan(o, 0, rig.cues);
  }
  for (const Cue& cue : rig.cues) rig.mixer.apply(cue);
  std::vector<float> quantum(rig.mixer.quantum_size());
  std::map<std::uint64_t, std::pair<double, double>> heard;  // energy, place
  double mixed = 0, sum = 0;
  for (SampleTime at = 0; at < 38400; at += kQuantum) {
    rig.mixer.render(at, quantum, &emitters);
    std::array<float, kQuantum> dry{};
    for (const EmitterSound& sound : emitters.sounds()) {
      auto& [energy, place] = heard[sound.id];
      place = sound.position_m.x;
      for (std::size_t n = 0; n < dry.size(); ++n) {
        energy += static_cast<double>(sound.samples[n]) * sound.samples[n];
        dry[n] += sound.samples[n] / static_cast<float>(std::sqrt(1 + place * place));
      }
    }
    const Bus bus = bus_of(0, SoundKind::kFriction);
    for (std::size_t n = 0; n < kQuantum && rig.mixer.sounding(bus); ++n) {
      mixed += std::pow(quantum[bus * kQuantum + n] - dry[n], 2);
      sum += std::pow(dry[n], 2);
    }
  }
  REQUIRE(heard.size() == 2);
  for (const auto& [id, sound] : heard) CHECK(sound.first > 0.01);
  CHECK(mixed < 1e-6 * sum);
}

}  // namespace rustle::synthesis::cloth_tests
