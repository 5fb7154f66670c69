#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "server/apps/cloth_picture.h"
#include "server/apps/command_pack.h"
#include "server/apps/wording.h"
#include "server/report/image_canvas.h"
#include "sound_db/build/correspondences.h"
#include "sound_db/build/recording.h"
#include "sound_db/dsp/resample.h"
#include "sound_db/pack/calibration.h"
#include "sound_db/pack/cloth_write.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/manifest.h"

namespace rustle::apps {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct CalibrateArguments {
  std::string folder, target, correspondences, proposals, events, picture;
  std::optional<double> lambda, speed_divisor, speed_exponent;
  double quantile = 0.5, length_s = 0.1;
  int count = 13;
  bool json = false;
};

/// A complaint, or nothing.
using Outcome = tl::expected<void, std::string>;

/// The corpus, measured anew.
tl::expected<std::pair<std::shared_ptr<const pack::SoundPack>, pack::ClothCorpus>, std::string> measured(
    const std::string& folder) {
  pack::Findings findings;
  const auto manifest = pack::read_manifest(folder, findings);
  if (!manifest) return tl::unexpected(findings.front().what.text());
  pack::LoadOptions options;
  options.rate_hz = manifest->pack.stored_rate_hz;
  options.measure_units = true;
  auto loaded = pack::load(folder, options);
  if (!loaded) return tl::unexpected(loaded.error().text());
  if (!(*loaded)->cloth)
    return tl::unexpected(fmt::format("{}: is a pack of paper; only packs of cloth are calibrated", folder));
  pack::ClothCorpus corpus = *(*loaded)->cloth;
  return std::pair(std::move(*loaded), std::move(corpus));
}

/// A target's channels at the corpus' rate: the file's, its only one for all of the corpus', or a plain one.
tl::expected<std::vector<std::vector<float>>, std::string> target_of(const CalibrateArguments& arguments,
                                                                     const pack::ClothCorpus& corpus) {
  const auto channels = static_cast<std::size_t>(corpus.channels);
  if (arguments.target.empty()) {
    return std::vector(channels, pack::plain_calibration_target(corpus, 1));
  }
  const auto recording = build::read_recording(arguments.target);
  if (!recording)
    return tl::unexpected(fmt::format("{}: {}; render the target as WAV", arguments.target, recording.error()));
  if (recording->channels != 1 && recording->channels != corpus.channels) {
    return tl::unexpected(fmt::format("{}: has {}, the pack {}; render the target with as many, or with one",
                                      arguments.target, counted(static_cast<std::uint64_t>(recording->channels), "channel"),
                                      corpus.channels));
  }
  std::vector<std::vector<float>> result;
  for (std::size_t c = 0; c < channels; ++c) {
    const int channel = recording->channels == 1 ? 1 : static_cast<int>(c) + 1;
    result.push_back(dsp::resample(build::channel_of(*recording, channel), recording->rate_hz, corpus.rate_hz));
  }
  if (result.front().size() < static_cast<std::size_t>(corpus.unit_samples))
    return tl::unexpected(fmt::format("{}: is shorter than a unit; render a longer target", arguments.target));
  return result;
}

/// Amplitudes of the crumpling events of `rustle render --events`.
tl::expected<std::vector<double>, std::string> event_amplitudes(const std::string& file) {
  std::ifstream stream(file);
  if (!stream)
    return tl::unexpected(fmt::format("{}: cannot be read; name the file that `rustle render --events` wrote", file));
  std::vector<double> amplitudes;
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    if (line.empty()) continue;
    const Json event = Json::parse(line, nullptr, false);
    if (!event.is_object())
      return tl::unexpected(fmt::format("{}: line {} is not an event; `rustle render --events` writes them", file, number));
    const auto amplitude = event.find("amplitude");
    if (event.value("amplitude_unit", "") == "m" && amplitude != event.end() && amplitude->is_number())
      amplitudes.push_back(amplitude->get<double>());
  }
  return amplitudes;
}

/// E_min at the quantile, and the histogram from there.
Outcome calibrate_events(const CalibrateArguments& arguments, pack::ClothCorpus& corpus) {
  if (!corpus.crumpling)
    return tl::unexpected(fmt::format("{}: has no crumpling to calibrate; leave --events out", arguments.folder));
  auto amplitudes = event_amplitudes(arguments.events);
  if (!amplitudes) return tl::unexpected(amplitudes.error());
  std::erase_if(*amplitudes, [](double a) { return !(a > 0); });
  if (amplitudes->empty())
    return tl::unexpected(fmt::format("{}: holds no crumpling event; animate the sheet harder", arguments.events));
  std::sort(amplitudes->begin(), amplitudes->end());
  const auto at = static_cast<std::size_t>(arguments.quantile * static_cast<double>(amplitudes->size() - 1));
  corpus.crumpling->event_amplitudes = pack::energy_histogram(*amplitudes, (*amplitudes)[at]);
  return {};
}

Outcome draw(const CalibrateArguments& arguments, const pack::SoundPack& pack, const pack::TargetFeatures& target,
             std::span<const pack::Correspondence> correspondences) {
  report::ImageCanvas canvas(static_cast<int>(kWarpPictureWidth), static_cast<int>(kWarpPictureHeight),
                             report::dark_theme());
  draw_warp(canvas, pack, target, correspondences);
  return report::write_png(arguments.picture, canvas.pixels());
}

void print_report(const CalibrateArguments& arguments, const pack::ClothCorpus& corpus,
                  std::span<const pack::Correspondence> pairs, std::span<const pack::CorrespondenceResidual> residuals) {
  auto list = Json::array();
  if (!arguments.json) fmt::print("  target      corpus    length   units   distance before  after\n");
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const auto& [target_s, database_s, length_s] = pairs[i];
    const auto& [before, after, units] = residuals[i];
    if (!arguments.json) {
      fmt::print("{:8.3f} s {:9.3f} s {:7.3f} s {:7} {:17.2f} {:6.2f}{}\n", target_s, database_s, length_s, units, before,
                 after, units == 0 ? "  beyond the end of either: left out" : "");
    }
    list.push_back({{"target_s", target_s},
                    {"database_s", database_s},
                    {"length_s", length_s},
                    {"units", units},
                    {"distance_before", before},
                    {"distance_after", after}});
  }
  const auto* events =
      corpus.crumpling && !corpus.crumpling->event_amplitudes.counts.empty() ? &corpus.crumpling->event_amplitudes : nullptr;
  if (arguments.json) {
    Json report{{"pack", arguments.folder},
                {"units", corpus.units()},
                {"lambda", corpus.selection.lambda},
                {"speed_divisor", corpus.friction.compression.divisor},
                {"speed_exponent", corpus.friction.compression.exponent},
                {"nodes", corpus.causal.warp.node_count()},
                {"proposed", arguments.correspondences.empty()},
                {"correspondences", list}};
    if (events) report["events"] = {{"least_m", events->least}, {"most_m", events->most}};
    fmt::print("{}\n", report.dump());
    return;
  }
  fmt::print("{}: {} measured, warp of {} fitted to {} {} with λ {:g}\n", arguments.folder, counted(corpus.units(), "unit"),
             counted(corpus.causal.warp.node_count(), "node"), arguments.correspondences.empty() ? "proposed" : "given",
             pairs.size() == 1 ? "correspondence" : "correspondences", corpus.selection.lambda);
  if (events) fmt::print("crumpling events from {:.4g} to {:.4g} m sound\n", events->least, events->most);
}

int run_calibrate(const CalibrateArguments& arguments) {
  if (!arguments.picture.empty() && fs::path(arguments.picture).extension() != ".png")
    return complain(fmt::format("{}: pictures are .png; name one with --picture", arguments.picture), kWrongUsage);
  auto loaded = measured(arguments.folder);
  if (!loaded) return complain(loaded.error(), kFailed);
  auto& [pack, corpus] = *loaded;
  if (arguments.lambda) corpus.selection.lambda = *arguments.lambda;
  pack::SpeedCompression& compression = corpus.friction.compression;
  compression.divisor = arguments.speed_divisor.value_or(compression.divisor);
  compression.exponent = arguments.speed_exponent.value_or(compression.exponent);
  const auto channels = target_of(arguments, corpus);
  if (!channels) return complain(channels.error(), kFailed);
  const pack::TargetFeatures target = pack::target_features(corpus, *channels);

  std::vector<pack::Correspondence> pairs;
  if (!arguments.correspondences.empty()) {
    const auto read = build::read_correspondences(arguments.correspondences);
    if (!read) return complain(fmt::format("{}: {}; correct the file", arguments.correspondences, read.error()), kFailed);
    pairs = *read;
  } else {
    pairs = pack::proposed_correspondences(corpus, target, arguments.count, arguments.length_s);
    if (pairs.empty())
      return complain(fmt::format("{}: too short to propose correspondences; give them with --correspondences",
                                  arguments.target.empty() ? arguments.folder : arguments.target),
                      kFailed);
  }
  const auto residuals = pack::calibrate(corpus, target, pairs);
  if (std::none_of(residuals.begin(), residuals.end(), [](const auto& r) { return r.units > 0; }))
    return complain(
        fmt::format("{}: every correspondence lies beyond the end of the target or the corpus; correct the times",
                    arguments.correspondences),
        kFailed);
  if (!arguments.events.empty()) {
    if (const auto done = calibrate_events(arguments, corpus); !done) return complain(done.error(), kFailed);
  }
  if (!arguments.proposals.empty()) {
    const auto done = report::write_file(arguments.proposals, build::correspondences_text(pairs));
    if (!done) return complain(done.error(), kFailed);
  }
  if (!arguments.picture.empty()) {
    pack::SoundPack drawn = *pack;
    drawn.cloth = std::make_shared<const pack::ClothCorpus>(corpus);
    if (const auto done = draw(arguments, drawn, target, pairs); !done) return complain(done.error(), kFailed);
  }
  if (const auto done = pack::write_calibration(corpus, arguments.folder); !done)
    return complain(done.error().text(), kFailed);
  print_report(arguments, corpus, pairs, residuals);
  return kDone;
}

}  // namespace

void add_pack_calibrate(CLI::App& pack, Action& action) {
  auto arguments = std::make_shared<CalibrateArguments>();
  auto* command = pack.add_subcommand("calibrate", "Measure a pack of cloth anew and fit its warp and crumpling energies");
  command->footer(
      "Example: rustle pack calibrate my-denim/ --target target.wav --correspondences pairs.csv --picture warp.png\n"
      "         rustle pack calibrate my-denim/ --write-correspondences pairs.csv   # proposals, to start from\n"
      "Features are measured anew from the recordings, as is needed when one was replaced. The warp leads features of the\n"
      "target (a calibration animation's friction and crumpling, before units are chosen; without --target plain sliding "
      "and\n"
      "crumpling of the pack) to the corpus'. Correspondences say which stretch of the corpus a stretch of the target "
      "shall\n"
      "sound like: lines of \"target_s, database_s, length_s\" in seconds, the corpus counted through its recordings' "
      "whole\n"
      "units in the manifest's order. Without --correspondences they are proposed: clips of equal rank in loudness.");
  command->add_option("PACK", arguments->folder, "The pack's folder; its features, warp and pack.json are replaced")
      ->required();
  command->add_option("--target", arguments->target, "The target's sound, WAV, FLAC or OGG");
  command->add_option("--correspondences", arguments->correspondences, "CSV file of target_s, database_s, length_s");
  command->add_option("--write-correspondences", arguments->proposals, "Write those that were used to this file");
  command->add_option("--count", arguments->count, "How many to propose, silence aside; 13 when absent")
      ->check(CLI::Range(1, 200));
  command->add_option("--length", arguments->length_s, "Of proposed clips, in s; 0.1 when absent")
      ->check(CLI::Range(0.01, 10.0));
  command->add_option("--lambda", arguments->lambda, "The warp's regularization; the pack's when absent")
      ->check(CLI::Range(0.0, 1e15));
  command
      ->add_option("--speed-divisor", arguments->speed_divisor,
                   "Of the sheet's sliding speeds, (s / divisor)^exponent in m/s, where an animation is faster than was "
                   "measured; the pack's when absent, at first 1")
      ->check(CLI::Range(0.01, 100.0));
  command
      ->add_option("--speed-exponent", arguments->speed_exponent,
                   "Above 1 it subdues slow contacts, as of stiff cloth that is simulated with difficulty; the pack's when "
                   "absent, at first 1")
      ->check(CLI::Range(0.1, 10.0));
  command->add_option("--events", arguments->events,
                      "Events of the calibration animation, as `rustle render --events` writes them: crumpling energies");
  command
      ->add_option("--quantile", arguments->quantile, "Of the events' amplitudes: smaller ones are silent; 0.5 when absent")
      ->check(CLI::Range(0.0, 1.0));
  command->add_option("--picture", arguments->picture, "PNG of target and corpus in feature space, before and after");
  command->add_flag("--json", arguments->json, "Print as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run_calibrate(*arguments); }; });
}

}  // namespace rustle::apps
