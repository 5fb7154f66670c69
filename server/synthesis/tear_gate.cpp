#include "server/synthesis/tear_gate.h"

#include <cmath>
#include <numbers>

namespace rustle::synthesis {
namespace {

/// Mean of the truncated Pareto distribution that energies are drawn from.
double mean_energy() noexcept {
  constexpr double kPower = 1 - kTearExponent;
  return kPower / (kPower + 1) * (std::pow(kTearEnergyRange, kPower + 1) - 1) / (std::pow(kTearEnergyRange, kPower) - 1);
}

const double kMeanEnergy = mean_energy();
const double kMeanGap_m = (kTearMostGap_m - kTearLeastGap_m) / std::log(kTearMostGap_m / kTearLeastGap_m);
const double kBreakPower = (1 - kTearBed) * kMeanGap_m / kTearBurst_m;

}  // namespace

TearBreaks::TearBreaks(std::uint64_t seed) noexcept : random_(seed), rank_(random_.normal()) {}

TearBreak TearBreaks::next() noexcept {
  rank_ = kTearPersistence * rank_ + std::sqrt(1 - kTearPersistence * kTearPersistence) * random_.normal();
  const double uniform = 0.5 * std::erfc(-rank_ / std::numbers::sqrt2);
  at_m_ += kTearLeastGap_m * std::pow(kTearMostGap_m / kTearLeastGap_m, uniform);
  return {at_m_, random_.truncated_pareto(kTearExponent, 1, kTearEnergyRange) / kMeanEnergy};
}

double TearGate::advance(double step_m) noexcept {
  torn_m_ += step_m;
  power_ *= std::exp(-step_m / kTearBurst_m);
  for (; next_.at_m <= torn_m_; next_ = breaks_.next())
    power_ += next_.energy * std::exp((next_.at_m - torn_m_) / kTearBurst_m);
  return std::sqrt(kTearBed + kBreakPower * power_);
}

double PublishedTearGate::advance(double step_m) noexcept {
  held_m_ += step_m;
  if (held_m_ >= kPublishedHold_m) {
    held_m_ = std::fmod(held_m_, kPublishedHold_m);
    draw();
  }
  return gate_;
}

void PublishedTearGate::draw() noexcept {
  gate_ = std::sqrt(2 * kPublishedAlpha + 1) * std::pow(random_.uniform(), kPublishedAlpha);
}

}  // namespace rustle::synthesis
