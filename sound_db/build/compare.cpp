#include "sound_db/build/compare.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <fmt/format.h>

#include "sound_db/build/build_manifest.h"
#include "sound_db/build/recording.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/resample.h"

namespace rustle::build {

namespace {

namespace fs = std::filesystem;

struct Measured {
  std::size_t index;  // into the sounds
  dsp::SoundFeatures features;
};

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 ? values[half] : (values[half - 1] + values[half]) / 2;
}

FeatureRange range_of(const std::vector<double>& values) {
  if (values.empty()) return {};
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  return {static_cast<int>(values.size()), *least, median(values), *most};
}

std::vector<double> values_of(const std::vector<Measured>& sounds, double dsp::SoundFeatures::*feature) {
  std::vector<double> values;
  for (const Measured& sound : sounds) values.push_back(sound.features.*feature);
  return values;
}

FeatureRow row_of(std::string name, const std::vector<double>& ours, const std::vector<double>& real) {
  FeatureRow row{std::move(name), range_of(ours), range_of(real), 0, false};
  const double low = row.real.least, high = row.real.most;
  row.share_inside =
      static_cast<double>(std::count_if(ours.begin(), ours.end(), [&](double v) { return v >= low && v <= high; })) /
      static_cast<double>(ours.size());
  const double slack = row.real.count < kFewRecordings ? 2.0 : 1.0;
  row.inside = row.ours.median >= low / slack && row.ours.median <= high * slack;
  return row;
}

dsp::MeanMfcc mean_of(const std::vector<Measured>& sounds) {
  dsp::MeanMfcc mean{};
  for (const Measured& sound : sounds) {
    for (std::size_t c = 0; c < mean.size(); ++c) mean[c] += sound.features.mfcc[c] / static_cast<double>(sounds.size());
  }
  return mean;
}

constexpr double kMoment_s = 0.030;  // what a clac and its tail take
constexpr double kBeforeMoment_s = 0.001;
constexpr double kMomentsApart_s = 0.040;
constexpr double kFaintMoment = 0.01;  // of the loudest one's energy
constexpr int kMostMoments = 10;

/// The loudest moments of a crumpling, its single clacs as far as they can be told apart: from a millisecond before each
/// loudest millisecond on, loudest first.
std::vector<std::span<const float>> loudest_moments(std::span<const float> sound, double rate_hz) {
  const auto samples = [&](double duration_s) { return static_cast<std::size_t>(std::lround(duration_s * rate_hz)); };
  const std::size_t step = std::max<std::size_t>(1, samples(0.001)), apart = samples(kMomentsApart_s) / step;
  std::vector<double> energy(sound.size() / step);
  for (std::size_t k = 0; k < energy.size(); ++k) {
    for (const float x : sound.subspan(k * step, step)) energy[k] += static_cast<double>(x) * x;
  }
  std::vector<std::span<const float>> moments;
  if (energy.empty()) return moments;
  const double faintest = kFaintMoment * *std::max_element(energy.begin(), energy.end());
  for (int i = 0; i < kMostMoments; ++i) {
    const auto loudest = std::max_element(energy.begin(), energy.end());
    if (*loudest <= 0 || *loudest < faintest) break;
    const auto at = static_cast<std::size_t>(loudest - energy.begin());
    const std::size_t from = at * step - std::min(at * step, samples(kBeforeMoment_s));
    moments.push_back(sound.subspan(from, std::min(samples(kMoment_s), sound.size() - from)));
    std::fill(energy.begin() + static_cast<std::ptrdiff_t>(at - std::min(at, apart)),
              energy.begin() + static_cast<std::ptrdiff_t>(std::min(energy.size(), at + apart)), 0.0);
  }
  return moments;
}

/// Distance to the nearest of `others` but `self`.
NearestReal nearest_to(const Measured& sound, const std::vector<Measured>& others, const Measured* self) {
  NearestReal nearest{sound.index, 0, std::numeric_limits<double>::infinity()};
  for (const Measured& other : others) {
    if (&other == self) continue;
    const double distance = dsp::mfcc_distance(sound.features.mfcc, other.features.mfcc);
    if (distance < nearest.mfcc_distance) nearest = {sound.index, other.index, distance};
  }
  return nearest;
}

ClassComparison compare_class(SoundClass sound_class, SoundClass with, const std::vector<Measured>& ours,
                              const std::vector<Measured>& real) {
  using F = dsp::SoundFeatures;
  ClassComparison result;
  result.sound_class = sound_class;
  result.compared_with = with;
  result.ours = static_cast<int>(ours.size());
  result.real = static_cast<int>(real.size());
  for (const auto& [name, feature] : {std::pair{"centroid_hz", &F::centroid_hz},
                                      {"bandwidth_hz", &F::bandwidth_hz},
                                      {"decay_s", &F::decay_s},
                                      {"kurtosis", &F::kurtosis}}) {
    result.features.push_back(row_of(name, values_of(ours, feature), values_of(real, feature)));
  }
  std::vector<double> to_real, among_real;
  for (const Measured& sound : ours) {
    result.nearest.push_back(nearest_to(sound, real, nullptr));
    to_real.push_back(result.nearest.back().mfcc_distance);
  }
  for (const Measured& sound : real) {
    if (real.size() > 1) among_real.push_back(nearest_to(sound, real, &sound).mfcc_distance);
  }
  result.mfcc_distance = median(to_real);
  result.real_mfcc_distance = median(among_real);
  result.mean_mfcc_distance = dsp::mfcc_distance(mean_of(ours), mean_of(real));
  return result;
}

/// RMS of the loudest 100 ms.
double loudness(std::span<const float> signal, double rate_hz) {
  const std::size_t block = std::min(signal.size(), static_cast<std::size_t>(0.1 * rate_hz));
  double most = 0;
  for (std::size_t start = 0; start + block <= signal.size() && block > 0; start += std::max<std::size_t>(1, block / 4))
    most = std::max(most, dsp::rms(signal.subspan(start, block)));
  return most;
}

pack::PackError first_error(const pack::Findings& findings) {
  for (const pack::Finding& finding : findings) {
    if (finding.severity == pack::Severity::kError) return finding.what;
  }
  return findings.front().what;
}

std::string part_name(const std::string& file, const Take& take) {
  if (!take.from_s) return file;
  return fmt::format("{} {:g}-{:g} s", file, *take.from_s, *take.to_s);
}

/// What a take means of a file, as it was recorded: features are compared with those of unfiltered files.
tl::expected<std::vector<float>, std::string> part_of(const fs::path& file, const Take& take, double rate_hz) {
  const auto recording = read_recording(file);
  if (!recording) return tl::unexpected(recording.error());
  if (take.channel > recording->channels) return tl::unexpected(fmt::format("has no channel {}", take.channel));
  const std::vector<float> whole = dsp::resample(channel_of(*recording, take.channel), recording->rate_hz, rate_hz);
  const auto index = [&](double time_s) {
    return static_cast<std::ptrdiff_t>(std::clamp(std::round(time_s * rate_hz), 0.0, static_cast<double>(whole.size())));
  };
  const auto from = index(take.from_s.value_or(0)), to = index(take.to_s.value_or(recording->duration_s() + 1));
  if (from >= to) return tl::unexpected(fmt::format("lasts {:.3f} s only", recording->duration_s()));
  return std::vector<float>(whole.begin() + from, whole.begin() + to);
}

tl::expected<ReferenceRecordings, pack::PackError> by_manifest(const fs::path& folder, const fs::path& manifest_file,
                                                               double rate_hz) {
  pack::Findings findings;
  const auto manifest = read_build_manifest(manifest_file, findings);
  if (!manifest) return tl::unexpected(first_error(findings));
  const auto files = files_of(*manifest, folder, findings);
  if (!findings.empty()) return tl::unexpected(first_error(findings));
  ReferenceRecordings result;
  for (const TakeFile& file : files) {
    const Take& take = manifest->takes[file.take];
    auto part = part_of(folder / file.file, take, rate_hz);
    if (!part) {
      result.notices.push_back(fmt::format("{} {}: left out", file.file, part.error()));
      continue;
    }
    result.sounds.push_back({take.sound_class, part_name(file.file, take), std::move(*part)});
  }
  return result;
}

tl::expected<ReferenceRecordings, pack::PackError> by_names(const fs::path& folder, double rate_hz) {
  std::vector<std::string> files;
  std::error_code failed;
  for (fs::recursive_directory_iterator at(folder, failed), end; !failed && at != end; at.increment(failed)) {
    if (at->is_regular_file(failed) && is_recording(at->path()))
      files.push_back(at->path().lexically_relative(folder).generic_string());
  }
  if (failed) {
    return tl::unexpected(pack::PackError{folder.string(), "", fmt::format("cannot be read ({})", failed.message()),
                                          "name a folder of recordings"});
  }
  std::sort(files.begin(), files.end());
  ReferenceRecordings result;
  std::string guesses, unknown;
  for (const std::string& file : files) {
    const auto guess = guessed_class(file);
    if (!guess) {
      unknown += (unknown.empty() ? "" : ", ") + file;
      continue;
    }
    const auto recording = read_recording(folder / file);
    if (!recording) {
      result.notices.push_back(fmt::format("{} {}: left out", file, recording.error()));
      continue;
    }
    guesses += fmt::format("{}{} {}", guesses.empty() ? "" : ", ", file, name(*guess));
    result.sounds.push_back({*guess, file, dsp::resample(channel_of(*recording, 0), recording->rate_hz, rate_hz)});
  }
  if (!guesses.empty())
    result.notices.push_back(
        fmt::format("there is no {}; classes are guessed by the files' names: {}", kBuildManifestName, guesses));
  if (!unknown.empty()) result.notices.push_back("left out, as no word of their names tells a class: " + unknown);
  return result;
}

}  // namespace

tl::expected<ReferenceRecordings, pack::PackError> read_reference_recordings(const fs::path& folder, double rate_hz,
                                                                             const fs::path& manifest) {
  std::error_code failed;
  if (!fs::is_directory(folder, failed))
    return tl::unexpected(pack::PackError{folder.string(), "", "is not a folder", "name a folder of recordings"});
  const fs::path file = manifest.empty() ? folder / kBuildManifestName : manifest;
  const bool named = !manifest.empty() || fs::exists(file, failed);
  auto result = named ? by_manifest(folder, file, rate_hz) : by_names(folder, rate_hz);
  if (result && result->sounds.empty()) {
    return tl::unexpected(
        pack::PackError{folder.string(), "", "holds no recording whose class is known",
                        fmt::format("name files after what they hold (flip, crumple, slide, tear, cloth), or write a {}",
                                    kBuildManifestName)});
  }
  return result;
}

Comparison compare(const std::vector<ClassifiedSound>& ours, const std::vector<ClassifiedSound>& real, double rate_hz,
                   const Progress& progress) {
  Comparison result;
  std::array<std::vector<Measured>, kSoundClasses.size()> our_classes, real_classes;
  std::size_t done = 0;
  const auto measure = [&](const std::vector<ClassifiedSound>& sounds, auto& classes) {
    for (std::size_t i = 0; i < sounds.size(); ++i) {
      if (progress) progress(static_cast<double>(done++) / static_cast<double>(ours.size() + real.size()));
      const auto features = dsp::sound_features(sounds[i].samples, rate_hz);
      if (features.centroid_hz > 0) {
        classes[static_cast<std::size_t>(sounds[i].sound_class)].push_back({i, features});
      } else {
        result.notices.push_back(fmt::format("{} is silent: left out", sounds[i].name));
      }
    }
  };
  measure(ours, our_classes);
  measure(real, real_classes);
  auto& real_clacs = real_classes[static_cast<std::size_t>(SoundClass::kClac)];
  const bool clacs_cut = real_clacs.empty();
  if (clacs_cut) {
    for (const Measured& crumpling : real_classes[static_cast<std::size_t>(SoundClass::kCrumple)]) {
      for (const auto moment : loudest_moments(real[crumpling.index].samples, rate_hz))
        real_clacs.push_back({crumpling.index, dsp::sound_features(moment, rate_hz)});
    }
  }
  for (const SoundClass sound_class : kSoundClasses) {
    const auto& mine = our_classes[static_cast<std::size_t>(sound_class)];
    const SoundClass with = sound_class == SoundClass::kClac && clacs_cut ? SoundClass::kCrumple : sound_class;
    const auto& theirs = real_classes[static_cast<std::size_t>(sound_class)];
    if (!mine.empty() && !theirs.empty()) {
      result.classes.push_back(compare_class(sound_class, with, mine, theirs));
      if (theirs.size() < kFewRecordings) {
        result.notices.push_back(fmt::format("{}: {} recording{} make no range; the median may lie within a factor of two",
                                             name(sound_class), theirs.size(), theirs.size() == 1 ? "" : "s"));
      }
    } else if (!mine.empty()) {
      result.notices.push_back(fmt::format("{}: no recording to compare with", name(sound_class)));
    } else if (!theirs.empty() && with == sound_class) {
      result.notices.push_back(fmt::format("{}: recorded, but not among the sounds compared", name(sound_class)));
    }
  }
  return result;
}

Comparison compare(const pack::SoundPack& pack, const std::vector<ClassifiedSound>& real, const Progress& progress) {
  return compare(pack_sounds(pack), real, pack.rate_hz, progress);
}

std::vector<SoundPair> pairs_to_show(const Comparison& comparison, const std::vector<ClassifiedSound>& ours,
                                     const std::vector<ClassifiedSound>& real, double rate_hz, int most) {
  constexpr double kLoudness = 0.1;
  const auto gain_of = [&](const ClassifiedSound& sound) {
    const double level = loudness(sound.samples, rate_hz);
    return level > 0 ? kLoudness / level : 1.0;
  };
  std::vector<SoundPair> pairs;
  for (const ClassComparison& of : comparison.classes) {
    std::vector<NearestReal> ranked = of.nearest;
    std::stable_sort(ranked.begin(), ranked.end(),
                     [](const NearestReal& a, const NearestReal& b) { return a.mfcc_distance < b.mfcc_distance; });
    const std::size_t count = std::min(ranked.size(), static_cast<std::size_t>(std::max(0, most)));
    for (std::size_t i = 0; i < count; ++i) {
      const NearestReal& match = ranked[count == 1 ? 0 : i * (ranked.size() - 1) / (count - 1)];
      pairs.push_back({of.sound_class, match.ours, match.real, gain_of(ours[match.ours]), gain_of(real[match.real]),
                       match.mfcc_distance});
    }
  }
  return pairs;
}

}  // namespace rustle::build
