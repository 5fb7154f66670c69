#include "server/session/clock_drift.h"

#include <cmath>

namespace rustle::session {
namespace {

constexpr double kJump_s = 1.0;
constexpr std::uint64_t kLeastSeconds = 10;

}  // namespace

void ClockDrift::add(double sent_s, double arrived_s) {
  const double delay_s = arrived_s - sent_s;
  if (!second_ || std::abs(delay_s - second_->least_delay_s) > kJump_s) {
    *this = {};
    second_ = {arrived_s, delay_s, arrived_s};
    first_at_s_ = arrived_s;
    first_delay_s_ = delay_s;
    return;
  }
  if (arrived_s - second_->began_s >= 1.0) {
    const double t = second_->at_s - first_at_s_, d = second_->least_delay_s - first_delay_s_;
    ++seconds_;
    sum_t_ += t;
    sum_d_ += d;
    sum_tt_ += t * t;
    sum_td_ += t * d;
    second_ = {arrived_s, delay_s, arrived_s};
  } else if (delay_s < second_->least_delay_s) {
    second_->least_delay_s = delay_s;
    second_->at_s = arrived_s;
  }
}

double ClockDrift::ppm() const {
  if (seconds_ < kLeastSeconds) return 0;
  const auto n = static_cast<double>(seconds_);
  const double spread = n * sum_tt_ - sum_t_ * sum_t_;
  return spread > 0 ? -1e6 * (n * sum_td_ - sum_t_ * sum_d_) / spread : 0;
}

}  // namespace rustle::session
