#include "server/session/playout_clock.h"

#include <algorithm>
#include <cmath>

namespace rustle::session {
namespace {

constexpr double kWindow_s = 10;
constexpr std::size_t kWindowPoints = 4096;

constexpr double kBin_s = 0.25;
constexpr std::size_t kBinPoints = 3;
constexpr double kFade_s = 300;  // weight of a decile point falls to 1/e
constexpr double kUnsteadyFade_s = 2;
constexpr double kBinScatter_s = 0.001;  // of a decile point about the line, at least
constexpr double kSteadySlope = 300e-6;  // quartz, as a rule better
constexpr double kUnsteadySlope = 0.03;  // a simulator that keeps no clock
constexpr double kUnsteady = 0.01;
constexpr double kDoubt_s = 2, kDoubted = 0.1;
constexpr double kSignificant = 6;  // standard errors
constexpr double kLeastSlope = 0.005, kMostSlope = 200;

constexpr double kOffLine_s = 0.010;
constexpr double kLateFor_s = 0.25, kEarlyFor_s = 0.1, kStepAhead_s = 0.25;
constexpr std::size_t kOffLinePoints = 4;
constexpr std::size_t kRecent = 8;
constexpr std::size_t kScatterPoints = 32;
constexpr double kScatterOfSteps = 3;  // tenth to ninth decile, from the median step between neighbours
constexpr double kReplace_s = 0.05;
constexpr double kOtherSlope = 0.01;

constexpr double kStall_s = 0.25;
constexpr double kMargin_s = 0.005;  // two blocks of 128 samples
constexpr double kLeastDelay_s = 0.030;
constexpr double kGrantedDelay_s = 0.080;  // covers lost frames
constexpr double kMostInterval_s = 0.050;  // that the delay covers
constexpr double kJitterQuantile = 0.99, kNeededQuantile = 0.995;
constexpr double kShrink = 0.005;  // s per s
constexpr double kSettleEvery_s = 0.05, kSettleLearnedEvery_s = 0.2;
constexpr double kLearned_s = 1;

constexpr double kGrowIn_s = 0.2, kShrinkIn_s = 0.5;
constexpr double kMostStretch = 0.25;
constexpr double kNearEnough_s = 1e-4, kNearEnoughSlope = 50e-6;

constexpr double kLeastCarry_s = 0.05;
constexpr double kIntervalFrames = 8;

double quantile(std::vector<double>& values, double share) {
  const auto at = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) + 0.5);
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(at);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

}  // namespace

PlayoutClock::PlayoutClock(const Options& options)
    : options_(options), delay_s_(options.fixed_delay_s.value_or(kStartDelay_s)) {}

void PlayoutClock::start_again() {
  placed_ = false;
  points_.clear();
  recent_.clear();
}

bool PlayoutClock::steady() const {
  return points_.back().arrived_s >= doubted_until_s_ && std::abs(line_.slope - 1) < kUnsteady;
}

double PlayoutClock::drift_ppm() const {
  return 1e6 * (1 / line_.slope - 1);
}

double PlayoutClock::carry_s() const {
  return std::max(kLeastCarry_s, 1.5 * interval_s_ * line_.slope);
}

PlayoutClock::Change PlayoutClock::frame(double time_s, double arrived_s) {
  if (!points_.empty()) arrived_s = std::max(arrived_s, points_.back().arrived_s);  // one that has waited for an earlier one
  const bool first = !placed_;
  if (first) newest_s_ = previous_s_ = time_s;
  const double step_s = time_s - newest_s_;
  if (step_s > 0) {
    // Follows a shorter interval at once, a longer one over frames: one that is missing is not an interval.
    interval_s_ = interval_s_ == 0 || step_s < interval_s_
                      ? step_s
                      : interval_s_ + (std::min(step_s, 2 * interval_s_) - interval_s_) / kIntervalFrames;
    previous_s_ = newest_s_;
    newest_s_ = time_s;
  }
  points_.push_back({time_s, std::min(previous_s_, time_s), arrived_s, arrived_s, false});
  recent_.emplace_back(time_s, arrived_s);
  if (recent_.size() > kRecent) recent_.pop_front();
  while (points_.size() > kWindowPoints || arrived_s - points_.front().arrived_s > kWindow_s) points_.pop_front();
  if (first) {
    line_.slope = 1;
    lay_line(1);
    return place(time_s);
  }
  if (watch(arrived_s - line_.at(time_s))) {
    const double off_s = line_.at(time_s) + delay_s_ - mapping_.position(time_s) / options_.rate_hz;
    if (std::abs(off_s) > kReplace_s) return place(time_s);
  } else {
    points_.back().stalled = stalled_;
    if (!stalled_) collect(time_s, arrived_s);
  }
  settle_delay(arrived_s);
  return step_s > 0 ? steer() : Change::kNone;
}

void PlayoutClock::ready(double ready_s) {
  if (!points_.empty()) points_.back().ready_s = std::max(points_.back().arrived_s, ready_s);
}

/// True where the frames have left the line, which is then laid anew.
bool PlayoutClock::watch(double late_s) {
  stalled_ = late_s > kStall_s || (stalled_ && late_s > delay_s_);
  const double bound_s = std::max(kOffLine_s, scatter_s_);
  if (std::abs(late_s) <= bound_s) {
    off_line_ = 0;
    return false;
  }
  const bool late = late_s > 0;
  if (late != off_late_) off_line_ = 0;
  off_late_ = late;
  off_line_ = std::min(off_line_ + 1, points_.size());
  const double for_s = points_.back().arrived_s - points_[points_.size() - off_line_].arrived_s;
  const bool stepped = late_s < -kStepAhead_s;
  const bool left = off_line_ >= kOffLinePoints && for_s >= (late ? kLateFor_s : kEarlyFor_s);
  if (!stepped && !left) return false;

  // After a step the frames before it say something only if they lie on one line with it: a simulator far ahead of real
  // time.
  std::size_t points = off_line_;
  std::optional<double> slope;
  if (stepped) {
    points = 1;
    slope = slope_of(recent_);
  } else {
    std::deque<std::pair<double, double>> off;
    for (auto p = points_.end() - static_cast<std::ptrdiff_t>(points); p != points_.end(); ++p)
      off.emplace_back(p->time_s, p->arrived_s);
    slope = slope_of(off);
  }
  if (!slope && std::abs(late_s) < kReplace_s) {
    // Not far, and no telling how fast: the points to come count more.
    for (double* sum : {&sums_.w, &sums_.t, &sums_.z, &sums_.tt, &sums_.tz}) *sum *= kDoubted;
    doubted_until_s_ = points_.back().arrived_s + kDoubt_s;
    off_line_ = 0;
    return false;
  }
  if (slope) line_.slope = *slope;
  lay_line(points);
  return true;
}

/// The least-squares slope of arrivals over times, where it is another than the line's.
std::optional<double> PlayoutClock::slope_of(const std::deque<std::pair<double, double>>& arrivals) const {
  if (arrivals.size() < kOffLinePoints) return std::nullopt;
  const auto n = static_cast<double>(arrivals.size());
  double mean_t = 0, mean_y = 0;
  for (const auto& [time_s, arrived_s] : arrivals) {
    mean_t += time_s / n;
    mean_y += arrived_s / n;
  }
  double tt = 0, ty = 0, yy = 0;
  for (const auto& [time_s, arrived_s] : arrivals) {
    const double t = time_s - mean_t, y = arrived_s - mean_y;
    tt += t * t;
    ty += t * y;
    yy += y * y;
  }
  if (tt <= 0) return std::nullopt;
  const double slope = ty / tt;
  const double rms_s = std::sqrt(std::max(0.0, yy - slope * ty) / n);
  if (rms_s > std::max(kOffLine_s, scatter_s_) || slope < kLeastSlope || slope > kMostSlope) return std::nullopt;
  const double uncertain = 4 * std::max(rms_s, 5e-4) / std::sqrt(tt);
  if (std::abs(slope - line_.slope) < std::max(kOtherSlope * line_.slope, uncertain)) return std::nullopt;
  return slope;
}

/// The line through the newest points with the slope it has; what came before them is forgotten.
void PlayoutClock::lay_line(std::size_t count) {
  points_.erase(points_.begin(), points_.end() - static_cast<std::ptrdiff_t>(count));
  for (Point& p : points_) p.stalled = false;
  points_.front().previous_s = points_.front().time_s;
  const Point newest = points_.back();
  scratch_.clear();
  for (const Point& p : points_)
    scratch_.push_back(p.arrived_s - newest.arrived_s - (p.time_s - newest.time_s) * line_.slope);
  line_.time_s = newest.time_s;
  line_.arrived_s = newest.arrived_s + quantile(scratch_, 0.1);
  anchor_ = line_;
  sums_ = {};
  bin_.clear();
  bin_began_s_ = line_laid_s_ = newest.arrived_s;
  last_bin_s_ = newest.time_s;
  off_line_ = 0;
  stalled_ = false;
}

void PlayoutClock::collect(double time_s, double arrived_s) {
  bin_.emplace_back(arrived_s - anchor_.at(time_s), time_s);
  if (arrived_s - bin_began_s_ < kBin_s || bin_.size() < kBinPoints) return;
  const auto decile = bin_.begin() + static_cast<std::ptrdiff_t>((bin_.size() - 1) / 10);
  std::nth_element(bin_.begin(), decile, bin_.end());
  const auto [z, t] = *decile;
  const double by = t - last_bin_s_;
  const double fade = std::exp(-(arrived_s - bin_began_s_) / (steady() ? kFade_s : kUnsteadyFade_s));
  sums_.tt = fade * (sums_.tt - 2 * by * sums_.t + by * by * sums_.w);
  sums_.tz = fade * (sums_.tz - by * sums_.z);
  sums_.t = fade * (sums_.t - by * sums_.w);
  sums_.z = fade * sums_.z + z;
  sums_.w = fade * sums_.w + 1;
  last_bin_s_ = t;
  bin_.clear();
  bin_began_s_ = arrived_s;
  fit();
}

void PlayoutClock::fit() {
  const double mean_t = sums_.t / sums_.w, mean_z = sums_.z / sums_.w;
  const double spread = sums_.tt - sums_.t * mean_t;
  const double covariance = sums_.tz - sums_.t * mean_z;
  // How far the slope may be from the anchor's, weighed against the points' scatter, unless they show beyond doubt that it
  // is.
  const double error_s = std::max(kBinScatter_s, scatter_s_ / 4);
  const bool shown = sums_.w > 3 && std::abs(covariance) > kSignificant * error_s * std::sqrt(spread);
  const double expected = steady() && !shown ? kSteadySlope : kUnsteadySlope;
  const double slope = covariance / (spread + std::pow(kBinScatter_s / expected, 2));
  line_.time_s = last_bin_s_;
  line_.arrived_s = anchor_.at(last_bin_s_) + mean_z - slope * mean_t;
  line_.slope = anchor_.slope + slope;
}

void PlayoutClock::settle_delay(double now_s) {
  if (now_s - delay_settled_s_ < (now_s - line_laid_s_ < kLearned_s ? kSettleEvery_s : kSettleLearnedEvery_s)) return;
  const double since_s = std::min(now_s - delay_settled_s_, 1.0);
  delay_settled_s_ = now_s;
  // Those that lie late by now have been held up, or have left the line: what comes next tells.
  const auto known = points_.end() - static_cast<std::ptrdiff_t>(off_late_ ? off_line_ : 0);
  const auto lateness = [&](auto&& late_s) {
    scratch_.clear();
    for (auto p = points_.begin(); p != known; ++p)
      if (!p->stalled) scratch_.push_back(late_s(*p));
  };
  scatter_s_ = std::max(scatter_of(points_.size()), scatter_of(std::min(points_.size(), kScatterPoints)));
  if (options_.fixed_delay_s) return;

  lateness([&](const Point& p) { return p.ready_s - line_.at(p.time_s); });
  if (scratch_.empty()) return;
  const double covered_s = std::min(interval_s_ * line_.slope, kMostInterval_s);
  const double jitter_s = std::max(0.0, quantile(scratch_, kJitterQuantile)) + covered_s + kMargin_s;
  lateness([&](const Point& p) { return p.ready_s - line_.at(p.previous_s); });
  const double needed_s = quantile(scratch_, kNeededQuantile) + kMargin_s;
  double wanted_s = std::clamp(needed_s, jitter_s, std::max(jitter_s, kGrantedDelay_s));
  wanted_s = std::max(wanted_s, now_s - line_laid_s_ < kLearned_s ? kStartDelay_s : kLeastDelay_s);
  delay_s_ = std::max(wanted_s, delay_s_ - kShrink * since_s);
}

/// Of the newest points, from the steps between neighbours: what the line does not matter to.
double PlayoutClock::scatter_of(std::size_t count) {
  scratch_.clear();
  for (std::size_t k = points_.size() - count + 1; k < points_.size(); ++k) {
    const Point &a = points_[k - 1], &b = points_[k];
    if (!a.stalled && !b.stalled)
      scratch_.push_back(std::abs(b.arrived_s - a.arrived_s - (b.time_s - a.time_s) * line_.slope));
  }
  return scratch_.empty() ? 0 : kScatterOfSteps * quantile(scratch_, 0.5);
}

PlayoutClock::Change PlayoutClock::place(double time_s) {
  placed_ = true;
  mapping_ = {time_s, static_cast<synthesis::SampleTime>(std::llround((line_.at(time_s) + delay_s_) * options_.rate_hz)),
              line_.slope * options_.rate_hz, delay_s_};
  return Change::kPlaced;
}

PlayoutClock::Change PlayoutClock::steer() {
  const double position = mapping_.position(previous_s_);
  const double slope = mapping_.samples_per_s / options_.rate_hz;
  const double behind_s = line_.at(previous_s_) + delay_s_ - position / options_.rate_hz;
  if (std::abs(behind_s) < kNearEnough_s && std::abs(slope / line_.slope - 1) < kNearEnoughSlope) return Change::kNone;
  const double within_s = std::max(behind_s > 0 ? kGrowIn_s : kShrinkIn_s, 2 * interval_s_ * line_.slope);
  const double stretch = std::clamp(behind_s / within_s, -kMostStretch, kMostStretch);
  // Through a whole sample of the map as it was, so that no rounding makes a step.
  const auto sample = static_cast<synthesis::SampleTime>(std::llround(position));
  mapping_ = {mapping_.time_s(static_cast<double>(sample)), sample, line_.slope * (1 + stretch) * options_.rate_hz,
              delay_s_};
  return Change::kAdjusted;
}

}  // namespace rustle::session
