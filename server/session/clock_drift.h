#pragma once

#include <cstdint>
#include <optional>

namespace rustle::session {

/// How much faster a sender's clock runs than ours, from when its messages say they left and when they came.
///   d_k = the least delay (arrived - sent) of second k;   drift = -slope of the least-squares line through the d_k
/// The least delay of a second is the one that waited for nothing. A delay that jumps by more than a second is a sender that
/// stood still or started again: the estimate begins anew. One thread at a time.
class ClockDrift {
 public:
  /// Both in seconds, of any origin, finite; `arrived_s` does not decrease.
  void add(double sent_s, double arrived_s);

  /// Parts per million, positive where the sender's clock is the faster one; 0 until ten whole seconds were seen.
  double ppm() const;

 private:
  struct Second {
    double began_s;
    double least_delay_s;
    double at_s;  ///< when the least delay was seen
  };

  std::optional<Second> second_;
  double first_at_s_ = 0, first_delay_s_ = 0;
  std::uint64_t seconds_ = 0;
  double sum_t_ = 0, sum_d_ = 0, sum_tt_ = 0, sum_td_ = 0;
};

}  // namespace rustle::session
