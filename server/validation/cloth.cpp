#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <stdexcept>

#include "client_sdk/sheets/cloth_motion.h"
#include "server/engine/ingest.h"
#include "server/synthesis/cloth_stream.h"
#include "server/synthesis/cloth_targets.h"
#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "server/validation/virtual_sheet.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/thin_plate_spline.h"
#include "sound_db/pack/calibration.h"

namespace rustle::validation {
namespace {

using synthesis::ClothTouch;
using synthesis::SampleTime;

constexpr std::array<std::string_view, 4> kClothMaterials = {"cotton", "polyester", "windbreaker", "corduroy"};
constexpr double kSlowest_m_per_s = 0.1, kFastest_m_per_s = 1.2, kSlide_s = 2.5;
constexpr std::uint64_t kTakes = 8;

/// What a motion's geometry does.
std::vector<observation::Observation> observe(const Setting& setting, const std::vector<engine::StreamItem>& items) {
  engine::Options options;
  options.default_material = kClothMaterials.front();
  options.every_material = kClothMaterials.front();
  engine::Ingest ingest(options, setting.packs);
  std::vector<observation::Observation> seen;
  for (const engine::StreamItem& item : items) {
    engine::CueBatch batch;
    const auto taken = ingest.accept(item, batch);
    if (!taken) throw std::runtime_error(taken.error().field + ": " + taken.error().message);
    if (*taken) seen.push_back(**taken);
  }
  return seen;
}

/// One material's sound of a motion, patch by patch: what was aimed at and what came of it.
struct PlayedPatch {
  std::vector<float> target, result;
  std::map<std::int64_t, std::uint32_t> units;  ///< by place
  std::vector<std::int64_t> joins;              ///< where runs begin and end
};
struct PlayedCloth {
  std::vector<PlayedPatch> patches;
  double latency_s = 0;
};

PlayedCloth play_cloth(const pack::ClothCorpus& corpus, const std::shared_ptr<const cloth::PreparedCorpus>& prepared,
                       const std::vector<observation::Observation>& seen, std::uint64_t seed) {
  const synthesis::PlanOptions options{.seed = seed, .origin_s = seen.front().time_s};
  synthesis::ClothTargets targets(prepared, options, seed, 0);
  synthesis::ClothStream stream(prepared, options, 0, seed, 0);
  std::vector<synthesis::Cue> cues;
  for (const observation::Observation& frame : seen) {
    std::vector<ClothTouch> touches;
    for (const auto& contact : frame.friction) touches.push_back({&contact, 1});
    targets.add(frame, touches, true, {});
    stream.add(frame, touches, true, {}, cues);
  }
  targets.end();
  stream.end(cues);
  PlayedCloth out;
  out.latency_s = static_cast<double>(prepared->latency_samples()) / corpus.rate_hz;
  out.patches.resize(targets.outputs());
  const auto samples = static_cast<std::size_t>(targets.settled());
  for (std::size_t p = 0; p < out.patches.size(); ++p) {
    PlayedPatch& patch = out.patches[p];
    patch.target.resize(samples);
    patch.result.resize(samples);
    targets.read(p, 0, patch.target);
    for (const synthesis::Cue& cue : cues) {
      const auto* piece = std::get_if<synthesis::ClothPieceCue>(&cue);
      if (piece == nullptr || piece->patch != synthesis::ClothStream::patch_id(seed, p, 0)) continue;
      for (SampleTime n = 0; n < piece->count; ++n) {
        const SampleTime at = piece->first + n;
        if (at >= 0 && at < static_cast<SampleTime>(samples))
          patch.result[static_cast<std::size_t>(at)] += piece->samples[n];
      }
      const SampleTime place = piece->until / corpus.unit_samples - 1;
      // The unit of a piece that reaches to its place's end is where its last sample lies.
      if (piece->first + piece->count != piece->until) continue;
      std::uint32_t first_unit = 0;
      for (const auto& recording : corpus.recordings) {
        const auto& source = recording.channels[0];
        const auto last = piece->samples + piece->count - 1 - source.data();
        if (last >= 0 && last < static_cast<std::ptrdiff_t>(source.size()))
          patch.units[place] = first_unit + static_cast<std::uint32_t>(last / corpus.unit_samples);
        first_unit += static_cast<std::uint32_t>(source.size() / static_cast<std::size_t>(corpus.unit_samples));
      }
    }
    const cloth::JoinedSource& source = prepared->source(0);
    for (const auto& [place, unit] : patch.units) {
      // Where nothing sounds before, nothing is joined.
      const auto before = patch.units.find(place - 1);
      if (before == patch.units.end() || source.follows(before->second, unit)) continue;
      patch.joins.push_back(place * corpus.unit_samples + source.before(unit).offset);
      patch.joins.push_back(place * corpus.unit_samples + source.after(before->second).count);
    }
  }
  return out;
}

double correlation(std::span<const double> x, std::span<const double> y) {
  const auto n = static_cast<double>(x.size());
  const double mean_x = std::accumulate(x.begin(), x.end(), 0.0) / n, mean_y = std::accumulate(y.begin(), y.end(), 0.0) / n;
  double xx = 0, xy = 0, yy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xx += (x[i] - mean_x) * (x[i] - mean_x);
    xy += (x[i] - mean_x) * (y[i] - mean_y);
    yy += (y[i] - mean_y) * (y[i] - mean_y);
  }
  return xy / std::sqrt(xx * yy);
}

/// First features of the warped target and of the result, where units were chosen, all patches together.
double loudness_followed(const pack::ClothCorpus& corpus, const PlayedCloth& played) {
  std::vector<double> wanted, heard;
  const std::size_t dims = corpus.dims();
  for (const PlayedPatch& patch : played.patches) {
    const std::vector<std::vector<float>> target{patch.target}, result{patch.result};
    auto aimed = pack::target_features(corpus, target).causal;
    const auto came = pack::target_features(corpus, result).causal;
    for (const auto& [place, unit] : patch.units) {
      const auto i = static_cast<std::size_t>(place) * dims;
      if (i + dims > aimed.size()) continue;
      const auto row = std::span(aimed).subspan(i, dims);
      if (!corpus.causal.warp.identity()) dsp::warp(corpus.causal.warp, row, row);
      wanted.push_back(static_cast<double>(row[0]));
      heard.push_back(static_cast<double>(came[i]));
    }
  }
  return correlation(wanted, heard);
}

double repeated(const pack::ClothCorpus& corpus, const PlayedCloth& played) {
  std::map<std::uint32_t, std::vector<std::int64_t>> places;
  for (const PlayedPatch& patch : played.patches) {
    for (const auto& [place, unit] : patch.units) places[unit].push_back(place);
  }
  double count = 0;
  for (auto& [unit, list] : places) {
    std::ranges::sort(list);
    for (std::size_t i = 1; i < list.size(); ++i) count += list[i] - list[i - 1] <= corpus.selection.cool_off ? 1 : 0;
  }
  return count;
}

/// 99.9th percentile, in dB, of steps at these places (the largest of three) over the RMS step of the 2 ms on either side.
double steps_db(std::span<const float> signal, const std::vector<std::int64_t>& places) {
  constexpr std::int64_t kHalf = 96;
  std::vector<double> squares(signal.size() + 1), steps(signal.size());
  for (std::size_t n = 1; n < signal.size(); ++n)
    steps[n] = std::abs(static_cast<double>(signal[n]) - static_cast<double>(signal[n - 1]));
  for (std::size_t n = 0; n < signal.size(); ++n) squares[n + 1] = squares[n] + steps[n] * steps[n];
  std::vector<double> out;
  for (const std::int64_t place : places) {
    if (place <= kHalf || place >= static_cast<std::int64_t>(signal.size()) - kHalf - 2) continue;
    const auto p = static_cast<std::size_t>(place);
    const double around = (squares[p + kHalf + 1] - squares[p - kHalf]) / (2 * kHalf + 1);
    if (around > 1e-14) out.push_back(20 * std::log10(std::max({steps[p - 1], steps[p], steps[p + 1]}) / std::sqrt(around)));
  }
  if (out.empty()) return -kUnbounded;
  std::ranges::sort(out);
  return out[static_cast<std::size_t>(0.999 * static_cast<double>(out.size() - 1))];
}

/// How much louder joins step than the rest of the sound.
double joins_louder_db(std::span<const PlayedCloth> takes, std::uint64_t seed) {
  std::vector<float> sound;
  std::vector<std::int64_t> joins, random;
  dsp::Random draw(dsp::hash(seed, 41));
  for (const PlayedCloth& played : takes) {
    for (const PlayedPatch& patch : played.patches) {
      const auto first = static_cast<std::int64_t>(sound.size());
      for (const std::int64_t place : patch.joins) joins.push_back(first + place);
      sound.insert(sound.end(), patch.result.begin(), patch.result.end());
    }
  }
  for (int i = 0; i < 100'000; ++i) random.push_back(draw.index(static_cast<std::uint32_t>(sound.size())));
  return steps_db(sound, joins) - steps_db(sound, random);
}

/// A piece of cloth, 10 x 10 cm, that lies on the table and is slid at an even speed, there and back.
std::unique_ptr<sheets::AnimatedSheet> make_slid(double speed_m_per_s) {
  sheets::Animation animation;
  animation.duration_s = kSlide_s;
  animation.on_table = true;
  animation.map_at = [speed_m_per_s](double t) -> sheets::MaterialMap {
    constexpr double kWay_m = 0.3;
    const double way = std::fmod(speed_m_per_s * t, 2 * kWay_m);
    return [x = way < kWay_m ? way : 2 * kWay_m - way](double u, double v) -> sheets::Point3 {
      return {u + x - kWay_m / 2, v, 0};
    };
  };
  return sheets::make_animated(sheets::make_rectangle(sheets::MeshKind::kDelaunay, 0.1, 0.1, 200, 1), std::move(animation));
}

struct ClothMotion {
  std::string name;
  std::vector<observation::Observation> seen;
};

}  // namespace

Findings cloth(const Setting& setting) {
  Findings findings;
  const auto check = [&](std::string name, double ours, Bound bound, std::string unit, std::string meaning) {
    findings.checks.push_back(
        {"cloth/" + std::move(name), ours, std::nullopt, std::move(bound), std::move(unit), std::move(meaning)});
  };
  std::vector<ClothMotion> motions;
  const auto demo = sheets::make_cloth_demo(1333, setting.seed);
  Take take;
  take.sheet = demo.get();
  take.obstacles = {table(false)};
  motions.push_back({"rubbed", observe(setting, stream_of(take))});
  for (const auto& [name, items] : setting.captures) motions.push_back({name, observe(setting, items)});

  Pictures pictures;
  pictures.rows = 2;
  std::map<std::string, std::shared_ptr<const pack::SoundPack>> packs;
  for (const std::string_view name : kClothMaterials) {
    auto loaded = setting.packs->load(std::string(name), "", kRate_hz);
    if (loaded && (*loaded)->cloth) {
      packs[std::string(name)] = *loaded;
    } else {
      findings.notices.push_back(fmt::format("There is no pack of {}: its sound was not looked at.", name));
    }
  }
  std::size_t done = 0;
  for (const auto& [name, pack] : packs) {
    const pack::ClothCorpus& corpus = *pack->cloth;
    const auto prepared = cloth::prepared(pack->cloth);
    if (corpus.channels != 1) continue;
    for (const ClothMotion& motion : motions) {
      // So many joins that a thousandth of them are some.
      std::vector<PlayedCloth> takes;
      for (std::uint64_t k = 0; k < kTakes; ++k)
        takes.push_back(play_cloth(corpus, prepared, motion.seen, setting.seed + k));
      const PlayedCloth& played = takes.front();
      check(fmt::format("loudness/{}/{}", motion.name, name), loudness_followed(corpus, played), at_least(0.95), "",
            "correlation of the first feature of the warped target with that of the result, unit by unit");
      check(fmt::format("repeated/{}/{}", motion.name, name), repeated(corpus, played), at_most(0), "",
            "units that came again before they had cooled off, in any patch (Algorithm 1)");
      check(fmt::format("joins/{}/{}", motion.name, name), joins_louder_db(takes, setting.seed), at_most(3, "dB"), "dB",
            "steps where runs of units begin and end over those at random places, 99.9th percentiles (C6)");
      if (&motion != &motions.front()) continue;
      check("latency/" + name, 1000 * played.latency_s, corpus.unit_s < 0.005 ? at_most(110, "ms") : shown(), "ms",
            "how much later than its motion it is heard live, the playout delay apart: L + 1 units and more (C5), so that "
            "nothing is asked of longer units than 4.2 ms");
    }
    setting.progress(static_cast<double>(++done) / static_cast<double>(packs.size()));
    std::vector<double> levels_db;
    for (const double speed : {kSlowest_m_per_s, std::sqrt(kSlowest_m_per_s * kFastest_m_per_s), kFastest_m_per_s}) {
      const auto slid = make_slid(speed);
      Take slide;
      slide.sheet = slid.get();
      slide.obstacles = {table(false)};
      slide.material = name;
      slide.seed = setting.seed;
      levels_db.push_back(dsp::rms_dbfs(play(setting, slide).between(0.5, kSlide_s - 0.3)));
    }
    check("rises/" + name, levels_db[2] - levels_db[0], at_least(6, "dB"), "dB",
          "how much louder a slid piece of 10 x 10 cm is at 1.2 than at 0.1 m/s");
    check("keeps_rising/" + name, std::min(levels_db[1] - levels_db[0], levels_db[2] - levels_db[1]), at_least(3, "dB"),
          "dB", "least rise of its level from 0.1 to 0.35 and on to 1.2 m/s");
    Take heard = take;
    heard.material = name;
    pictures.pictures.push_back(
        {name, play(setting, heard).between(0, demo->duration_s()), static_cast<double>(kRate_hz), 100});
  }
  if (!pictures.pictures.empty()) {
    findings.figures.push_back({"Cloth that is rubbed, crumpled and pulled away",
                                "Strokes over a table until 3.3 s, wrinkles that run along it until 7, pulled away at 7.3.",
                                std::move(pictures)});
  }
  return findings;
}

}  // namespace rustle::validation
