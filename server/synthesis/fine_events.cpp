#include "server/synthesis/fine_events.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

#include "server/synthesis/resonator_level.h"
#include "sound_db/dsp/level.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/query.h"

namespace rustle::synthesis {
namespace {

using dsp::Random;
using observation::BendingPatch;

constexpr std::uint64_t kFineIds = std::uint64_t{1} << 63;  // apart from those of visible events
constexpr std::uint64_t kBurstStream = 0xb0057;
constexpr double kMostAftershocks = 40;  // of one parent
constexpr double kBurstFirst_s = 0.002;
constexpr double kBurstLast_s = 0.3;
constexpr double kMostStray = 2;  // of a place, in standard deviations

/// Mean of E^power for E_max = 1: density ∝ E^-τ from 1/range to 1.
double pareto_moment(double power) {
  const double low = 1 / kFineRange, b = 1 - kFineExponent;
  return b / (1 - std::pow(low, b)) * (1 - std::pow(low, power + b)) / (power + b);
}

std::uint32_t poisson(Random& random, double mean) {
  std::uint32_t count = 0;
  for (double at = -std::log(1 - random.uniform()); at < mean; at -= std::log(1 - random.uniform())) ++count;
  return count;
}

SampleTime samples(double duration_s, std::uint32_t rate_hz) {
  return std::llround(duration_s * rate_hz);
}

bool earlier(const FineEvent& a, const FineEvent& b) {
  return a.onset < b.onset;
}

}  // namespace

double strongest_fine_energy() {
  static const double energy = kFineEnergy_per_m / (kFineParents_per_m * (1 + kFineAftershocks)) / pareto_moment(1);
  return energy;
}

void draw_fine_events(const FineFrame& frame, std::span<const BendingPatch> bending, std::vector<FineEvent>& out) {
  static const double kMeanRoot = pareto_moment(0.5);
  const double strongest = strongest_fine_energy();
  const auto first = static_cast<std::ptrdiff_t>(out.size());
  const auto length = static_cast<double>(std::max<SampleTime>(1, frame.to - frame.from));
  for (std::uint32_t p = 0; p < bending.size(); ++p) {
    Random random(dsp::hash(dsp::hash(frame.seed, frame.sheet, frame.frame), bending[p].patch));
    const double expected = kFineParents_per_m * bending[p].change_m;
    std::size_t parents = 0;
    for (double at = -std::log(1 - random.uniform()); at < expected && parents < kMostFineParents;
         at -= std::log(1 - random.uniform()), ++parents) {
      const double parent = random.truncated_pareto(kFineExponent, 1 / kFineRange, 1);
      const SampleTime onset = frame.from + static_cast<SampleTime>(at / expected * length);
      out.push_back({onset, strongest * parent, p, false});
      const double followers = std::min(kMostAftershocks, kFineAftershocks * std::sqrt(parent) / kMeanRoot);
      for (std::uint32_t left = poisson(random, followers); left > 0; --left) {
        const SampleTime after = onset + samples(random.log_uniform(kFineFirst_s, kFineLast_s), frame.rate_hz);
        out.push_back({after, strongest * random.truncated_pareto(kFineExponent, 1 / kFineRange, 1), p, true});
      }
    }
  }
  std::stable_sort(out.begin() + first, out.end(), earlier);
}

void draw_burst(std::uint64_t seed, sheet::SheetId sheet, std::uint64_t event, SampleTime onset, std::uint32_t rate_hz,
                std::vector<FineEvent>& out) {
  const auto first = static_cast<std::ptrdiff_t>(out.size());
  Random random(dsp::hash(dsp::hash(seed, sheet, event), kBurstStream));
  for (std::uint32_t left = poisson(random, kBurstEvents); left > 0; --left) {
    const SampleTime delay = samples(random.log_uniform(kBurstFirst_s, kBurstLast_s), rate_hz);
    out.push_back({onset + delay, random.truncated_pareto(kFineExponent, 1 / kFineRange, 1), 0, true});
  }
  std::stable_sort(out.begin() + first, out.end(), earlier);
}

bool FineEventsPlan::wanted(const SheetPlan& sheet) const {
  return options_.fine_events && sheet.fine_events && options_.mode != Mode::kPublished;
}

void FineEventsPlan::plan(const SheetPlan& sheet, const observation::Observation& observation, SampleTime earliest) {
  const std::uint64_t frame = ++frames_[sheet.id];
  if (observation.bending.empty() || !wanted(sheet)) return;
  const auto& section = sheet.material->pack().crumpling;
  const SampleTime before = to_sample(options_, observation.previous_time_s);
  const SampleTime from = std::max(before, earliest);
  const SampleTime to = from + std::max<SampleTime>(1, to_sample(options_, observation.time_s) - before);
  drawn_.clear();
  draw_fine_events({options_.seed, sheet.id, frame, from, to, options_.rate_hz}, observation.bending, drawn_);
  const std::uint64_t root = dsp::hash(options_.seed, sheet.id, frame);
  for (std::size_t i = 0; i < drawn_.size(); ++i) {
    const FineEvent& event = drawn_[i];
    const BendingPatch& patch = observation.bending[event.patch];
    const std::uint64_t id = dsp::hash(root, i) | kFineIds;
    const double amplitude_m = kClacAmplitude_m * std::sqrt(event.energy);
    const double reference_m = section ? std::max(1e-9, section->reference_amplitude_m({})) : kClacAmplitude_m;
    const double gain = std::min(amplitude_m / reference_m, dsp::db_to_gain(kMostFineGain_db));
    if (!add(sheet, id, event.onset, earliest, gain,
             {patch.position_m, patch.normal, patch.normal_spread, patch.covariance_m2})) {
      ++missing_;
    }
  }
}

void FineEventsPlan::plan_burst(const SheetPlan& sheet, const observation::CrumplingEvent& event, double peak,
                                SampleTime onset, SampleTime earliest) {
  if (!wanted(sheet) || !(peak > 0)) return;
  const auto& section = sheet.material->pack().crumpling;
  if (!section) return;
  double loudest = 0;
  for (const std::uint32_t unit : sheet.material->clacs()) {
    const pack::Unit& clac = section->units[unit];
    loudest = std::max(loudest, loudness_.of(clac.samples.data(), static_cast<std::uint32_t>(clac.samples.size())).peak);
  }
  if (!(loudest > 0)) return;
  Place place{event.position_m, {0, 0, 1}, 0, Eigen::Matrix3d::Zero()};
  const auto largest = std::max_element(event.resonators.begin(), event.resonators.end(),
                                        [](const auto& a, const auto& b) { return a.area_m2 < b.area_m2; });
  if (largest != event.resonators.end()) {
    place = {event.position_m, largest->normal, largest->normal_spread, largest->covariance_m2 / 4};
  }
  const double strongest = peak * dsp::db_to_gain(kBurstPeak_db) / loudest / pack::emission_gain(section->geometry);
  drawn_.clear();
  draw_burst(options_.seed, sheet.id, event.id, onset, options_.rate_hz, drawn_);
  const std::uint64_t root = dsp::hash(dsp::hash(options_.seed, sheet.id, event.id), kBurstStream);
  for (std::size_t i = 0; i < drawn_.size(); ++i) {
    add(sheet, dsp::hash(root, i) | kFineIds, drawn_[i].onset, earliest, strongest * std::sqrt(drawn_[i].energy), place);
  }
}

bool FineEventsPlan::add(const SheetPlan& sheet, std::uint64_t id, SampleTime onset, SampleTime earliest, double gain,
                         const Place& place) {
  const auto& section = sheet.material->pack().crumpling;
  const std::vector<std::uint32_t>& variants = sheet.material->clacs();
  if (variants.empty()) return false;
  Random random(id);
  auto& last = last_.try_emplace(sheet.id, pack::kNoUnit).first->second;
  last = pack::choose_variant(variants, random.uniform(), last);
  const pack::Unit& unit = section->units[last];
  observation::Resonator resonator;
  const Eigen::Matrix3d spread = place.covariance_m2 + 1e-12 * Eigen::Matrix3d::Identity();
  const Eigen::LLT<Eigen::Matrix3d> root(spread);
  sheet::Vec3d stray;
  for (int k = 0; k < 3; ++k) stray[k] = std::clamp(random.normal(), -kMostStray, kMostStray);
  resonator.position_m = place.position_m;
  if (root.info() == Eigen::Success) resonator.position_m += root.matrixL() * stray;
  resonator.normal = place.normal;
  resonator.normal_spread = place.normal_spread;
  CrumpleCue cue;
  cue.onset = std::max(onset, earliest);
  cue.start = std::max(cue.onset - kQuantum, earliest);
  cue.event = id;
  cue.bus = bus_of(sheet.index, SoundKind::kCrumpling);
  cue.unit = unit.samples.data();
  cue.unit_samples = static_cast<std::uint32_t>(unit.samples.size());
  cue.gain = static_cast<float>(gain * pack::emission_gain(section->geometry));
  cue.emitter = emitter_of(options_.mode, resonator);
  waiting_.push_back(cue);
  return true;
}

void FineEventsPlan::release(SampleTime until, std::vector<Cue>& out) {
  const auto due =
      std::stable_partition(waiting_.begin(), waiting_.end(), [&](const CrumpleCue& cue) { return cue.start >= until; });
  std::sort(due, waiting_.end(), [](const CrumpleCue& a, const CrumpleCue& b) {
    return std::pair(a.start, a.event) < std::pair(b.start, b.event);
  });
  out.insert(out.end(), due, waiting_.end());
  waiting_.erase(due, waiting_.end());
}

}  // namespace rustle::synthesis
