#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "server/apps/command_pack.h"
#include "server/apps/wording.h"
#include "server/sinks/wav.h"
#include "server/synthesis/mixer.h"
#include "server/synthesis/planner.h"
#include "sound_db/dsp/level.h"
#include "sound_db/pack/query.h"

namespace rustle::apps {
namespace {

using observation::Resonator;

struct PlayArguments {
  std::string pack, output = "pack.wav", kind;
  std::optional<double> l_r_m, l_c_m;
  std::optional<double> speed_m_per_s;
  double seconds = 1.5;
  std::uint32_t rate_hz = 0;
  bool json = false;
};

constexpr double kSpeed_m_per_s = 0.1, kPause_s = 0.35, kFlap_s = 0.9, kClac_s = 0.4, kRamp_s = 0.1;
constexpr int kTimes = 3;  // that a grid point's units are heard
constexpr std::size_t kMostPoints = 12;

/// One thing heard on the tour.
struct Stop {
  double from_s = 0, to_s = 0;
  bool friction = false;
  pack::GridPoint point;
  double level_dbfs = 0;  // peak of crumpling, RMS of friction
};

using PointKey = std::pair<double, double>;

/// The points of a section, (0,0) first; of many, some evenly spread.
template <class Entry>
std::vector<pack::GridPoint> points_of(const std::vector<Entry>& entries) {
  std::set<PointKey> points;
  for (const auto& entry : entries) points.insert({entry.point.ruling_length_m, entry.point.free_border_length_m});
  const std::vector<PointKey> all(points.begin(), points.end());
  std::vector<pack::GridPoint> some;
  const std::size_t count = std::min(all.size(), kMostPoints);
  for (std::size_t i = 0; i < count; ++i) {
    const auto& [l_r, l_c] = all[count == 1 ? 0 : i * (all.size() - 1) / (count - 1)];
    some.push_back({l_r, l_c});
  }
  return some;
}

/// A sheet lying at the origin, seen along its normal from the listener at 1 m.
Resonator resonator_at(const pack::GridPoint& point) {
  Resonator r;
  r.constrained = point.constrained();
  r.ruling_length_m = point.ruling_length_m;
  r.free_border_length_m = point.free_border_length_m;
  r.area_m2 = r.constrained ? 0.01 : point.ruling_length_m * point.free_border_length_m / 2;
  r.disc_radius_m = std::sqrt(r.area_m2 / std::numbers::pi);
  return r;
}

/// Planner and mixer with one sheet and the listener at 1 m on its axis, no planes: what is heard is the dry emission.
class Audition {
 public:
  explicit Audition(std::shared_ptr<const pack::SoundPack> pack)
      : pack_(std::move(pack)),
        plan_{1, synthesis::Mode::kCorrected, pack_->rate_hz, 0},
        planner_(plan_),
        mixer_(render_options()) {
    planner_.add_sheet({kSheet, 0, pack_, {}}, 0, cues_);
    planner_.listener({{0, 0, 1}, {0, 0, -1}, {0, 1, 0}}, 0, 0, cues_);
  }

  /// An event of the amplitude that the unit was made for.
  void strike(const pack::GridPoint& point, double time_s) {
    auto observation = frame(time_s);
    observation::CrumplingEvent event;
    event.id = ++last_id_;
    event.time_s = event.confirmed_s = time_s;
    event.amplitude_m = pack_->crumpling->reference_amplitude_m(point);
    event.resonators = {resonator_at(point)};
    event.area_m2 = event.resonators[0].area_m2;
    observation.crumpling.push_back(std::move(event));
    plan(observation);
  }

  /// Slides from from_s to to_s, a tenth of a second up to its speed and down again.
  void slide(const pack::GridPoint& point, double speed_m_per_s, double from_s, double to_s) {
    observation::FrictionContact contact;
    contact.id = ++last_id_;
    contact.resonators = {resonator_at(point)};
    contact.area_m2 = contact.resonators[0].area_m2;
    contact.touched_surface = pack_->touched_surface;
    plan(frame(from_s));
    for (const auto& [time_s, speed] :
         {std::pair{from_s + kRamp_s, speed_m_per_s}, {to_s - kRamp_s, speed_m_per_s}, {to_s, 0.0}}) {
      auto observation = frame(time_s);
      contact.speed_m_per_s = speed;
      observation.friction = {contact};
      plan(observation);
    }
    plan(frame(to_s + kRamp_s));
  }

  /// Everything up to end_s, mono.
  std::vector<float> render(double end_s, const std::function<void(double)>& progress) {
    planner_.release(INT64_MAX, cues_);
    for (const synthesis::Cue& cue : cues_) mixer_.apply(cue);
    cues_.clear();
    std::vector<float> out(static_cast<std::size_t>(std::ceil(end_s * pack_->rate_hz)), 0.0f);
    std::vector<float> quantum(mixer_.quantum_size());
    for (std::size_t start = 0; start < out.size(); start += synthesis::kQuantum) {
      mixer_.render(static_cast<synthesis::SampleTime>(start), quantum);
      const std::size_t count = std::min<std::size_t>(synthesis::kQuantum, out.size() - start);
      for (int bus = 0; bus < mixer_.buses(); ++bus) {
        if (!mixer_.sounding(static_cast<synthesis::Bus>(bus))) continue;
        for (std::size_t n = 0; n < count; ++n)
          out[start + n] += quantum[static_cast<std::size_t>(bus) * synthesis::kQuantum + n];
      }
      progress(static_cast<double>(start) / static_cast<double>(out.size()));
    }
    return out;
  }

 private:
  static constexpr sheet::SheetId kSheet = 1;

  synthesis::RenderOptions render_options() const {
    synthesis::RenderOptions options;
    options.rate_hz = pack_->rate_hz;
    options.max_sheets = 1;
    return options;
  }

  observation::Observation frame(double time_s) {
    observation::Observation observation;
    observation.sheet = kSheet;
    observation.previous_time_s = last_s_;
    observation.time_s = last_s_ = time_s;
    return observation;
  }

  void plan(const observation::Observation& observation) { planner_.plan(observation, 0, cues_); }

  std::shared_ptr<const pack::SoundPack> pack_;
  synthesis::PlanOptions plan_;
  synthesis::Planner planner_;
  synthesis::Mixer mixer_;
  std::vector<synthesis::Cue> cues_;
  std::uint64_t last_id_ = 0;
  double last_s_ = 0;
};

/// Where the tour stops, in its order: clacs and flaps, then slides.
std::vector<Stop> tour_of(const pack::SoundPack& pack, const PlayArguments& arguments) {
  std::optional<pack::GridPoint> only;
  if (arguments.l_r_m) only = pack::GridPoint{*arguments.l_r_m, *arguments.l_c_m};
  std::vector<Stop> stops;
  double time_s = kPause_s;
  if (pack.crumpling && arguments.kind != "friction") {
    for (const auto& point : only ? std::vector{*only} : points_of(pack.crumpling->units)) {
      const bool clac = point.constrained();
      if (!arguments.kind.empty() && (arguments.kind == "clac") != clac) continue;
      const auto variants = pack::nearest_variants(*pack.crumpling, point);
      if (variants.empty()) continue;
      for (int i = 0; i < std::min(kTimes, static_cast<int>(variants.size())); ++i) {
        double lasts_s = clac ? kClac_s : kFlap_s;
        for (const auto v : variants) {
          lasts_s = std::max(lasts_s, static_cast<double>(pack.crumpling->units[v].samples.size()) / pack.rate_hz + 0.1);
        }
        stops.push_back({time_s, time_s + lasts_s, false, point, 0});
        time_s += lasts_s;
      }
      time_s += kPause_s;
    }
  }
  if (pack.friction && (arguments.kind.empty() || arguments.kind == "friction")) {
    for (const auto& point : only ? std::vector{*only} : points_of(pack.friction->spectra)) {
      if (!pack::nearest_spectrum(*pack.friction, point)) continue;
      stops.push_back({time_s, time_s + arguments.seconds, true, point, 0});
      time_s += arguments.seconds + kPause_s;
    }
  }
  return stops;
}

std::string misuse(const PlayArguments& arguments) {
  if (arguments.l_r_m.has_value() != arguments.l_c_m.has_value())
    return "--l-r and --l-c go together: a sheet's ruling length and its free border length in m";
  if (arguments.l_r_m && (*arguments.l_r_m > 0) != (*arguments.l_c_m > 0))
    return "--l-r and --l-c are both above 0, or both 0 for constrained sounds";
  if (arguments.l_r_m && !arguments.kind.empty() && arguments.kind != "friction" &&
      (arguments.kind == "clac") == (*arguments.l_r_m > 0)) {
    return "clacs are at --l-r 0 --l-c 0, flaps above; leave --l-r and --l-c out, or correct --class";
  }
  return output_conflict({}, {arguments.output});
}

int run_play(const PlayArguments& arguments) {
  if (const auto wrong = misuse(arguments); !wrong.empty()) return complain(wrong, kWrongUsage);
  const auto pack = load_pack_or_complain(arguments.pack, arguments.rate_hz);
  if (!pack) return kFailed;
  if (pack->cloth) {
    if (arguments.l_r_m || arguments.kind == "flap" || arguments.kind == "clac")
      return complain(
          fmt::format("{}: is a pack of cloth: it has no grid, and is heard with --class friction, crumpling or corpus",
                      arguments.pack),
          kWrongUsage);
    return play_cloth(*pack, {arguments.output, arguments.kind, arguments.speed_m_per_s, arguments.seconds, arguments.json});
  }
  if (arguments.kind == "crumpling" || arguments.kind == "corpus")
    return complain(fmt::format("{}: is a pack of paper: it is heard with --class flap, clac or friction", arguments.pack),
                    kWrongUsage);
  std::vector<Stop> stops = tour_of(*pack, arguments);
  if (stops.empty()) {
    return complain(fmt::format("{}: has no {} to play; `rustle pack check` says what it lacks", arguments.pack,
                                arguments.kind.empty() ? "sound" : arguments.kind),
                    kFailed);
  }
  Audition audition(pack);
  for (const Stop& stop : stops) {
    if (stop.friction) {
      audition.slide(stop.point, arguments.speed_m_per_s.value_or(kSpeed_m_per_s), stop.from_s, stop.to_s);
    } else {
      audition.strike(stop.point, stop.from_s);
    }
  }
  std::vector<float> sound;
  {
    Progress progress("playing " + pack->name);
    sound = audition.render(stops.back().to_s + kPause_s, [&](double share) { progress.show(share); });
  }
  const double peak = dsp::peak(sound);
  const float gain = peak > 1 ? static_cast<float>(1 / peak) : 1.0f;
  for (float& x : sound) x *= gain;
  auto writer = sinks::WavWriter::create(arguments.output, static_cast<int>(pack->rate_hz), 1, sinks::WavFormat::kInt24);
  if (!writer) return complain(writer.error(), kFailed);
  if (auto written = writer->write(sound); !written) return complain(written.error(), kFailed);
  if (auto closed = writer->close(); !closed) return complain(closed.error(), kFailed);

  auto list = nlohmann::ordered_json::array();
  for (Stop& stop : stops) {
    const auto from = static_cast<std::size_t>((stop.from_s + (stop.friction ? kRamp_s : 0)) * pack->rate_hz);
    const auto to = static_cast<std::size_t>((stop.to_s - (stop.friction ? kRamp_s : 0)) * pack->rate_hz);
    const auto part = std::span(sound).subspan(from, to - from);
    stop.level_dbfs = stop.friction ? dsp::rms_dbfs(part) : dsp::peak_dbfs(part);
    const char* what = stop.friction ? "friction" : stop.point.constrained() ? "clac" : "flap";
    if (!arguments.json) {
      fmt::print("{:8.2f} s  {:<8}  {:<24} {} {:.1f} dBFS\n", stop.from_s, what, place_text(stop.point),
                 stop.friction ? "RMS" : "peak", stop.level_dbfs);
    }
    list.push_back({{"from_s", stop.from_s},
                    {"to_s", stop.to_s},
                    {"class", what},
                    {"l_r_m", stop.point.ruling_length_m},
                    {"l_c_m", stop.point.free_border_length_m},
                    {stop.friction ? "rms_dbfs" : "peak_dbfs", stop.level_dbfs}});
  }
  if (arguments.json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"output", arguments.output},
                                              {"pack", pack->name},
                                              {"rate_hz", pack->rate_hz},
                                              {"gain_db", dsp::gain_to_db(gain)},
                                              {"sounds", list}}
                           .dump());
  } else {
    fmt::print("{}: {} of {}, dry at 1 m on the axis{}\n", arguments.output, counted(stops.size(), "sound"), pack->name,
               gain < 1 ? fmt::format(", lowered by {:.1f} dB to fit", -dsp::gain_to_db(gain)) : "");
  }
  return kDone;
}

}  // namespace

void add_pack_play(CLI::App& pack, Action& action) {
  auto arguments = std::make_shared<PlayArguments>();
  auto* command = pack.add_subcommand("play", "Render what a pack sounds like to a WAV file");
  command->footer(
      "Example: rustle pack play printer-paper -o tour.wav\n"
      "         rustle pack play my-paper/ --class friction --l-r 0.1 --l-c 0.2 --speed 0.3 -o slide.wav\n"
      "A tour of clacs, flaps and slides over the pack's grid, through the same synthesis as a render: events of the\n"
      "amplitude the units were made for, dry, heard at 1 m on the axis. Of cloth: friction at several speeds, crumpling "
      "from\n"
      "soft to loud, and the corpus, as recorded.");
  command->add_option("PACK", arguments->pack, "The pack's folder, or a material that is found")->required();
  command->add_option("-o,--output", arguments->output, "WAV file to write; pack.wav when absent");
  command->add_option("--class", arguments->kind, "Only these sounds")
      ->check(CLI::IsMember({"flap", "clac", "friction", "crumpling", "corpus"}));
  command->add_option("--l-r", arguments->l_r_m, "Only a sheet of this ruling length in m; the nearest in the pack sounds")
      ->check(CLI::Range(0.0, 10.0));
  command->add_option("--l-c", arguments->l_c_m, "Its free border length in m")->check(CLI::Range(0.0, 10.0));
  command
      ->add_option("--speed", arguments->speed_m_per_s,
                   "Of slides, in m/s; 0.1 when absent, for cloth five over the measured range")
      ->check(CLI::Range(0.001, 10.0));
  command->add_option("--seconds", arguments->seconds, "How long each slide lasts; 1.5 when absent")
      ->check(CLI::Range(0.5, 60.0));
  command->add_option("--rate", arguments->rate_hz, "Rate in Hz; the pack's when absent")->check(CLI::Range(8000, 192000));
  command->add_flag("--json", arguments->json, "Print what is heard when as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run_play(*arguments); }; });
}

}  // namespace rustle::apps
