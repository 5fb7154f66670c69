#include "server/spatial/structural_head.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/spatial/dipole.h"
#include "server/spatial/hrtf_level.h"

namespace rustle::spatial {
namespace {

constexpr double kPinnaRate_hz = 44100;

struct PinnaEcho {
  double gain, a, b, d;
};
constexpr std::array<PinnaEcho, 5> kPinna{
    {{0.5, 1, 2, 1}, {-1, 5, 4, 0.5}, {0.5, 5, 7, 0.5}, {-0.25, 5, 11, 0.5}, {0.25, 5, 13, 0.5}}};

/// Adds an impulse between samples: a sinc of 2 kPinnaLead points under a cosine window.
void add_impulse(double at, double gain, std::vector<double>& out) {
  const int whole = static_cast<int>(std::floor(at));
  for (int n = whole - kPinnaLead + 1; n <= whole + kPinnaLead; ++n) {
    if (n < 0 || n >= static_cast<int>(out.size())) continue;
    const double x = std::numbers::pi * (n - at);
    const double window = std::cos(0.5 * x / kPinnaLead);
    out[static_cast<std::size_t>(n)] += gain * (std::abs(x) < 1e-9 ? 1 : std::sin(x) / x * window * window);
  }
}

/// At a pole of the grid every azimuth is the same direction, but not to the pinna's formula: the mean of all.
void even_out(std::span<Hrtf::Response> pole) {
  std::vector<float> mean(pole.front().filter.size());
  for (std::size_t n = 0; n < mean.size(); ++n) {
    for (const Hrtf::Response& response : pole) mean[n] += response.filter[n] / static_cast<float>(pole.size());
  }
  for (Hrtf::Response& response : pole) response.filter = mean;
}

}  // namespace

Hrtf::Response structural_response(const Vec3& direction, int ear, double rate_hz) {
  const Vec3 seen{direction.x, ear == 0 ? direction.y : -direction.y, direction.z};  // as if by the left ear
  const double cosine = std::clamp(seen.y, -1.0, 1.0);
  const double incidence = std::acos(cosine);
  const double transit_s = kHeadRadius_m / kSpeedOfSound_m_per_s;
  Hrtf::Response out;
  out.delay_s = cosine > 0 ? -transit_s * cosine : transit_s * (incidence - std::numbers::pi / 2);
  out.delay_s -= kPinnaLead / rate_hz;

  std::vector<double> echoes(static_cast<std::size_t>(Hrtf::taps_at(rate_hz)));
  add_impulse(kPinnaLead, 1, echoes);
  const double azimuth = std::atan2(seen.y, seen.x), polar = std::acos(std::clamp(seen.z, -1.0, 1.0));
  for (const PinnaEcho& echo : kPinna) {
    const double delay = echo.a * std::cos(azimuth / 2) * std::sin(echo.d * polar) + echo.b;
    add_impulse(kPinnaLead + delay * rate_hz / kPinnaRate_hz, echo.gain, echoes);
  }

  const double alpha = 1.05 + 0.95 * std::cos(1.2 * incidence);
  const double w = kSpeedOfSound_m_per_s / (kHeadRadius_m * rate_hz);
  const double b0 = (alpha + w) / (1 + w), b1 = (w - alpha) / (1 + w), a1 = (w - 1) / (1 + w);
  double x1 = 0, y1 = 0;
  out.filter.reserve(echoes.size());
  for (const double x : echoes) {
    y1 = b0 * x + b1 * x1 - a1 * y1;
    x1 = x;
    out.filter.push_back(static_cast<float>(y1));
  }
  return out;
}

Hrtf structural_head(double rate_hz) {
  std::vector<Hrtf::Response> responses;
  responses.reserve(2 * static_cast<std::size_t>(Hrtf::kDirections));
  for (int index = 0; index < Hrtf::kDirections; ++index) {
    const int column = index % Hrtf::kAzimuths, mirrored = (Hrtf::kAzimuths - column) % Hrtf::kAzimuths;
    responses.push_back(structural_response(Hrtf::direction(index), 0, rate_hz));
    responses.push_back(structural_response(Hrtf::direction(index - column + mirrored), 0, rate_hz));
  }
  for (const int pole : {0, Hrtf::kElevations - 1}) {
    even_out(std::span(responses).subspan(static_cast<std::size_t>(2 * pole * Hrtf::kAzimuths), 2 * Hrtf::kAzimuths));
  }
  level_ahead(rate_hz, responses);
  return {rate_hz, responses};
}

}  // namespace rustle::spatial
