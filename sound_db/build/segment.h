#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

/// Finding single sounds in a recording by an energy window and a threshold (An et al. 2012, 3.3, after Houle and Sethna
/// 1996).
namespace rustle::build {

/// Samples [begin, end).
struct Segment {
  std::size_t begin = 0, end = 0;
  std::size_t length() const { return end - begin; }
  friend bool operator==(const Segment&, const Segment&) = default;
};

/// Mean square over a window centred on each sample; zero outside the signal.
std::vector<double> windowed_power(std::span<const float> signal, std::size_t window);

/// Runs of samples whose windowed power exceeds `threshold`, runs no more than `join` samples apart taken as one. Each
/// begins `lead` samples before the first sample as loud as the threshold (the window is ahead of the sound by half its
/// length), at the zero crossing before, and ends at the first zero crossing after the run; those of neighbours never
/// overlap.
/// \pre power.size() == signal.size()
std::vector<Segment> find_segments(std::span<const float> signal, std::span<const double> power, double threshold,
                                   std::size_t join, std::size_t lead = 0);

/// Power that a tenth of the windows stay below: the noise between sounds, or nearly the sound itself where there is no
/// pause.
double noise_power(std::span<const double> power, std::size_t window);

}  // namespace rustle::build
