#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "server/synthesis/nonblocking.h"

namespace rustle::session {

/// How often something took how long. One thread at a time adds, any thread reads; wait-free.
class DurationHistogram {
 public:
  /// Upper ends of the ranges, in seconds; what takes longer than the last falls into one more.
  static constexpr std::array kUpTo_s = {0.00001, 0.000025, 0.00005, 0.0001, 0.00025, 0.0005, 0.001, 0.0025,
                                         0.005,   0.01,     0.025,   0.05,   0.1,     0.25,   0.5,   1.0};

  struct Counts {
    std::array<std::uint64_t, kUpTo_s.size() + 1> in_range{};
    double sum_s = 0;

    std::uint64_t all() const {
      std::uint64_t sum = 0;
      for (const std::uint64_t count : in_range) sum += count;
      return sum;
    }
    Counts& operator+=(const Counts& other) {
      for (std::size_t k = 0; k < in_range.size(); ++k) in_range[k] += other.in_range[k];
      sum_s += other.sum_s;
      return *this;
    }
  };

  /// What took less than nothing took nothing.
  void add(std::chrono::nanoseconds duration) noexcept RUSTLE_NONBLOCKING {
    const std::int64_t ns = duration.count() > 0 ? duration.count() : 0;
    std::size_t range = 0;
    while (range < kUpTo_s.size() && static_cast<double>(ns) > 1e9 * kUpTo_s[range]) ++range;
    // No other thread writes: no need for one indivisible step. What is counted is in the sum already.
    sum_ns_.store(sum_ns_.load(std::memory_order_relaxed) + ns, std::memory_order_relaxed);
    in_range_[range].store(in_range_[range].load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }

  Counts counts() const noexcept {
    Counts out;
    for (std::size_t k = 0; k < in_range_.size(); ++k) out.in_range[k] = in_range_[k].load(std::memory_order_acquire);
    out.sum_s = 1e-9 * static_cast<double>(sum_ns_.load(std::memory_order_relaxed));
    return out;
  }

 private:
  std::array<std::atomic<std::uint64_t>, kUpTo_s.size() + 1> in_range_{};
  std::atomic<std::int64_t> sum_ns_{0};
};

}  // namespace rustle::session
