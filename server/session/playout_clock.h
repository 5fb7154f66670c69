#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "server/engine/time_mapping.h"

namespace rustle::session {

/// When the frames of a live sender are heard: simulation time onto the sample axis, from when frames arrive.
///
/// Two estimates, then one map that follows them.
///   line     arrived_s = offset + slope · time_s of a frame that waited for nothing. Every quarter of a second gives one
///            point, its low decile of arrivals; slope and offset are their least-squares line, older points fading over
///            minutes. The slope is held near what it was by a prior of 300 ppm, so that jitter is not taken for drift,
///            until the points show it beyond doubt. A simulator that runs more than 1 % off real time keeps no clock, as a
///            rule: its points fade over seconds.
///   delay    so much later a frame is heard: of the last ten seconds the 99th percentile of how late cues were ready, an
///            interval between frames, for a frame tells what happened since the one before, and a margin of 5 ms. A frame
///            lost on the way makes its successor need two intervals: that is granted as far as the delay stays within
///            80 ms. Grows at once, shrinks by 5 ms a second. Or fixed.
///   map      sample(time_s) = (line(time_s) + delay) · rate, reached along a continuous, increasing, piecewise linear
///            function: it runs up to 25 % slow or fast to get there, never in steps.
///
/// Frames that all lie off the line have left it: for a quarter of a second behind it (the sender paused, or runs slower),
/// for a tenth before it (it runs faster), or once by more than a quarter of a second before it (its time stepped forward).
/// Then the line is laid anew through them, with the slope they show if that differs from the old one beyond their scatter,
/// and where the map would be off by more than 50 ms it is placed anew: the one discontinuity. What comes late by more than
/// a quarter of a second and is followed by frames in step was a stall: it says nothing about jitter.
///
/// Pure: times come from outside, the same calls give the same maps bit for bit. One thread at a time.
class PlayoutClock {
 public:
  struct Options {
    double rate_hz = 48000;
    std::optional<double> fixed_delay_s;  ///< absent: adaptive
  };
  enum class Change : std::uint8_t {
    kNone,
    kAdjusted,  ///< continues where the map before it was
    kPlaced,    ///< begins, or begins anew
  };

  static constexpr double kStartDelay_s = 0.040;

  explicit PlayoutClock(const Options& options);

  /// A frame at simulation time `time_s` came at `arrived_s` on the audio clock, in seconds since its sample 0. Finite;
  /// `arrived_s` does not decrease. From now on mapping() is for this frame and what follows it.
  Change frame(double time_s, double arrived_s);
  /// The cues of the newest frame were ready at `ready_s`, from arrived_s on.
  void ready(double ready_s);
  /// The sender's time has begun anew: the next frame is placed like the first.
  void start_again();

  bool placed() const { return placed_; }
  const engine::TimeMapping& mapping() const { return mapping_; }  ///< \pre placed()
  double newest_s() const { return newest_s_; }                    ///< time of the newest frame
  double delay_s() const { return delay_s_; }
  /// How much faster simulation time runs than the audio clock, in parts per million; a simulator at half speed: -500,000.
  double drift_ppm() const;
  /// How long after the newest frame's time sound goes on as it was before news is missed: one and a half frames, at least
  /// 50 ms.
  double carry_s() const;

 private:
  struct Point {
    double time_s, previous_s;  ///< of the frame, of the one before
    double arrived_s, ready_s;
    bool stalled;
  };
  struct Line {
    double time_s = 0, arrived_s = 0, slope = 1;
    double at(double t) const { return arrived_s + (t - time_s) * slope; }
  };
  /// Weighted sums of the decile points since the line was last laid, relative to the newest of them.
  struct Sums {
    double w = 0, t = 0, z = 0, tt = 0, tz = 0;
  };

  void lay_line(std::size_t points);
  std::optional<double> slope_of(const std::deque<std::pair<double, double>>& arrivals) const;
  bool watch(double late_s);
  void collect(double time_s, double arrived_s);
  void fit();
  bool steady() const;  ///< simulation time is about real time
  void settle_delay(double now_s);
  double scatter_of(std::size_t points);
  Change steer();
  Change place(double time_s);

  const Options options_;
  bool placed_ = false;
  engine::TimeMapping mapping_;
  double delay_s_;

  std::deque<Point> points_;                      ///< of the last ten seconds, on the line as it is
  std::deque<std::pair<double, double>> recent_;  ///< times and arrivals of the newest frames, whatever the line
  double newest_s_ = 0, previous_s_ = 0, interval_s_ = 0;
  double scatter_s_ = 0;      ///< of the points' lateness, between its first and last decile
  std::size_t off_line_ = 0;  ///< the newest so many points lie off the line ...
  bool off_late_ = false;     ///< ... on this side
  bool stalled_ = false;

  Line anchor_;  ///< as it was last laid: residuals are relative to it
  Line line_;
  Sums sums_;
  double bin_began_s_ = 0, last_bin_s_ = 0;
  double doubted_until_s_ = 0;                  ///< the line has been left, but not by much
  std::vector<std::pair<double, double>> bin_;  ///< residual, time_s

  double delay_settled_s_ = 0, line_laid_s_ = 0;
  std::vector<double> scratch_;
};

}  // namespace rustle::session
