#include "sound_db/build/segment.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace rustle::build {

namespace {

bool crosses(std::span<const float> signal, std::size_t n) {  // between n - 1 and n
  return signal[n] == 0 || (signal[n - 1] < 0) != (signal[n] < 0);
}

}  // namespace

std::vector<double> windowed_power(std::span<const float> signal, std::size_t window) {
  const std::size_t count = signal.size(), half = window / 2;
  std::vector<double> sum(count + 1, 0.0);
  for (std::size_t n = 0; n < count; ++n) sum[n + 1] = sum[n] + static_cast<double>(signal[n]) * signal[n];
  std::vector<double> power(count);
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t from = n > half ? n - half : 0, to = std::min(count, n + (window - half));
    power[n] = (sum[to] - sum[from]) / static_cast<double>(window);
  }
  return power;
}

std::vector<Segment> find_segments(std::span<const float> signal, std::span<const double> power, double threshold,
                                   std::size_t join, std::size_t lead) {
  assert(power.size() == signal.size());
  std::vector<Segment> runs;
  for (std::size_t n = 0; n < power.size(); ++n) {
    if (!(power[n] > threshold)) continue;
    if (!runs.empty() && n - runs.back().end <= join) {
      runs.back().end = n + 1;
    } else {
      runs.push_back({n, n + 1});
    }
  }
  const double loud = std::sqrt(threshold);
  std::size_t free_from = 0;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    Segment& run = runs[i];
    const std::size_t free_to = i + 1 < runs.size() ? runs[i + 1].begin : signal.size();
    while (run.begin + 1 < run.end && std::abs(signal[run.begin]) < loud) ++run.begin;
    run.begin = std::max(free_from, run.begin - std::min(run.begin, lead));
    while (run.begin > free_from && !crosses(signal, run.begin)) --run.begin;
    while (run.end < free_to && !crosses(signal, run.end)) ++run.end;
    free_from = run.end;
  }
  return runs;
}

double noise_power(std::span<const double> power, std::size_t window) {
  std::vector<double> seen;
  for (std::size_t n = window / 2; n < power.size(); n += std::max<std::size_t>(1, window / 4)) seen.push_back(power[n]);
  if (seen.empty()) return power.empty() ? 0.0 : power[0];
  const auto tenth = seen.begin() + static_cast<std::ptrdiff_t>(seen.size() / 10);
  std::nth_element(seen.begin(), tenth, seen.end());
  return *tenth;
}

}  // namespace rustle::build
