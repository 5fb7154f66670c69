#include "sound_db/pack/cloth_json.h"

#include <algorithm>
#include <numeric>

#include "sound_db/dsp/unit_features.h"
#include "sound_db/pack/audio_file.h"

namespace rustle::pack {

namespace {

void read_warp(Reader& warps, const std::string& key, std::size_t dims, UnitFeatureSet& set) {
  set.warp = dsp::identity_warp(static_cast<int>(dims));
  auto warp = warps.object(key, false);
  if (!warp) return;
  set.warp.centre = warp->numbers("centre", dims, -1e6, 1e6);
  set.warp.scale = warp->number("scale", std::nullopt, 1e-12, 1e6);
  set.warp.affine = warp->numbers("affine", dims * (dims + 1), -1e9, 1e9);
  set.warp_file = warp->text("file", false);
  if (set.warp.centre.size() > dims) warp->error("centre", "has too many numbers", "one for each feature");
  if (set.warp.affine.size() > dims * (dims + 1)) {
    warp->error("affine", "has too many numbers", "(features + 1) rows of one number for each feature");
  }
  warp->warn_unknown();
}

FrictionSweep read_sweep(Reader& object, double& gain_db) {
  FrictionSweep sweep;
  sweep.file = object.text("file", true);
  sweep.fft_size = static_cast<std::uint32_t>(object.integer("fft_size", std::nullopt, 16, 65536));
  if (sweep.fft_size % 2) object.error("fft_size", "is odd", "spectra have fft_size / 2 + 1 bins");
  sweep.speeds_m_per_s = object.numbers("speeds_m_per_s", 1, 1e-5, 100);
  const auto& speeds = sweep.speeds_m_per_s;
  if (std::adjacent_find(speeds.begin(), speeds.end(), [](double a, double b) { return !(a < b); }) != speeds.end()) {
    object.error("speeds_m_per_s", "do not rise", "sort the spectra by speed");
  }
  gain_db = object.number("gain_db", 0.0, -200, 200);
  sweep.patch_area_m2 = object.number("patch_area_m2", sweep.patch_area_m2, 1e-6, 100);
  sweep.speed_threshold_m_per_s = object.number("speed_threshold_m_per_s", 0.0, 0, 100);
  if (auto compression = object.object("speed_compression", false)) {
    sweep.compression.divisor = compression->number("divisor", 1.0, 0.01, 100);
    sweep.compression.exponent = compression->number("exponent", 1.0, 0.1, 10);
    compression->warn_unknown();
  }
  object.warn_unknown();
  return sweep;
}

ClothCrumpling read_pops(Reader& object, double& gain_db) {
  ClothCrumpling crumpling;
  gain_db = object.number("gain_db", 0.0, -200, 200);
  for (Reader& unit : object.objects("units")) {
    crumpling.units.push_back({unit.text("file", true), {}, 0});
    unit.warn_unknown();
  }
  if (auto events = object.object("events", false)) {
    EnergyHistogram& histogram = crumpling.event_amplitudes;
    histogram.least = events->number("least_m", std::nullopt, 1e-12, 1e6);
    histogram.most = events->number("most_m", std::nullopt, 1e-12, 1e6);
    histogram.counts = events->numbers("counts", 1, 0, 1e12);
    if (!(histogram.least < histogram.most)) events->error("most_m", "is not above least_m", "correct it");
    if (!(std::accumulate(histogram.counts.begin(), histogram.counts.end(), 0.0) > 0)) {
      events->error("counts", "are all 0", "take events out, or calibrate it anew");
    }
    events->warn_unknown();
  }
  object.warn_unknown();
  return crumpling;
}

Json warp_json(const UnitFeatureSet& set) {
  Json object{{"centre", set.warp.centre}, {"scale", set.warp.scale}, {"affine", set.warp.affine}};
  if (!set.warp_file.empty()) object["file"] = set.warp_file;
  return object;
}

}  // namespace

ClothManifest read_cloth_manifest(Reader& section, std::uint32_t stored_rate_hz) {
  ClothManifest manifest;
  ClothCorpus& corpus = manifest.corpus;
  corpus.rate_hz = stored_rate_hz;
  corpus.unit_s = 1.0 / section.number("units_per_s", std::nullopt, 10, 1000);
  corpus.unit_samples = dsp::unit_length(corpus.unit_s, stored_rate_hz);
  corpus.channels = static_cast<int>(section.integer("channels", 1, 1, kMostChannels));
  corpus.gain_db = section.number("gain_db", 0.0, -200, 200);
  corpus.wale_spacing_m = section.number("wale_spacing_m", 0.0, 0, 1);
  for (Reader& object : section.objects("recordings")) {
    corpus.recordings.push_back({object.text("file", true), {}});
    object.warn_unknown();
  }
  if (corpus.recordings.empty()) section.error("recordings", "are none", "name at least one recording of the cloth");
  if (auto features = section.object("features", true)) {
    const auto widths = features->numbers("widths", dsp::kUnitFeatures, 1, 10000);
    if (widths.size() > dsp::kUnitFeatures) features->error("widths", "has too many numbers", "one for each feature");
    corpus.selection.filter_widths.assign(widths.begin(), widths.end());
    corpus.causal.file = features->text("causal", true);
    corpus.symmetric.file = features->text("symmetric", true);
    features->warn_unknown();
  }
  if (auto selection = section.object("selection", false)) {
    SelectionParameters& s = corpus.selection;
    s.look_ahead = static_cast<int>(selection->integer("look_ahead", s.look_ahead, 0, 240));
    s.greatest_distance = selection->number("d_max", s.greatest_distance, 0, 1e6);
    s.cool_off = static_cast<int>(selection->integer("cool_off", s.cool_off, 0, 100000));
    selection->warn_unknown();
  }
  corpus.causal.warp = corpus.symmetric.warp = dsp::identity_warp(static_cast<int>(corpus.dims()));
  if (auto warps = section.object("warp", false)) {
    corpus.selection.lambda = warps->number("lambda", corpus.selection.lambda, 0, 1e15);
    read_warp(*warps, "causal", corpus.dims(), corpus.causal);
    read_warp(*warps, "symmetric", corpus.dims(), corpus.symmetric);
    warps->warn_unknown();
  }
  if (auto friction = section.object("friction", true)) corpus.friction = read_sweep(*friction, manifest.friction_gain_db);
  if (auto crumpling = section.object("crumpling", false)) {
    corpus.crumpling = read_pops(*crumpling, manifest.crumpling_gain_db);
  }
  section.warn_unknown();
  return manifest;
}

Json cloth_json(const ClothManifest& manifest) {
  const ClothCorpus& corpus = manifest.corpus;
  Json section{{"version", 1}, {"units_per_s", 1.0 / corpus.unit_s}, {"channels", corpus.channels}};
  section["gain_db"] = corpus.gain_db;
  section["wale_spacing_m"] = corpus.wale_spacing_m;
  section["recordings"] = Json::array();
  for (const SourceRecording& recording : corpus.recordings) section["recordings"].push_back({{"file", recording.file}});
  section["features"] = {
      {"widths", corpus.selection.filter_widths}, {"causal", corpus.causal.file}, {"symmetric", corpus.symmetric.file}};
  section["selection"] = {{"look_ahead", corpus.selection.look_ahead},
                          {"d_max", corpus.selection.greatest_distance},
                          {"cool_off", corpus.selection.cool_off}};
  section["warp"] = {{"lambda", corpus.selection.lambda}};
  if (!corpus.causal.warp.identity()) section["warp"]["causal"] = warp_json(corpus.causal);
  if (!corpus.symmetric.warp.identity()) section["warp"]["symmetric"] = warp_json(corpus.symmetric);
  section["friction"] = {{"file", corpus.friction.file},
                         {"fft_size", corpus.friction.fft_size},
                         {"speeds_m_per_s", corpus.friction.speeds_m_per_s},
                         {"gain_db", manifest.friction_gain_db},
                         {"patch_area_m2", corpus.friction.patch_area_m2},
                         {"speed_threshold_m_per_s", corpus.friction.speed_threshold_m_per_s}};
  if (const SpeedCompression& compression = corpus.friction.compression; compression != SpeedCompression{})
    section["friction"]["speed_compression"] = {{"divisor", compression.divisor}, {"exponent", compression.exponent}};
  if (!corpus.crumpling) return section;
  Json crumpling{{"gain_db", manifest.crumpling_gain_db}, {"units", Json::array()}};
  for (const ClothCrumplingUnit& unit : corpus.crumpling->units) crumpling["units"].push_back({{"file", unit.file}});
  if (const EnergyHistogram& events = corpus.crumpling->event_amplitudes; !events.counts.empty()) {
    crumpling["events"] = {{"least_m", events.least}, {"most_m", events.most}, {"counts", events.counts}};
  }
  section["crumpling"] = std::move(crumpling);
  return section;
}

}  // namespace rustle::pack
