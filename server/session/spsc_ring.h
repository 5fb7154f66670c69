#pragma once

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "server/synthesis/nonblocking.h"

namespace rustle::session {

/// A ring between one producer and one consumer thread. Lock-free, allocates only when made.
template <typename T>
class SpscRing {
 public:
  /// Holds `capacity` entries.
  explicit SpscRing(std::size_t capacity) : slots_(capacity + 1) {}

  /// [producer] False: full, nothing was taken.
  bool push(T&& value) noexcept RUSTLE_NONBLOCKING {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    const std::size_t next = (tail + 1) % slots_.size();
    if (next == head_.load(std::memory_order_acquire)) return false;
    slots_[tail] = std::move(value);
    tail_.store(next, std::memory_order_release);
    return true;
  }

  /// [producer] Room for that many more.
  std::size_t room() const noexcept {
    const std::size_t head = head_.load(std::memory_order_acquire), tail = tail_.load(std::memory_order_relaxed);
    return slots_.size() - 1 - (tail >= head ? tail - head : slots_.size() - head + tail);
  }

  /// [consumer] False: empty.
  bool pop(T& value) noexcept RUSTLE_NONBLOCKING {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return false;
    value = std::move(slots_[head]);
    head_.store((head + 1) % slots_.size(), std::memory_order_release);
    return true;
  }

  /// [any thread] What another thread does meanwhile may be seen or not.
  bool empty() const noexcept RUSTLE_NONBLOCKING {
    return head_.load(std::memory_order_acquire) == tail_.load(std::memory_order_acquire);
  }

 private:
  std::vector<T> slots_;
  alignas(64) std::atomic<std::size_t> head_{0};
  alignas(64) std::atomic<std::size_t> tail_{0};
};

/// The same for interleaved samples, moved in runs.
class SampleRing {
 public:
  explicit SampleRing(std::size_t capacity) : samples_(capacity + 1) {}

  /// [producer] Room for that many more.
  std::size_t room() const noexcept RUSTLE_NONBLOCKING {
    const std::size_t used = distance(head_.load(std::memory_order_acquire), tail_.load(std::memory_order_relaxed));
    return samples_.size() - 1 - used;
  }

  /// [producer] \pre values.size() <= room()
  void push(std::span<const float> values) noexcept RUSTLE_NONBLOCKING {
    assert(values.size() <= room());
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    const std::size_t before_end = std::min(values.size(), samples_.size() - tail);
    std::copy_n(values.begin(), before_end, samples_.begin() + static_cast<std::ptrdiff_t>(tail));
    std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(before_end), values.size() - before_end, samples_.begin());
    tail_.store((tail + values.size()) % samples_.size(), std::memory_order_release);
  }

  /// [consumer] How many are there.
  std::size_t available() const noexcept RUSTLE_NONBLOCKING {
    return distance(head_.load(std::memory_order_relaxed), tail_.load(std::memory_order_acquire));
  }

  /// [consumer] \pre values.size() <= available()
  void pop(std::span<float> values) noexcept RUSTLE_NONBLOCKING {
    assert(values.size() <= available());
    const std::size_t head = head_.load(std::memory_order_relaxed);
    const std::size_t before_end = std::min(values.size(), samples_.size() - head);
    std::copy_n(samples_.begin() + static_cast<std::ptrdiff_t>(head), before_end, values.begin());
    std::copy_n(samples_.begin(), values.size() - before_end, values.begin() + static_cast<std::ptrdiff_t>(before_end));
    head_.store((head + values.size()) % samples_.size(), std::memory_order_release);
  }

 private:
  std::size_t distance(std::size_t from, std::size_t to) const noexcept {
    return to >= from ? to - from : samples_.size() - from + to;
  }

  std::vector<float> samples_;
  alignas(64) std::atomic<std::size_t> head_{0};
  alignas(64) std::atomic<std::size_t> tail_{0};
};

/// The newest of the values that one producer thread writes, for one consumer thread. Wait-free; values in between are lost.
template <typename T>
class LatestValue {
 public:
  /// [producer]
  void publish(const T& value) noexcept RUSTLE_NONBLOCKING {
    slots_[writing_] = value;
    writing_ = between_.exchange(writing_ | kFresh, std::memory_order_acq_rel) & ~kFresh;
  }

  /// [consumer]
  const T& latest() noexcept RUSTLE_NONBLOCKING {
    if ((between_.load(std::memory_order_relaxed) & kFresh) != 0)
      reading_ = between_.exchange(reading_, std::memory_order_acq_rel) & ~kFresh;
    return slots_[reading_];
  }

 private:
  static constexpr unsigned kFresh = 4;

  T slots_[3]{};
  unsigned writing_ = 0;
  std::atomic<unsigned> between_{1};
  unsigned reading_ = 2;
};

}  // namespace rustle::session
