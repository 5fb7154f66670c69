#include "sound_db/generate/cloth_motion.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace rustle::generate {

namespace {

using std::numbers::pi;

ClothMotion at_rest(double seconds) {
  ClothMotion motion;
  const auto steps = static_cast<std::size_t>(seconds / motion.step_s);
  motion.speed_m_per_s.assign(steps, 0.0);
  motion.crumpling.assign(steps, 0.0);
  return motion;
}

/// One movement: what it adds to speed and crumpling at x in [0, 1] of its time.
struct Movement {
  enum Kind { kStroke, kBackAndForth, kShake, kRest } kind = kRest;
  double peak_m_per_s = 0;
  double crumpling = 0;
  double beats = 1;

  double speed(double x) const {
    switch (kind) {
      case kStroke:
        return peak_m_per_s * 16 * x * x * (1 - x) * (1 - x);
      case kBackAndForth:
        return peak_m_per_s * std::abs(std::sin(pi * x * beats)) * std::sqrt(std::sin(pi * x));
      case kShake:
        return 0.3 * peak_m_per_s * std::abs(std::sin(pi * x * beats));
      case kRest:
        break;
    }
    return 0;
  }
  double crumpled(double x) const {
    switch (kind) {
      case kStroke:
        return 0.25 * crumpling * x * x;
      case kBackAndForth:
        return 0.10 * crumpling;
      case kShake:
        return (0.1 + 0.9 * crumpling) * std::pow(std::abs(std::sin(pi * x * beats)), 3);
      case kRest:
        break;
    }
    return 0;
  }
};

Movement drawn(dsp::Random& random, double fastest_m_per_s) {
  const double u = random.uniform();
  Movement m;
  m.kind = u < 0.40 ? Movement::kStroke : u < 0.60 ? Movement::kBackAndForth : u < 0.85 ? Movement::kShake : Movement::kRest;
  m.peak_m_per_s = random.log_uniform(0.04, fastest_m_per_s);
  m.crumpling = random.uniform();
  m.beats = m.kind == Movement::kShake ? 2 + random.index(5) : 2 + random.index(4);
  return m;
}

}  // namespace

double ClothMotion::speed_at(double time_s) const {
  const double at = std::clamp(time_s / step_s, 0.0, static_cast<double>(speed_m_per_s.size() - 1));
  const auto before = static_cast<std::size_t>(at);
  const std::size_t after = std::min(before + 1, speed_m_per_s.size() - 1);
  const double part = at - static_cast<double>(before);
  return (1 - part) * speed_m_per_s[before] + part * speed_m_per_s[after];
}

ClothMotion varied_motion(double seconds, dsp::Random random, double fastest_m_per_s) {
  ClothMotion motion = at_rest(seconds);
  constexpr double kStart_s = 0.3;
  for (double t = kStart_s; t < seconds - kStart_s;) {
    const Movement movement = drawn(random, fastest_m_per_s);
    const double length_s = random.uniform(0.3, 1.5);
    const auto first = static_cast<std::size_t>(t / motion.step_s);
    const auto steps = static_cast<std::size_t>(length_s / motion.step_s);
    for (std::size_t i = 0; i < steps && first + i < motion.speed_m_per_s.size(); ++i) {
      const double x = (static_cast<double>(i) + 0.5) / static_cast<double>(steps);
      motion.speed_m_per_s[first + i] += movement.speed(x);
      motion.crumpling[first + i] += movement.crumpled(x);
    }
    t += length_s - 0.10 * std::log(1 - random.uniform());
  }
  return motion;
}

ClothMotion roller_motion(double seconds, double fastest_m_per_s, double slowest_m_per_s) {
  ClothMotion motion = at_rest(seconds);
  const auto steps = static_cast<double>(motion.speed_m_per_s.size());
  for (std::size_t i = 0; i < motion.speed_m_per_s.size(); ++i) {
    motion.speed_m_per_s[i] = fastest_m_per_s * std::pow(slowest_m_per_s / fastest_m_per_s, static_cast<double>(i) / steps);
  }
  return motion;
}

ClothMotion steady_motion(double seconds, double speed_m_per_s) {
  ClothMotion motion = at_rest(seconds);
  std::fill(motion.speed_m_per_s.begin(), motion.speed_m_per_s.end(), speed_m_per_s);
  return motion;
}

}  // namespace rustle::generate
