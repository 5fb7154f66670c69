#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/apps/command.h"
#include "server/apps/comparison_page.h"
#include "server/comparison/event_matching.h"
#include "server/comparison/sound_difference.h"
#include "server/report/image_canvas.h"
#include "sound_db/pack/audio_file.h"

namespace rustle::apps {
namespace {

using Json = nlohmann::ordered_json;

struct CompareArguments {
  std::string reference, other, report;
  std::vector<std::string> events;
  double tolerance_ms = 20;
  bool json = false;
};

tl::expected<std::string, std::string> text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(file), {}};
  if (!file.is_open() || file.bad()) return tl::unexpected(fmt::format("{}: cannot be read", path));
  return text;
}

tl::expected<std::vector<comparison::ListedEvent>, std::string> events_of(const std::string& path) {
  const auto text = text_of(path);
  if (!text) return tl::unexpected(text.error());
  auto events = comparison::read_event_list(*text);
  if (!events) return tl::unexpected(fmt::format("{}: {}", path, events.error()));
  return std::move(*events);
}

/// The mean of the channels.
std::vector<float> mono(const pack::MultichannelClip& clip) {
  std::vector<float> out(clip.channels[0].size(), 0.0f);
  const float share = 1 / static_cast<float>(clip.channels.size());
  for (const auto& channel : clip.channels) {
    for (std::size_t n = 0; n < out.size(); ++n) out[n] += share * channel[n];
  }
  return out;
}

tl::expected<ComparedSounds, std::string> compare_sounds(const CompareArguments& arguments) {
  const auto reference = pack::read_multichannel(arguments.reference), other = pack::read_multichannel(arguments.other);
  if (!reference) return tl::unexpected(reference.error());
  if (!other) return tl::unexpected(other.error());
  if (reference->rate_hz != other->rate_hz) {
    return tl::unexpected(fmt::format("{} has {} Hz and {} {} Hz; render both at one rate (`rustle render --rate`)",
                                      arguments.reference, reference->rate_hz, arguments.other, other->rate_hz));
  }
  const std::vector<float> a = mono(*reference), b = mono(*other);
  ComparedSounds out{comparison::compare_sounds(a, b, reference->rate_hz)};
  out.difference.identical = reference->channels == other->channels;
  return out;
}

tl::expected<ComparedEvents, std::string> compare_events(const CompareArguments& arguments) {
  ComparedEvents out;
  auto reference = events_of(arguments.events[0]), other = events_of(arguments.events[1]);
  if (!reference) return tl::unexpected(reference.error());
  if (!other) return tl::unexpected(other.error());
  out.reference = std::move(*reference), out.other = std::move(*other);
  const double tolerance_s = arguments.tolerance_ms / 1000;
  out.pairs = comparison::match_events(out.reference, out.other, tolerance_s);
  out.scores.emplace_back("all", comparison::score_events(out.reference, out.other, out.pairs));
  std::set<std::string> kinds;
  for (const auto* list : {&out.reference, &out.other}) {
    for (const auto& event : *list) kinds.insert(event.kind);
  }
  for (const std::string& kind : kinds) {
    const auto of_kind = [&kind](const std::vector<comparison::ListedEvent>& list) {
      std::vector<comparison::ListedEvent> part;
      std::copy_if(list.begin(), list.end(), std::back_inserter(part),
                   [&](const auto& event) { return event.kind == kind; });
      return part;
    };
    const auto a = of_kind(out.reference), b = of_kind(out.other);
    out.scores.emplace_back(kind, comparison::score_events(a, b, comparison::match_events(a, b, tolerance_s)));
  }
  return out;
}

Json json_of(const ComparedSounds& sounds) {
  const auto& d = sounds.difference;
  Json bands = Json::array();
  for (const auto& band : d.bands) {
    bands.push_back({{"centre_hz", band.centre_hz}, {"reference_db", band.reference_db}, {"other_db", band.other_db}});
  }
  return {{"identical", d.identical},
          {"level_dbfs", {{"reference", d.reference_db}, {"other", d.other_db}}},
          {"level_correlation", d.level_correlation},
          {"mean_level_difference_db", d.mean_level_difference_db},
          {"centroid_hz", {{"reference", d.reference_centroid_hz}, {"other", d.other_centroid_hz}}},
          {"mean_band_difference_db", d.mean_band_difference_db},
          {"bands", bands}};
}

Json json_of(const ComparedEvents& events) {
  Json out = Json::object();
  for (const auto& [kind, score] : events.scores) {
    out[kind] = {{"reference", score.reference},
                 {"other", score.other},
                 {"matched", score.matched},
                 {"precision", score.precision},
                 {"recall", score.recall},
                 {"timing_error_ms", {{"median", 1000 * score.median_error_s}, {"p95", 1000 * score.p95_error_s}}},
                 {"bias_ms", 1000 * score.bias_s},
                 {"amplitude_db", score.amplitude_db}};
  }
  return out;
}

void print(const ComparedSounds& sounds) {
  const auto& d = sounds.difference;
  if (d.identical) {
    fmt::print("sound: the same, sample for sample ({:.1f} dBFS)\n", d.reference_db);
    return;
  }
  fmt::print("level:    {:.1f} dBFS, reference {:.1f}; course correlates by {:.3f}, {:.1f} dB apart in the mean\n",
             d.other_db, d.reference_db, d.level_correlation, d.mean_level_difference_db);
  fmt::print(
      "spectrum: centroid {:.0f} Hz, reference {:.0f}; third octaves {:.1f} dB apart in the mean, levels made equal\n",
      d.other_centroid_hz, d.reference_centroid_hz, d.mean_band_difference_db);
}

void print(const ComparedEvents& events) {
  fmt::print("{:10} {:>9} {:>7} {:>8} {:>10} {:>7} {:>10} {:>8} {:>8} {:>10}\n", "events", "reference", "other", "matched",
             "precision", "recall", "median ms", "p95 ms", "bias ms", "amplitude");
  for (const auto& [kind, score] : events.scores) {
    fmt::print("{:10} {:>9} {:>7} {:>8} {:>10.3f} {:>7.3f} {:>10.2f} {:>8.2f} {:>+8.2f} {:>+7.2f} dB\n", kind,
               score.reference, score.other, score.matched, score.precision, score.recall, 1000 * score.median_error_s,
               1000 * score.p95_error_s, 1000 * score.bias_s, score.amplitude_db);
  }
}

int run(const CompareArguments& arguments) {
  Comparison compared{arguments.reference, arguments.other, arguments.tolerance_ms, {}, {}};
  std::vector<std::string> inputs{arguments.reference, arguments.other};
  inputs.insert(inputs.end(), arguments.events.begin(), arguments.events.end());
  if (const auto conflict = output_conflict(inputs, {arguments.report}); !conflict.empty()) {
    return complain(conflict, kWrongUsage);
  }
  auto sounds = compare_sounds(arguments);
  if (!sounds) return complain(sounds.error(), kFailed);
  compared.sounds = std::move(*sounds);
  if (!arguments.events.empty()) {
    auto events = compare_events(arguments);
    if (!events) return complain(events.error(), kFailed);
    compared.events = std::move(*events);
  }
  if (arguments.json) {
    Json out{{"sound", json_of(compared.sounds)}};
    if (compared.events) out["events"] = json_of(*compared.events);
    fmt::print("{}\n", out.dump());
  } else {
    print(compared.sounds);
    if (compared.events) print(*compared.events);
  }
  if (!arguments.report.empty()) {
    const auto written = report::write_file(arguments.report, comparison_page(compared));
    if (!written) return complain(written.error(), kFailed);
  }
  return kDone;
}

}  // namespace

void add_compare(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<CompareArguments>();
  auto* command = app.add_subcommand("compare", "Hold two sounds of the same motion, and their events, against each other");
  command->footer(
      "Example: rustle render flag.mcap -o a.wav --events a.jsonl\n"
      "         rustle render flag.mcap -o b.wav --events b.jsonl --mode published\n"
      "         rustle compare a.wav b.wav --events a.jsonl b.jsonl --report difference.html\n"
      "Events match one to one: same sheet, same kind, at most --tolerance apart. Channels are compared in their mean.");
  command->add_option("REFERENCE", arguments->reference, "WAV or FLAC file that is held to be right")->required();
  command->add_option("OTHER", arguments->other, "WAV or FLAC file that is compared with it")->required();
  command->add_option("--events", arguments->events, "Their event lists, as `rustle render --events` writes them")
      ->expected(2);
  command->add_option("--tolerance", arguments->tolerance_ms, "Milliseconds between events that are the same")
      ->check(CLI::Range(0.0, 10000.0))
      ->capture_default_str();
  command->add_option("--report", arguments->report, "HTML page to write: levels, spectra and events in pictures");
  command->add_flag("--json", arguments->json, "Print the figures as one line of JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
