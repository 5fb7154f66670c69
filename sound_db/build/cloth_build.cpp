#include "sound_db/build/cloth_build.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include <fmt/format.h>

#include "sound_db/build/prepared_take.h"
#include "sound_db/build/speed_track.h"
#include "sound_db/dsp/level.h"
#include "sound_db/pack/calibration.h"
#include "sound_db/pack/corpus_source.h"
#include "sound_db/pack/sweep_measure.h"

namespace rustle::build {

namespace {

constexpr double kLoudestStored_db = -1.0;
constexpr double kLeastPop_s = 0.001, kMostPop_s = 0.5;
constexpr const char* kSweepFile = "cloth/friction.npy";

double loudest_db(const std::vector<float>& samples, double window_s, double rate_hz) {
  const auto window = std::max<std::size_t>(1, static_cast<std::size_t>(window_s * rate_hz));
  double most = dsp::kSilenceDb;
  for (std::size_t at = 0; at + window <= samples.size(); at += window) {
    most = std::max(most, dsp::rms_dbfs(std::span(samples).subspan(at, window)));
  }
  return most;
}

/// Runs above a threshold relative to the loudest window, and which threshold that was.
struct FoundPops {
  std::vector<Segment> segments;
  double threshold = 0;  ///< power
};

FoundPops find_pops(const PreparedTake& prepared, const Take& take) {
  const auto window = static_cast<std::size_t>(std::max(1.0, take.window_s * prepared.rate_hz));
  const std::vector<double> power = windowed_power(prepared.samples, window);
  const double loudest = power.empty() ? 0.0 : *std::max_element(power.begin(), power.end());
  const auto at = [&](double db) {
    const double threshold = loudest * std::pow(10.0, db / 10);
    return FoundPops{find_segments(prepared.samples, power, threshold, 0), threshold};
  };
  if (!(loudest > 0)) return {};
  if (take.threshold_db) return at(*take.threshold_db);
  FoundPops best;
  for (int db = -6; db >= -40; --db) {
    FoundPops found = at(db);
    if (found.segments.size() >= best.segments.size()) best = std::move(found);
  }
  return best;
}

class ClothBuilder {
 public:
  ClothBuilder(const BuildManifest& manifest, const std::filesystem::path& folder, pack::Findings& findings)
      : manifest_(manifest),
        folder_(folder),
        findings_(findings),
        rate_hz_(manifest.pack.rate_hz),
        settings_(*manifest.cloth),
        measure_(rate_hz_, pack::geometric_speeds(settings_.slowest_m_per_s, settings_.fastest_m_per_s, settings_.speeds)) {
    corpus_.rate_hz = manifest.pack.rate_hz;
    corpus_.unit_s = 1 / settings_.units_per_s;
    corpus_.channels = settings_.binaural ? 2 : 1;
    corpus_.wale_spacing_m = settings_.wale_spacing_m;
    corpus_.selection = settings_.selection;
    corpus_.causal.file = "cloth/features_causal.npy";
    corpus_.symmetric.file = "cloth/features_symmetric.npy";
  }

  std::optional<BuiltPack> run(const Progress& progress) {
    const std::size_t before = findings_.size();
    const std::vector<TakeFile> files = files_of(manifest_, folder_, findings_);
    for (std::size_t i = 0; i < files.size() && findings_.size() == before; ++i) {
      read(manifest_.takes[files[i].take], files[i].file);
      if (progress) progress(0.9 * static_cast<double>(i + 1) / static_cast<double>(files.size()));
    }
    if (findings_.size() != before) return std::nullopt;
    finish();
    if (findings_.size() != before) return std::nullopt;
    if (progress) progress(1);
    return std::move(result_);
  }

 private:
  void error(const std::string& file, std::string message, std::string remedy) {
    findings_.push_back({pack::Severity::kError, {(folder_ / file).string(), "", std::move(message), std::move(remedy)}});
  }

  /// The channel made ready, or nothing and an error.
  std::optional<PreparedTake> prepared(const Take& take, const std::string& file, int channel) {
    Take one = take;
    one.channel = channel;
    auto ready = prepare(folder_ / file, one, rate_hz_, manifest_.highpass_hz);
    if (ready) return std::move(*ready);
    error(file, ready.error(), "correct the file or its entry");
    return std::nullopt;
  }

  SourceReport& report_of(const Take& take, const std::string& file, const PreparedTake& ready) {
    result_.report.sources.push_back(
        {file, take.sound_class, {}, ready.recorded_rate_hz, ready.channels, ready.duration_s, 0, {}});
    return result_.report.sources.back();
  }

  void read(const Take& take, const std::string& file) {
    switch (take.sound_class) {
      case SoundClass::kCloth:
        return read_corpus(take, file);
      case SoundClass::kSlide:
        return read_slide(take, file);
      case SoundClass::kCrumple:
        return read_crumpling(take, file);
      default:
        return;
    }
  }

  void read_corpus(const Take& take, const std::string& file) {
    auto first = prepared(take, file, take.channel);
    if (!first) return;
    SourceReport& report = report_of(take, file, *first);
    if (settings_.binaural && first->channels < 2)
      return error(file, "has one channel, binaural packs need two", "record with both ears, or take binaural out");
    if (settings_.binaural) {
      auto left = prepared(take, file, 1), right = prepared(take, file, 2);
      if (left && right) add_sources(report, {std::move(left->samples), std::move(right->samples)}, *left);
      return;
    }
    if (take.channel != 0 || first->channels == 1) return add_sources(report, {std::move(first->samples)}, *first);
    for (int channel = 1; channel <= first->channels; ++channel) {
      auto one = prepared(take, file, channel);
      if (one) add_sources(report, {std::move(one->samples)}, *one);
    }
  }

  void add_sources(SourceReport& report, std::vector<std::vector<float>> channels, const PreparedTake& ready) {
    double loudest = dsp::kSilenceDb;
    for (const auto& channel : channels) loudest = std::max(loudest, loudest_db(channel, 0.005, rate_hz_));
    pack::CorpusCut cut;
    cut.highpass_hz = 0;  // it is already
    cut.pause_db = std::max(loudest - settings_.pause_below_db, -120.0);
    report.threshold_dbfs = cut.pause_db;
    std::vector<pack::CorpusStretch> stretches;
    auto sources = pack::source_recordings(std::move(channels), rate_hz_, cut, "cloth/source",
                                           static_cast<int>(corpus_.recordings.size()) + 1, &stretches);
    for (std::size_t i = 0; i < sources.size(); ++i) {
      const double from_s = ready.from_s + static_cast<double>(stretches[i].begin) / rate_hz_;
      const double seconds = static_cast<double>(sources[i].samples()) / rate_hz_;
      SegmentReport segment{from_s, from_s + seconds, seconds, dsp::rms_dbfs(sources[i].channels[0]), sources[i].file, {}};
      if (is_clipped(ready, stretches[i].begin, stretches[i].end)) {
        segment.reason = "clipped: record it lower";
        segment.kept_as.clear();
        ++result_.report.left_out;
      }
      report.segments.push_back(segment);
    }
    // Numbers stay as they were given, so that the report's names are the pack's.
    for (std::size_t i = 0; i < sources.size(); ++i) {
      const SegmentReport& segment = report.segments[report.segments.size() - sources.size() + i];
      if (!segment.kept_as.empty()) corpus_.recordings.push_back(std::move(sources[i]));
    }
  }

  void read_slide(const Take& take, const std::string& file) {
    SpeedTrack track = constant_speed(take.speed_m_per_s.value_or(0));
    if (!take.speed_track.empty()) {
      auto read = read_speed_track(folder_ / take.speed_track);
      if (!read) return error(take.speed_track, read.error(), "write lines \"time,speed\" in s and m/s");
      track = std::move(*read);
    }
    const auto ready = prepared(take, file, take.channel);
    if (!ready) return;
    SourceReport& report = report_of(take, file, *ready);
    const auto speed_at = [&](double t) { return track.at(t + ready->from_s); };
    const auto usable = [&](std::size_t begin, std::size_t end) { return !is_clipped(*ready, begin, end); };
    int clips = 0;
    if (take.speed_track.empty()) {
      steady_.push_back({track.fastest_m_per_s(), pack::SweepMeasure(rate_hz_, {track.fastest_m_per_s()})});
      clips = steady_.back().second.add(ready->samples, speed_at, settings_.tolerance, usable);
    } else {
      clips = measure_.add(ready->samples, speed_at, settings_.tolerance, usable);
    }
    const double seconds = clips * pack::kFrictionClip_s / 2;
    SegmentReport segment{ready->from_s, ready->from_s + static_cast<double>(ready->samples.size()) / rate_hz_,
                          seconds,       dsp::rms_dbfs(ready->samples),
                          kSweepFile,    {}};
    if (clips == 0) {
      segment.kept_as.clear();
      segment.reason = fmt::format("without a whole clip of {:.0f} ms within {:g} to {:g} m/s", 1000 * pack::kFrictionClip_s,
                                   settings_.slowest_m_per_s, settings_.fastest_m_per_s);
      ++result_.report.left_out;
    }
    report.segments.push_back(segment);
  }

  void read_crumpling(const Take& take, const std::string& file) {
    const auto ready = prepared(take, file, take.channel);
    if (!ready) return;
    SourceReport& report = report_of(take, file, *ready);
    FoundPops found = find_pops(*ready, take);
    if (take.whole) found.segments = {{0, ready->samples.size()}};
    report.threshold_dbfs = found.threshold > 0 ? 10 * std::log10(found.threshold) : dsp::kSilenceDb;
    for (const Segment& pop : found.segments) {
      const auto sound = std::span(ready->samples).subspan(pop.begin, pop.length());
      const double seconds = static_cast<double>(pop.length()) / rate_hz_,
                   from_s = ready->from_s + static_cast<double>(pop.begin) / rate_hz_;
      SegmentReport segment{from_s, from_s + seconds, seconds, dsp::peak_dbfs(sound), {}, {}};
      const bool at_border = !take.whole && (pop.begin == 0 || pop.end == ready->samples.size());
      if (is_clipped(*ready, pop.begin, pop.end)) segment.reason = "clipped: record it lower";
      if (at_border) segment.reason = "cut by the end of the file or its time";
      if (seconds < kLeastPop_s) segment.reason = fmt::format("too short: {:.1f} ms", 1000 * seconds);
      if (!take.whole && seconds > kMostPop_s)
        segment.reason = fmt::format("overlapping: {:.0f} ms without a pause; say a higher threshold_db", 1000 * seconds);
      if (segment.reason.empty()) {
        pops_.push_back({result_.report.sources.size() - 1, report.segments.size()});
        crumpling_.units.push_back({{}, {sound.begin(), sound.end()}, 0});
      } else {
        ++result_.report.left_out;
      }
      report.segments.push_back(segment);
    }
  }

  void finish() {
    result_.pack = manifest_.pack;
    result_.pack.crumpling.reset();
    result_.pack.friction.reset();
    if (corpus_.recordings.empty()) {
      return error("", "holds no recording of cloth that can be used", "name some with class = \"cloth\"");
    }
    if (!add_sweep())
      return error("", "holds no slide that can be used", "name one with class = \"slide\" and its speed or speed_track");
    level();
    add_pops();
    pack::measure_units(corpus_);
    const std::vector<std::vector<float>> target(static_cast<std::size_t>(corpus_.channels),
                                                 pack::plain_calibration_target(corpus_, 1));
    const pack::TargetFeatures features = pack::target_features(corpus_, target);
    pack::calibrate(corpus_, features, pack::proposed_correspondences(corpus_, features));
    note_missing();
    result_.report.units = static_cast<int>(corpus_.crumpling ? corpus_.crumpling->units.size() : 0);
    result_.report.spectra = static_cast<int>(corpus_.friction.speeds_m_per_s.size());
    result_.pack.cloth = std::make_shared<const pack::ClothCorpus>(std::move(corpus_));
  }

  /// Of the speed tracks, and of the steady slides between them.
  bool add_sweep() {
    std::vector<std::pair<double, pack::FrictionSweep>> rows;
    const auto add = [&](const pack::FrictionSweep& sweep) {
      for (std::size_t i = 0; i < sweep.speeds_m_per_s.size(); ++i) {
        pack::FrictionSweep one = sweep;
        const auto spectrum = sweep.spectrum(i);
        one.magnitudes.assign(spectrum.begin(), spectrum.end());
        one.rms = {sweep.rms[i]};
        rows.emplace_back(sweep.speeds_m_per_s[i], std::move(one));
      }
    };
    add(measure_.sweep());
    for (const auto& [speed, measure] : steady_) add(measure.sweep());
    std::stable_sort(rows.begin(), rows.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    pack::FrictionSweep sweep;
    sweep.fft_size = static_cast<std::uint32_t>(pack::friction_clip_length(rate_hz_));
    for (const auto& [speed, one] : rows) {
      if (!sweep.speeds_m_per_s.empty() && speed <= sweep.speeds_m_per_s.back() * 1.001) continue;
      sweep.speeds_m_per_s.push_back(speed);
      sweep.rms.push_back(one.rms[0]);
      sweep.magnitudes.insert(sweep.magnitudes.end(), one.magnitudes.begin(), one.magnitudes.end());
    }
    sweep.file = kSweepFile;
    sweep.patch_area_m2 = settings_.patch_area_m2;
    sweep.speed_threshold_m_per_s = settings_.speed_threshold_m_per_s;
    corpus_.friction = std::move(sweep);
    return !corpus_.friction.speeds_m_per_s.empty();
  }

  /// Brings the corpus to just below full scale where it is above, and all else with it.
  void level() {
    double peak = 0;
    for (const auto& recording : corpus_.recordings) {
      for (const auto& channel : recording.channels) peak = std::max(peak, dsp::peak(channel));
    }
    const double gain_db = std::min(0.0, kLoudestStored_db - dsp::gain_to_db(peak));
    if (gain_db == 0) return;
    const double gain = dsp::db_to_gain(gain_db);
    const auto scale = [&](std::vector<float>& values) {
      for (float& x : values) x = static_cast<float>(x * gain);
    };
    for (auto& recording : corpus_.recordings) {
      for (auto& channel : recording.channels) scale(channel);
    }
    scale(corpus_.friction.magnitudes);
    for (double& rms : corpus_.friction.rms) rms *= gain;
    for (auto& unit : crumpling_.units) scale(unit.samples);
    result_.report.sessions.push_back({"all", false, gain_db});
  }

  void add_pops() {
    if (crumpling_.units.empty()) return;
    std::vector<double> energies;
    for (std::size_t i = 0; i < crumpling_.units.size(); ++i) {
      pack::ClothCrumplingUnit& unit = crumpling_.units[i];
      unit.file = fmt::format("cloth/crumpling_{:03}.flac", i + 1);
      for (const float x : unit.samples) unit.energy_s += static_cast<double>(x) * x / rate_hz_;
      energies.push_back(unit.energy_s);
      result_.report.sources[pops_[i].first].segments[pops_[i].second].kept_as = unit.file;
    }
    std::stable_sort(crumpling_.units.begin(), crumpling_.units.end(),
                     [](const auto& a, const auto& b) { return a.energy_s < b.energy_s; });
    crumpling_.unit_energies = pack::energy_histogram(energies);
    crumpling_.event_amplitudes = pack::usual_event_amplitudes();
    corpus_.crumpling = std::move(crumpling_);
  }

  void note_missing() {
    std::vector<std::string>& missing = result_.report.missing;
    if (!corpus_.crumpling) missing.emplace_back("crumpling: the sheet folds in silence");
    if (corpus_.friction.speeds_m_per_s.size() < 3)
      missing.emplace_back("slides at several speeds: friction keeps its colour at all of them");
    missing.emplace_back("correspondences with an animation: the warp is fitted to proposed ones; `rustle pack calibrate`");
  }

  const BuildManifest& manifest_;
  const std::filesystem::path& folder_;
  pack::Findings& findings_;
  double rate_hz_;
  const ClothSettings& settings_;
  pack::SweepMeasure measure_;
  std::vector<std::pair<double, pack::SweepMeasure>> steady_;
  pack::ClothCorpus corpus_;
  pack::ClothCrumpling crumpling_;
  std::vector<std::pair<std::size_t, std::size_t>> pops_;  ///< source and segment of each unit
  BuiltPack result_;
};

}  // namespace

std::optional<BuiltPack> build_cloth_pack(const BuildManifest& manifest, const std::filesystem::path& folder,
                                          pack::Findings& findings, const Progress& progress) {
  return ClothBuilder(manifest, folder, findings).run(progress);
}

}  // namespace rustle::build
