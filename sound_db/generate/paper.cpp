#include "sound_db/generate/paper.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "sound_db/pack/bent_strip.h"

namespace rustle::generate {

namespace {

constexpr std::array<Paper, 3> kPapers{{{"printer-paper", 0.080, 104e-6, 4e-4, 0.04, 1.0},
                                        {"tracing-paper", 0.090, 75e-6, 2.5e-4, 0.03, 1.6},
                                        {"banknote", 0.097, 110e-6, 6e-4, 0.055, 0.6}}};
constexpr double kAir_kg_per_m3 = 1.2;
constexpr double kPoisson = 0.3;

}  // namespace

std::span<const Paper> papers() {
  return kPapers;
}

const Paper* find_paper(std::string_view name) {
  const auto at = std::find_if(kPapers.begin(), kPapers.end(), [&](const Paper& paper) { return paper.name == name; });
  return at == kPapers.end() ? nullptr : &*at;
}

double brightness(const Paper& paper) {
  const auto reach = [](const Paper& p) {
    return std::sqrt(p.bending_stiffness_Nm / p.grammage_kg_per_m2) / (p.loss_factor * p.loss_factor);
  };
  const Paper& printer = kPapers.front();
  return std::cbrt(printer.thickness_m / paper.thickness_m) * std::pow(reach(paper) / reach(printer), 0.365);
}

double levelled_off(double frequency_hz, double from_hz) {
  return frequency_hz * std::pow(1 + std::pow(frequency_hz / from_hz, 5), -0.12);
}

double decay_s(const Paper& paper, double frequency_hz) {
  return 2.2 / (paper.loss_factor * frequency_hz);
}

std::vector<double> strip_modes_hz(const Paper& paper, double ruling_length_m, double edge_m, double compression,
                                   double below_hz) {
  using std::numbers::pi;
  const double radius_m = pack::bent_strip(edge_m, compression).radius_m;
  const double membrane =
      12 * (1 - kPoisson * kPoisson) * paper.bending_stiffness_Nm / (paper.thickness_m * paper.thickness_m);
  const double below = 2 * pi * below_hz;
  std::vector<double> modes_hz;
  for (int nx = 0;; ++nx) {
    const double kx = nx == 0 ? 0.0 : (nx + 0.5) * pi / ruling_length_m;
    bool any = false;
    for (int ny = 1;; ++ny) {
      const double ky = ny * pi / edge_m, k2 = kx * kx + ky * ky;
      const double mass = paper.grammage_kg_per_m2 + 2 * kAir_kg_per_m3 / std::sqrt(k2);
      const double bending = paper.bending_stiffness_Nm * k2 * k2;
      if (bending / mass > below * below) break;
      any = true;
      const double kx4 = kx * kx * kx * kx;
      const double w = std::sqrt((bending + membrane / (radius_m * radius_m) * kx4 / (k2 * k2)) / mass);
      if (w < below) modes_hz.push_back(w / (2 * pi));
    }
    if (!any) break;
  }
  std::sort(modes_hz.begin(), modes_hz.end());
  return modes_hz;
}

}  // namespace rustle::generate
