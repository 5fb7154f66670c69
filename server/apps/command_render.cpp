#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "server/apps/capture_source.h"
#include "server/apps/command.h"
#include "server/apps/directed_source.h"
#include "server/apps/emitter_files.h"
#include "server/apps/gain_text.h"
#include "server/apps/render_report.h"
#include "server/apps/wording.h"
#include "server/session/offline.h"
#include "server/session/settled_options.h"
#include "server/sinks/event_log.h"
#include "server/sinks/wav.h"
#include "server/spatial/hrtf_choice.h"
#include "server/wire/topics.h"

namespace rustle::apps {
namespace {

struct RenderArguments {
  std::string capture, output, material, channels, hrtf, mode, format = "f32", fine_events = "auto", cloth_features,
                                                               listener, facing, stems, emitters, events, report;
  std::vector<std::string> gains;
  int friction_fft_size = 0;
  std::optional<std::uint64_t> seed;
  int block_size = 128;
  int workers = 1;
  int rate_hz = 0;
  double gain_db = 0;
  bool ignore_decisions = false;
  bool json = false;
};

std::optional<sheet::Vec3d> parse_point(const std::string& text) {
  sheet::Vec3d point;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%lf,%lf,%lf%c", &point.x(), &point.y(), &point.z(), &rest) != 3 || !point.allFinite())
    return std::nullopt;
  return point;
}

sinks::WavFormat wav_format(const std::string& name) {
  if (name == "s16") return sinks::WavFormat::kInt16;
  return name == "s24" ? sinks::WavFormat::kInt24 : sinks::WavFormat::kFloat32;
}

/// By name, or as the session says where none is given.
cloth::Search cloth_search(const std::string& name, session::ClothFeatures sessions) {
  if (name == "symmetric" || (name.empty() && sessions == session::ClothFeatures::kSymmetric))
    return cloth::Search::kSymmetric;
  if (name == "global" || (name.empty() && sessions == session::ClothFeatures::kGlobal)) return cloth::Search::kGlobal;
  return cloth::Search::kCausal;
}

/// What is to be said of gains that concern no sheet that was seen.
std::vector<std::string> unused_gains(const engine::Options& options, const RenderFacts& facts) {
  std::vector<std::string> out;
  for (const auto& gain : options.gains) {
    std::string sheets;
    bool concerned = false;
    for (const auto& [id, sheet] : facts.sheets) {
      const std::string material =
          options.every_material.value_or(sheet.material.empty() ? options.default_material : sheet.material);
      concerned |= gain.sheet_id.value_or(id) == id && (gain.material.empty() || gain.material == material);
      sheets += fmt::format("{}sheet {} of {}", sheets.empty() ? "" : ", ", id, material);
    }
    if (!concerned)
      out.push_back(
          fmt::format("--gain {} concerns no sheet; there is: {}", to_text(gain), sheets.empty() ? "none" : sheets));
  }
  return out;
}

/// A stem per sheet and kind, in a file of its own from the first time it sounds.
class StemFiles {
 public:
  StemFiles(std::filesystem::path folder, int rate_hz, int channels, sinks::WavFormat format)
      : folder_(std::move(folder)), rate_hz_(rate_hz), channels_(channels), format_(format) {}

  tl::expected<void, std::string> write(const engine::AudioQuantum& quantum) {
    for (std::size_t bus = 0; bus < quantum.stems.size(); ++bus) {
      const auto& samples = quantum.stems[bus];
      auto file = files_.find(bus);
      if (file == files_.end()) {
        if (std::all_of(samples.begin(), samples.end(), [](float x) { return x == 0; })) continue;
        const auto index = static_cast<std::size_t>(synthesis::sheet_of(static_cast<synthesis::Bus>(bus)));
        const auto name = fmt::format("sheet-{}-{}.wav", quantum.sheets[index],
                                      wire::kind_name(synthesis::kind_of(static_cast<synthesis::Bus>(bus))));
        auto created = sinks::WavWriter::create(folder_ / name, rate_hz_, channels_, format_);
        if (!created) return tl::unexpected(created.error());
        file = files_.emplace(bus, std::move(*created)).first;
        const std::vector<float> silence(static_cast<std::size_t>(channels_) * synthesis::kQuantum);
        for (std::int64_t at = 0; at < quantum.first_sample; at += synthesis::kQuantum) {
          if (auto written = file->second.write(silence); !written) return written;
        }
      }
      if (auto written = file->second.write(samples); !written) return written;
    }
    return {};
  }

  tl::expected<void, std::string> close() {
    for (auto& [bus, file] : files_) {
      if (auto closed = file.close(); !closed) return closed;
    }
    return {};
  }

 private:
  std::filesystem::path folder_;
  int rate_hz_, channels_;
  sinks::WavFormat format_;
  std::map<std::size_t, sinks::WavWriter> files_;
};

tl::expected<void, std::string> write_emitters(const engine::AudioQuantum& quantum, EmitterFiles& files) {
  for (const synthesis::EmitterSound& sound : quantum.emitters->sounds()) {
    const auto point = [](const spatial::Vec3& v) { return sheet::Vec3d(v.x, v.y, v.z); };
    const auto written =
        files.add({.emitter = sound.id,
                   .sheet = quantum.sheets[static_cast<std::size_t>(synthesis::sheet_of(sound.bus))],
                   .kind = wire::kind_name(synthesis::kind_of(sound.bus)),
                   .first_sample = quantum.first_sample,
                   .position_m = point(sound.position_m),
                   .normal = point(sound.normal),
                   .last = sound.last,
                   .missing = 0,
                   .samples = sound.last ? std::span<const float>() : std::span<const float>(sound.samples)});
    if (!written) return written;
  }
  return {};
}

/// Hands quanta on in blocks of the size asked for, as a sound card would take them.
class Blocks {
 public:
  Blocks(int samples, int channels) : size_(static_cast<std::size_t>(samples) * static_cast<std::size_t>(channels)) {}

  template <typename Write>
  tl::expected<void, std::string> add(std::span<const float> interleaved, const Write& write) {
    waiting_.insert(waiting_.end(), interleaved.begin(), interleaved.end());
    std::size_t at = 0;
    for (; waiting_.size() - at >= size_; at += size_) {
      if (auto written = write(std::span(waiting_).subspan(at, size_)); !written) return written;
    }
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(at));
    return {};
  }
  template <typename Write>
  tl::expected<void, std::string> flush(const Write& write) {
    return write(std::span<const float>(waiting_));
  }

 private:
  std::size_t size_;
  std::vector<float> waiting_;
};

int run(const RenderArguments& arguments) {
  const auto began = std::chrono::steady_clock::now();
  if (auto conflict = output_conflict({arguments.capture}, {arguments.output, arguments.events, arguments.report});
      !conflict.empty()) {
    return complain(conflict, kWrongUsage);
  }
  auto source = CaptureSource::open(arguments.capture);
  if (!source) return complain(source.error(), std::filesystem::exists(arguments.capture) ? kFailed : kWrongUsage);

  const bool directed = source->begun() && !arguments.ignore_decisions;
  session::SessionOptions options = directed ? source->options() : session::replayed(source->options());
  if (directed && arguments.rate_hz != 0 && static_cast<std::uint32_t>(arguments.rate_hz) != options.rate_hz) {
    return complain(fmt::format("--rate {}: the recording's decisions count samples at {} Hz; leave it out, or add "
                                "--ignore-decisions",
                                arguments.rate_hz, options.rate_hz),
                    kWrongUsage);
  }
  if (arguments.seed) options.seed = *arguments.seed;
  if (!arguments.mode.empty()) {
    options.mode = arguments.mode == "published" ? session::SynthesisMode::kPublished : session::SynthesisMode::kCorrected;
  }
  if (arguments.rate_hz != 0) options.rate_hz = static_cast<std::uint32_t>(arguments.rate_hz);
  if (arguments.channels == "mono") options.channels = session::ChannelLayout::kMono;
  if (arguments.channels == "stereo") options.channels = session::ChannelLayout::kStereo;
  if (arguments.channels == "binaural") options.channels = session::ChannelLayout::kBinaural;
  if (!arguments.hrtf.empty()) options.hrtf = arguments.hrtf;
  if (arguments.friction_fft_size != 0) options.friction_fft_size = static_cast<std::uint32_t>(arguments.friction_fft_size);
  options = session::settled(options);
  std::shared_ptr<const spatial::Hrtf> head;
  if (options.channels == session::ChannelLayout::kBinaural) {
    const bool by_name =
        options.hrtf.empty() || options.hrtf == spatial::kStructuralHrtf || options.hrtf == spatial::kKemarHrtf;
    if (!by_name && arguments.hrtf.empty()) {
      return complain(
          fmt::format("the capture was heard with the HRTF \"{}\"; name its file, or another, with --hrtf", options.hrtf),
          kWrongUsage);
    }
    auto loaded = spatial::load_hrtf(options.hrtf, options.rate_hz);
    if (!loaded) return complain(fmt::format("--hrtf: {}", loaded.error()), kWrongUsage);
    head = std::move(*loaded);
  } else if (!arguments.hrtf.empty()) {
    return complain("--hrtf belongs to binaural sound; add --channels binaural", kWrongUsage);
  }

  auto packs = std::make_shared<pack::PackLibrary>();
  const std::string& wanted = arguments.material.empty() ? options.default_material : arguments.material;
  if (auto found = packs->find(wanted); !found) {
    return complain(found.error().text(), kWrongUsage);
  }
  engine::Options engine_options = session::engine_options(options, head);
  engine_options.gain_db = arguments.gain_db;
  for (const auto& text : arguments.gains) {
    const auto gain = parse_gain(text);
    if (!gain) return complain("--gain: " + gain.error(), kWrongUsage);
    engine_options.gains.push_back(*gain);
  }
  engine_options.stems = !arguments.stems.empty();
  engine_options.emitters = !arguments.emitters.empty();
  if (!directed) engine_options.cloth_search = cloth_search(arguments.cloth_features, options.cloth_features);
  if (directed && !arguments.cloth_features.empty() && arguments.cloth_features != "causal") {
    return complain(fmt::format("--cloth-features {}: a daemon's recording was heard with causal ones; leave it out, or add "
                                "--ignore-decisions",
                                arguments.cloth_features),
                    kWrongUsage);
  }
  if (arguments.fine_events != "auto") engine_options.fine_events = arguments.fine_events == "on";
  if (!arguments.material.empty()) engine_options.every_material = arguments.material;

  std::optional<scene::Listener> listener;
  if (!arguments.listener.empty()) {
    const auto point = parse_point(arguments.listener);
    if (!point) return complain("--listener takes three numbers in metres, as in --listener 0,-1,0.5", kWrongUsage);
    listener = scene::Listener{options.time_origin_s, *point, std::nullopt, sheet::Vec3d::UnitZ()};
  }
  if (!arguments.facing.empty()) {
    if (!listener) return complain("--facing turns the --listener; say where that is too", kWrongUsage);
    const auto direction = parse_point(arguments.facing);
    if (!direction || !(direction->norm() > 1e-9))
      return complain("--facing takes a direction as three numbers, as in --facing 0,1,0", kWrongUsage);
    listener->forward = direction->normalized();
  }
  const int channels = engine::channels_of(engine_options.layout);
  const auto format = wav_format(arguments.format);
  if (!arguments.stems.empty()) {
    std::error_code failed;
    std::filesystem::create_directories(arguments.stems, failed);
    if (failed) return complain(fmt::format("{}: cannot be made ({})", arguments.stems, failed.message()), kFailed);
  }
  auto wav = sinks::WavWriter::create(arguments.output, engine_options.rate_hz, channels, format);
  if (!wav) return complain(wav.error(), kFailed);

  std::optional<EmitterFiles> emitters;
  if (!arguments.emitters.empty()) {
    auto created = EmitterFiles::create(arguments.emitters, engine_options.rate_hz, format);
    if (!created) return complain(created.error(), kFailed);
    emitters = std::move(*created);
  }
  StemFiles stems(arguments.stems, engine_options.rate_hz, channels, format);
  Blocks blocks(arguments.block_size, channels);
  sinks::EventLog log;
  RenderFacts facts;
  facts.capture = arguments.capture;
  std::string failure;
  std::map<std::string, CaptureSource::Refusals> engine_refusals;
  std::vector<float> heard;
  const bool keep_samples = !arguments.report.empty();
  double sum = 0;
  float peak = 0;

  const auto keep = [&](std::span<const float> samples) { return wav->write(samples); };
  Progress progress("rendering");
  session::OfflineEnds ends;
  ends.next = [&]() -> std::optional<engine::StreamItem> {
    if (listener) {
      const auto first = *listener;
      listener.reset();
      return first;
    }
    auto item = source->next();
    while (item && !arguments.listener.empty() && std::holds_alternative<scene::Listener>(*item)) item = source->next();
    if (item) facts.see(*item);
    progress.show(source->progress());
    return item;
  };
  std::optional<DirectedSource> steps;
  if (directed) {
    steps.emplace(*source);
    ends.next_directed = [&]() -> std::optional<session::DirectedItem> {
      if (listener) {
        session::DirectedItem first;
        first.what = engine::StreamItem(*std::exchange(listener, std::nullopt));
        return first;
      }
      auto step = steps->next();
      progress.show(source->progress());
      auto* item = step ? std::get_if<engine::StreamItem>(&step->what) : nullptr;
      if (item == nullptr) return step;
      facts.see(*item);
      if (!arguments.listener.empty() && std::holds_alternative<scene::Listener>(*item))
        step->what = session::RenderedTo{step->accepted_at};
      return step;
    };
  }
  bool unidentified = false;
  ends.observed = [&](const observation::Observation& observed) {
    unidentified |= observed.unidentified;
    log.add(observed);
  };
  ends.refused = [&](const engine::Refusal& refusal) {
    auto& refusals = engine_refusals[refusal.field];
    if (refusals.count++ == 0) refusals.first = fmt::format("{}: {} {}", refusal.field, refusal.message, refusal.remedy);
  };
  ends.audio = [&](const engine::AudioQuantum& quantum) {
    for (const float x : quantum.mix) {
      sum += static_cast<double>(x) * x;
      peak = std::max(peak, std::abs(x));
    }
    if (keep_samples) heard.insert(heard.end(), quantum.mix.begin(), quantum.mix.end());
    auto written = blocks.add(quantum.mix, keep);
    if (written && !arguments.stems.empty()) written = stems.write(quantum);
    if (written && emitters) written = write_emitters(quantum, *emitters);
    if (!written) failure = written.error();
    return failure.empty();
  };
  const auto summary = session::render_offline(engine_options, packs, arguments.workers, ends);
  const std::uint64_t frames = directed ? summary.frames : source->frames();
  while (source->next()) {  // whether the file ends as it should shows at its end only
  }
  if (failure.empty()) {
    auto closed = blocks.flush(keep);
    if (closed) closed = wav->close();
    if (closed) closed = stems.close();
    if (closed && emitters) closed = emitters->close();
    if (!closed) failure = closed.error();
  }
  if (!failure.empty()) return complain(failure, kFailed);

  const auto events = log.finish();
  if (!arguments.events.empty()) {
    if (auto written = sinks::write_json_lines(arguments.events, events); !written)
      return complain(written.error(), kFailed);
  }
  const double elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  const double seconds = static_cast<double>(summary.samples) / engine_options.rate_hz;
  const double rms = std::sqrt(sum / std::max<double>(1, static_cast<double>(summary.samples) * channels));
  const auto dbfs = [](double x) { return 20 * std::log10(std::max(x, 1e-15)); };

  if (unidentified) {
    warn(
        "a sheet has a new mesh at every frame and no material coordinates: events that show in the mesh are not heard, "
        "only "
        "what its bending feeds; import `material_coordinates` with it");
  }
  const std::int64_t first_sample = directed ? source->begun()->first_sample : 0;
  if (first_sample > 0) {
    warn(fmt::format("{} begins {:.2f} s into its session: what sounded or moved before then is missing", arguments.capture,
                     static_cast<double>(first_sample) / engine_options.rate_hz));
  }
  std::vector<std::string> notices;
  auto refused = source->refused();
  refused.insert(engine_refusals.begin(), engine_refusals.end());
  for (const auto& [code, refusals] : refused) {
    notices.push_back(fmt::format("{} left out, first: {}", counted(refusals.count, "message"), refusals.first));
  }
  for (auto& unused : unused_gains(engine_options, facts)) notices.push_back(std::move(unused));
  if (!source->recovery().complete) notices.push_back(source->recovery().what);
  if (source->frames() == 0) notices.push_back(fmt::format("{}: not one frame could be used", arguments.capture));

  if (!arguments.report.empty()) {
    facts.options = engine_options;
    facts.first_time_s = source->first_time_s();
    facts.duration_s = source->newest_time_s() - source->first_time_s();
    facts.render_s = elapsed_s;
    facts.frames = frames;
    facts.limited_samples = summary.render.samples_limited;
    facts.notices = notices;
    if (auto written = write_render_report(arguments.report, facts, events, heard, *packs); !written) {
      return complain(written.error(), kFailed);
    }
  }

  const Losses losses{summary.render.voices_stolen,     summary.render.voices_dropped, summary.render.sources_dropped,
                      summary.render.cues_dropped,      summary.plan.sounds_missing,   summary.plan.planes_left_out,
                      summary.render.samples_not_finite};
  const auto dropped = directed ? steps->frames_dropped() : std::map<std::string, std::uint64_t>{};
  std::uint64_t all_dropped = 0;
  for (const auto& [cause, count] : dropped) all_dropped += count;
  std::map<std::string, std::uint64_t> by_kind{{"crumpling", 0}, {"friction", 0}, {"tearing", 0}};
  for (const auto& event : events) ++by_kind[sinks::name_of(event.kind)];
  if (arguments.json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"output", arguments.output},
                                              {"seconds", seconds},
                                              {"samples", summary.samples},
                                              {"rate_hz", engine_options.rate_hz},
                                              {"channels", channels},
                                              {"frames", frames},
                                              {"events", by_kind},
                                              {"peak_dbfs", dbfs(peak)},
                                              {"rms_dbfs", dbfs(rms)},
                                              {"voices_most", summary.render.voices_most},
                                              {"voices_stolen", losses.voices_stolen},
                                              {"voices_dropped", losses.voices_dropped},
                                              {"sources_dropped", losses.sources_dropped},
                                              {"cues_dropped", losses.cues_dropped},
                                              {"sounds_missing", losses.sounds_missing},
                                              {"planes_left_out", losses.planes_left_out},
                                              {"voices_merged", summary.plan.voices_merged},
                                              {"emitters", emitters ? emitters->count() : 0},
                                              {"emitter_samples_left_out", summary.emitter_samples_left_out},
                                              {"samples_limited", summary.render.samples_limited},
                                              {"samples_not_finite", losses.samples_not_finite},
                                              {"elapsed_s", elapsed_s},
                                              {"analysis_s", summary.analysis_s},
                                              {"synthesis_s", summary.synthesis_s},
                                              {"first_sample", first_sample},
                                              {"frames_dropped", dropped},
                                              {"left_out", notices}}
                           .dump());
  } else {
    fmt::print("{}: {:.2f} s from {}{}, {}, {}, {}; peak {}, RMS {}; {}; rendered in {:.2f} s, {:.0f}x real time\n",
               arguments.output, seconds, counted(frames, "frame"),
               all_dropped == 0 ? "" : fmt::format(" ({} dropped by the daemon)", all_dropped),
               counted(by_kind["crumpling"], "crumpling event"), counted(by_kind["friction"], "friction episode"),
               counted(by_kind["tearing"], "tear"), level_text(peak), level_text(rms), to_string(losses), elapsed_s,
               seconds / std::max(elapsed_s, 1e-9));
  }
  return done_with(notices);
}

}  // namespace

void add_render(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<RenderArguments>();
  auto* command = app.add_subcommand("render", "Render a capture to a WAV file, faster than real time");
  command->footer(
      "Example: rustle render crumple.mcap -o crumple.wav --events crumple.jsonl --report crumple.html\n"
      "Without --material the capture's own is used, else printer paper; without --listener the capture's own, else\n"
      "1 m from the sheet's first centroid at 30 degrees above. What cannot be used is left out, named, and status 1.\n"
      "A daemon's recording gives what the daemon sent, sample for sample: the frames it dropped are not heard, and every\n"
      "frame is heard when it was. With --ignore-decisions all of them are, as simulation time has it.");
  command->add_option("CAPTURE", arguments->capture, "The capture (.mcap)")->required();
  command->add_option("-o,--output", arguments->output, "The WAV file to write")->required();
  command->add_option("--material", arguments->material, "Material of every sheet, such as printer-paper");
  command->add_option("--seed", arguments->seed, "Seed of everything random; the capture's own when absent, else 0");
  command->add_option("--block-size", arguments->block_size, "Samples handed on at a time; changes no sample")
      ->check(CLI::Range(1, 1 << 20))
      ->capture_default_str();
  command->add_option("--workers", arguments->workers, "Threads; 2 lets analysis run ahead of synthesis; changes no sample")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command
      ->add_option("--channels", arguments->channels,
                   "mono, stereo, or binaural for headphones; the capture's own when absent, else stereo")
      ->check(CLI::IsMember({"mono", "stereo", "binaural"}));
  command->add_option("--hrtf", arguments->hrtf,
                      "Whose ears hear binaural sound: structural, kemar or a SOFA file; kemar where installed");
  command
      ->add_option("--friction-fft", arguments->friction_fft_size,
                   "FFT size of friction noise in samples, hop half of it; 1024, above 50 kHz 2048, when absent")
      ->check(CLI::IsMember({128, 256, 512, 1024, 2048, 4096, 8192}));
  command
      ->add_option("--mode", arguments->mode,
                   "corrected, or published: the papers' formulas as printed; the capture's own when absent, else corrected")
      ->check(CLI::IsMember({"published", "corrected"}));
  command
      ->add_option("--fine-events", arguments->fine_events,
                   "Events below what the mesh shows: on, off, or auto: of paper, not of cloth")
      ->check(CLI::IsMember({"auto", "on", "off"}))
      ->capture_default_str();
  command
      ->add_option("--cloth-features", arguments->cloth_features,
                   "How cloth finds its sounds: causal, as live; symmetric, looking ahead as published; or global, with the "
                   "choices of least total cost; the capture's own when absent")
      ->check(CLI::IsMember({"causal", "symmetric", "global"}));
  command->add_option("--listener", arguments->listener, "Where it is heard, x,y,z in metres, z up");
  command->add_option("--facing", arguments->facing, "Which way the listener looks, x,y,z; at the sheets when absent");
  command->add_option("--gain-db", arguments->gain_db, "Gain before the limiter")
      ->check(CLI::Range(-120.0, 60.0))
      ->capture_default_str();
  command
      ->add_option("--gain", arguments->gains, fmt::format("Gain of some of the sounds, may be said again; {}", kGainSyntax))
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  command->add_option("--rate", arguments->rate_hz, "Sample rate in Hz; the capture's own when absent, else 48000")
      ->check(CLI::IsMember({44100, 48000, 96000}));
  command->add_option("--format", arguments->format, "Sample format")
      ->check(CLI::IsMember({"f32", "s16", "s24"}))
      ->capture_default_str();
  command->add_option("--stems", arguments->stems, "Folder for a WAV file per sheet and kind, before the limiter");
  command->add_option("--emitters", arguments->emitters,
                      "Folder for the dry sound of every emitter: a WAV file each, and emitters.jsonl with their positions");
  command->add_option("--events", arguments->events, "Event list to write, a JSON object per line");
  command->add_option("--report", arguments->report, "HTML report to write, one file");
  command->add_flag("--ignore-decisions", arguments->ignore_decisions,
                    "Of a daemon's recording: every frame that arrived, on the clock of simulation time");
  command->add_flag("--json", arguments->json, "Print the summary as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
