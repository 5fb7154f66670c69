#include "server/synthesis/fine_events.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/synthesis/dense_bursts.h"
#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "server/validation/virtual_sheet.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"

namespace rustle::validation {
namespace {

constexpr double kCrumpled_s = 8;
constexpr double kDecades = 2;
constexpr int kDense_per_s = 10000;
constexpr double kDense_s = 3;

struct Crackling {
  std::vector<double> energies, times_s;
};

/// The fine events of a sheet being crumpled.
Crackling crackling(const Setting& setting) {
  const auto sheet = make_crumpled(1333, kCrumpled_s);
  Take take;
  take.sheet = sheet.get();
  take.seed = setting.seed;
  const Heard heard = play(setting, take);
  std::vector<synthesis::FineEvent> events;
  std::uint64_t frame = 0;
  for (const auto& observed : heard.observed) {
    synthesis::FineFrame one;
    one.seed = setting.seed;
    one.sheet = observed.sheet;
    one.frame = frame++;
    one.from = std::llround(observed.previous_time_s * kRate_hz);
    one.to = std::llround(observed.time_s * kRate_hz);
    one.rate_hz = kRate_hz;
    synthesis::draw_fine_events(one, observed.bending, events);
  }
  Crackling result;
  for (const auto& event : events) {
    result.energies.push_back(event.energy);
    result.times_s.push_back(static_cast<double>(event.onset) / kRate_hz);
  }
  std::sort(result.times_s.begin(), result.times_s.end());
  return result;
}

/// Standard deviation over mean of the waiting times: 1 for a Poisson process, more for one that is clustered.
double variation(const std::vector<double>& times_s) {
  double sum = 0, square = 0;
  for (std::size_t k = 1; k < times_s.size(); ++k) {
    const double wait_s = times_s[k] - times_s[k - 1];
    sum += wait_s;
    square += wait_s * wait_s;
  }
  const double count = static_cast<double>(times_s.size()) - 1, mean = sum / count;
  return std::sqrt(std::max(0.0, square / count - mean * mean)) / mean;
}

/// Clacs of power-law energies at random times, one cue each.
std::vector<synthesis::Cue> dense_cues(const Setting& setting) {
  std::vector<const pack::Unit*> clacs;
  for (const auto& unit : setting.pack->crumpling->units) {
    if (unit.point.constrained()) clacs.push_back(&unit);
  }
  std::vector<synthesis::Cue> cues;
  if (clacs.empty()) return cues;
  dsp::Random random(dsp::hash(setting.seed, 9));
  std::vector<double> times_s;
  for (int k = 0; k < kDense_per_s * kDense_s; ++k) times_s.push_back(kDense_s * random.uniform());
  std::sort(times_s.begin(), times_s.end());
  for (std::size_t k = 0; k < times_s.size(); ++k) {
    const pack::Unit& unit = *clacs[random.index(static_cast<std::uint32_t>(clacs.size()))];
    synthesis::CrumpleCue cue;
    cue.onset = std::llround(times_s[k] * kRate_hz) + synthesis::kQuantum;
    cue.start = cue.onset;
    cue.event = k + 1;
    cue.unit = unit.samples.data();
    cue.unit_samples = static_cast<std::uint32_t>(unit.samples.size());
    cue.gain = static_cast<float>(0.02 * std::sqrt(random.truncated_pareto(1.4, 1, 1e4)));
    cue.emitter.position_m = {0, 0, 0};
    cues.emplace_back(cue);
  }
  return cues;
}

struct Played {
  std::vector<float> samples;
  std::uint64_t lost = 0;
};

Played played(std::span<const synthesis::Cue> cues) {
  synthesis::RenderOptions options;
  options.rate_hz = kRate_hz;
  options.layout = spatial::Layout::kMono;
  options.max_sheets = 1;
  options.max_voices = 4096;
  synthesis::Mixer mixer(options);
  synthesis::ListenerCue listener;
  listener.listener = {{0, 0, 1}, {0, 0, -1}, {0, 1, 0}};
  mixer.apply(listener);
  std::vector<float> quantum(mixer.quantum_size());
  Played result;
  std::size_t next = 0;
  for (synthesis::SampleTime now = 0; now < std::llround((kDense_s + 0.1) * kRate_hz); now += synthesis::kQuantum) {
    while (next < cues.size() && synthesis::start_of(cues[next]) < now + synthesis::kQuantum) mixer.apply(cues[next++]);
    mixer.render(now, quantum);
    const auto bus = synthesis::bus_of(0, synthesis::SoundKind::kCrumpling);
    const bool sounds = mixer.sounding(bus);
    for (std::size_t n = 0; n < synthesis::kQuantum; ++n) {
      result.samples.push_back(sounds ? quantum[static_cast<std::size_t>(bus) * synthesis::kQuantum + n] : 0.0F);
    }
  }
  const auto counters = mixer.counters();
  result.lost = counters.voices_stolen + counters.voices_dropped + counters.cues_dropped;
  return result;
}

}  // namespace

Findings fine_events(const Setting& setting) {
  Findings found;
  if (!setting.pack->crumpling) return found;
  Crackling crackle;
  const auto cues = dense_cues(setting);
  auto merged = cues;
  synthesis::PlanOptions options;
  options.seed = setting.seed;
  options.rate_hz = kRate_hz;
  synthesis::DenseBursts(options).merge(merged, 0);
  Played all, few;
  run_all(setting, 3, [&](std::size_t k) {
    if (k == 0) crackle = crackling(setting);
    if (k == 1) all = played(cues);
    if (k == 2) few = played(merged);
  });

  const double most = crackle.energies.empty() ? 1 : *std::max_element(crackle.energies.begin(), crackle.energies.end());
  const double low = synthesis::strongest_fine_energy() * std::pow(10, -kDecades - 0.5);
  const double high = low * std::pow(10, kDecades);
  const PowerLaw law = fitted_power_law(crackle.energies, low, high);
  found.checks.push_back(
      {"fine_events/energy_exponent", law.exponent, std::nullopt, between(1.3, 1.6), "",
       fmt::format("maximum likelihood over two decades, {} of {} events of a sheet crumpled for {:.0f} s", law.count,
                   crackle.energies.size(), kCrumpled_s)});
  found.checks.push_back({"fine_events/clustering", variation(crackle.times_s), std::nullopt, at_least(1.3), "",
                          "coefficient of variation of the waiting times; 1: not clustered"});
  const double level_db = dsp::rms_dbfs(few.samples) - dsp::rms_dbfs(all.samples);
  found.checks.push_back(
      {"fine_events/merging", level_db, std::nullopt, around(0, 1, "dB"), "dB",
       fmt::format("level of {} clacs a second merged to {:.0f} a second over all of them played ({} lost)", kDense_per_s,
                   static_cast<double>(merged.size()) / kDense_s, all.lost + few.lost)});

  report::Plot plot;
  plot.x = {"energy", true, 0, 0, {}};
  plot.y = {"events per energy", true, 0, 0, {}};
  report::PlotSeries counts{"fine events", {}, report::Ink::kCrumpling, report::PlotSeries::Style::kDots};
  report::PlotSeries fit{
      fmt::format("exponent {:.2f}", law.exponent), {}, report::Ink::kFriction, report::PlotSeries::Style::kDashed};
  const double least =
      std::max(1e-12, crackle.energies.empty() ? 0.1 : *std::min_element(crackle.energies.begin(), crackle.energies.end()));
  constexpr int kPerDecade = 5;
  const double step = std::pow(10, 1.0 / kPerDecade);
  double anchor = 0;
  for (double from = least; from < most; from *= step) {
    const auto count = std::count_if(crackle.energies.begin(), crackle.energies.end(),
                                     [&](double e) { return e >= from && e < from * step; });
    if (count == 0) continue;
    const double middle = from * std::sqrt(step), density = static_cast<double>(count) / (from * (step - 1));
    counts.points.push_back({middle, density});
    if (anchor == 0 && middle >= low) anchor = density * std::pow(middle, law.exponent);
  }
  for (const double e : {low, high}) fit.points.push_back({e, anchor * std::pow(e, -law.exponent)});
  plot.series = {fit, counts};
  plot.bands = {{low, high, 0, kUnbounded, {report::Ink::kLevel, 0.12}}};
  found.figures.push_back({"Energies of the finest events",
                           "1: a clac at the level it was made for. Shaded: the two decades of the fit.", plot});
  const auto picture = [](std::string title, const std::vector<float>& samples) {
    Picture one;
    one.title = std::move(title);
    one.samples.assign(samples.begin() + kRate_hz, samples.begin() + kRate_hz + kRate_hz / 2);
    return one;
  };
  found.figures.push_back({"Dense bursts merged",
                           "Half a second of 10,000 clacs a second, all of them and merged in slots of 2 ms.",
                           Pictures{{picture("all", all.samples), picture("merged", few.samples)}}});
  return found;
}

}  // namespace rustle::validation
