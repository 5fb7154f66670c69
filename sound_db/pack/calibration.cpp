#include "sound_db/pack/calibration.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

#include "sound_db/dsp/unit_features.h"

namespace rustle::pack {

namespace {

/// First features of what can hardly be heard, per channel: an RMS of about -80 dBFS.
constexpr double kHeard = -32;

/// A stretch of units and what its features are on average.
struct FeatureClip {
  std::size_t first = 0;
  std::vector<double> mean;  ///< [dims]
  double spread = 0;         ///< standard deviation of the first feature
};

/// Clips of `length` units, half overlapping, none across the end of a recording.
std::vector<FeatureClip> clips_of(std::span<const float> features, std::size_t dims,
                                  std::span<const std::uint32_t> first_unit, std::size_t length) {
  std::vector<FeatureClip> clips;
  for (std::size_t r = 0; r + 1 < first_unit.size(); ++r) {
    for (std::size_t first = first_unit[r]; first + length <= first_unit[r + 1];
         first += std::max<std::size_t>(1, length / 2)) {
      FeatureClip clip{first, std::vector<double>(dims), 0};
      double square = 0;
      for (std::size_t i = 0; i < length; ++i) {
        for (std::size_t d = 0; d < dims; ++d) clip.mean[d] += static_cast<double>(features[(first + i) * dims + d]);
        square += std::pow(static_cast<double>(features[(first + i) * dims]), 2);
      }
      for (double& m : clip.mean) m /= static_cast<double>(length);
      clip.spread = std::sqrt(std::max(0.0, square / static_cast<double>(length) - clip.mean[0] * clip.mean[0]));
      clips.push_back(std::move(clip));
    }
  }
  return clips;
}

/// The clips that are heard, by rising loudness; standard scores of their features.
struct HeardClips {
  std::vector<FeatureClip> clips;
  std::vector<double> centre, deviation;  ///< [dims]
  double score(std::size_t clip, std::size_t d) const { return (clips[clip].mean[d] - centre[d]) / deviation[d]; }
};

HeardClips heard(std::vector<FeatureClip> clips, std::size_t dims) {
  std::erase_if(clips, [](const FeatureClip& clip) { return clip.mean[0] < kHeard; });
  std::stable_sort(clips.begin(), clips.end(),
                   [](const FeatureClip& a, const FeatureClip& b) { return a.mean[0] < b.mean[0]; });
  HeardClips result{std::move(clips), std::vector<double>(dims), std::vector<double>(dims)};
  const auto count = static_cast<double>(result.clips.size());
  for (std::size_t d = 0; d < dims; ++d) {
    for (const FeatureClip& clip : result.clips) result.centre[d] += clip.mean[d] / count;
    for (const FeatureClip& clip : result.clips) result.deviation[d] += std::pow(clip.mean[d] - result.centre[d], 2) / count;
    result.deviation[d] = std::max(std::sqrt(result.deviation[d]), 1e-6);
  }
  return result;
}

double loudness_at(const HeardClips& clips, double rank) {
  return clips.clips[static_cast<std::size_t>(rank * static_cast<double>(clips.clips.size() - 1))].mean[0];
}

template <class Cost>
std::size_t cheapest(std::size_t count, const Cost& cost) {
  std::size_t best = 0;
  double least = cost(0);
  for (std::size_t i = 1; i < count; ++i) {
    const double c = cost(i);
    if (c < least) {
      best = i;
      least = c;
    }
  }
  return best;
}

double rms_distance(double sum, std::size_t count) {
  return count ? std::sqrt(sum / static_cast<double>(count)) : 0.0;
}

}  // namespace

TargetFeatures target_features(const ClothCorpus& corpus, std::span<const std::vector<float>> channels) {
  TargetFeatures result;
  result.dims = corpus.dims();
  result.units = channels.front().size() / static_cast<std::size_t>(corpus.unit_samples);
  std::vector<float> raw(result.units * result.dims);
  for (std::size_t c = 0; c < channels.size(); ++c) {
    const std::vector<float> features = dsp::unit_features(channels[c], corpus.unit_samples, corpus.rate_hz);
    for (std::size_t i = 0; i < features.size(); ++i) {
      raw[i / dsp::kUnitFeatures * result.dims + c * dsp::kUnitFeatures + i % dsp::kUnitFeatures] = features[i];
    }
  }
  const std::vector<std::uint32_t> whole = {0, static_cast<std::uint32_t>(result.units)};
  const auto dims = static_cast<int>(result.dims);
  result.causal = dsp::filtered_features(raw, dims, corpus.selection.filter_widths, whole, true);
  result.symmetric = dsp::filtered_features(raw, dims, corpus.selection.filter_widths, whole, false);
  return result;
}

UnitInterval units_of(const Correspondence& correspondence, const ClothCorpus& corpus, std::size_t target_units) noexcept {
  const double unit_s = static_cast<double>(corpus.unit_samples) / corpus.rate_hz;
  const auto unit = [&](double seconds) {
    return static_cast<std::size_t>(std::clamp(std::round(seconds / unit_s), 0.0, 1e9));
  };
  UnitInterval interval{unit(correspondence.target_s), unit(correspondence.database_s),
                        std::max<std::size_t>(1, unit(correspondence.length_s))};
  const auto left = [](std::size_t from, std::size_t size) { return from < size ? size - from : 0; };
  interval.count = std::min({interval.count, left(interval.target, target_units), left(interval.database, corpus.units())});
  return interval;
}

WarpFit fit_warp(const ClothCorpus& corpus, std::span<const float> target, std::span<const float> database,
                 std::span<const Correspondence> correspondences) {
  const std::size_t dims = corpus.dims(), target_units = target.size() / dims;
  std::vector<double> nodes, goals;
  std::vector<std::size_t> counts;
  for (const Correspondence& correspondence : correspondences) {
    const UnitInterval interval = units_of(correspondence, corpus, target_units);
    counts.push_back(interval.count);
    for (std::size_t i = 0; i < interval.count * dims; ++i) {
      nodes.push_back(target[interval.target * dims + i]);
      goals.push_back(database[interval.database * dims + i]);
    }
  }
  WarpFit fit{dsp::identity_warp(static_cast<int>(dims)), {}};
  if (!nodes.empty()) fit.warp = dsp::fit_thin_plate_spline(nodes, goals, static_cast<int>(dims), corpus.selection.lambda);
  std::size_t at = 0;
  std::vector<double> image(dims);
  for (const std::size_t count : counts) {
    double before = 0, after = 0;
    for (std::size_t i = 0; i < count; ++i, at += dims) {
      dsp::warp(fit.warp, std::span<const double>(nodes).subspan(at, dims), image);
      for (std::size_t d = 0; d < dims; ++d) {
        before += std::pow(nodes[at + d] - goals[at + d], 2);
        after += std::pow(image[d] - goals[at + d], 2);
      }
    }
    fit.residuals.push_back({rms_distance(before, count), rms_distance(after, count), count});
  }
  return fit;
}

std::vector<Correspondence> proposed_correspondences(const ClothCorpus& corpus, const TargetFeatures& target, int count,
                                                     double length_s) {
  constexpr double kSteadiness = 0.3, kShape = 0.5;
  const double unit_s = static_cast<double>(corpus.unit_samples) / corpus.rate_hz;
  const std::size_t dims = corpus.dims();
  const auto length = std::max<std::size_t>(2, static_cast<std::size_t>(std::lround(length_s / unit_s)));
  const std::vector<std::uint32_t> whole = {0, static_cast<std::uint32_t>(target.units)};
  std::vector<FeatureClip> all_target = clips_of(target.causal, dims, whole, length);
  std::vector<FeatureClip> all_database = clips_of(corpus.causal.values, dims, corpus.first_unit, length);
  if (all_target.empty() || all_database.empty()) return {};
  std::vector<Correspondence> result;
  const std::size_t kept = corpus.selection.lambda > 0 ? length : 1, skipped = (length - kept) / 2;
  const auto add = [&](const FeatureClip& from, const FeatureClip& to) {
    result.push_back({static_cast<double>(from.first + skipped) * unit_s, static_cast<double>(to.first + skipped) * unit_s,
                      static_cast<double>(kept) * unit_s});
  };
  const auto quietest = [](const std::vector<FeatureClip>& clips) {
    return *std::min_element(clips.begin(), clips.end(),
                             [](const FeatureClip& a, const FeatureClip& b) { return a.mean[0] < b.mean[0]; });
  };
  add(quietest(all_target), quietest(all_database));
  const HeardClips from = heard(std::move(all_target), dims), to = heard(std::move(all_database), dims);
  if (from.clips.empty() || to.clips.empty()) return result;
  for (int k = 0; k < count; ++k) {
    const double rank = 0.04 + 0.94 * (count > 1 ? k / (count - 1.0) : 0.5);
    const double wanted = loudness_at(from, rank), met = loudness_at(to, rank);
    const std::size_t i = cheapest(from.clips.size(), [&](std::size_t c) {
      return std::abs(from.clips[c].mean[0] - wanted) + kSteadiness * from.clips[c].spread;
    });
    const std::size_t j = cheapest(to.clips.size(), [&](std::size_t c) {
      double apart = 0;
      for (std::size_t d = 0; d < dims; ++d) {
        if (d % dsp::kUnitFeatures != 0) apart += std::pow(to.score(c, d) - from.score(i, d), 2);
      }
      return std::abs(to.clips[c].mean[0] - met) + kSteadiness * to.clips[c].spread + kShape * std::sqrt(apart);
    });
    add(from.clips[i], to.clips[j]);
  }
  return result;
}

std::vector<CorrespondenceResidual> calibrate(ClothCorpus& corpus, const TargetFeatures& target,
                                              std::span<const Correspondence> correspondences) {
  WarpFit causal = fit_warp(corpus, target.causal, corpus.causal.values, correspondences);
  corpus.causal.warp = std::move(causal.warp);
  corpus.symmetric.warp = fit_warp(corpus, target.symmetric, corpus.symmetric.values, correspondences).warp;
  corpus.causal.warp_file = "cloth/warp_causal.npy";
  corpus.symmetric.warp_file = "cloth/warp_symmetric.npy";
  return std::move(causal.residuals);
}

}  // namespace rustle::pack
