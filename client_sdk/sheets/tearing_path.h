#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "client_sdk/sheets/tearing_hands.h"

namespace rustle::sheets {

/// How rough a tear is (paper tearing 2015, section 4.2).
struct TearDetailOptions {
  double texel_m = 0.001;          ///< the path's resolution
  double stress_share = 0.3;       ///< p: 0: fibres alone lead the path, 1: the hands' stress alone
  double fibre_m = 0.004;          ///< size of the fibres' flocs: of the Perlin noise
  double stress_width_m = 0.0012;  ///< standard deviation of the Gaussian across a step
  double step_m = 0.012;           ///< from s_{i-1} to s_i, whatever the frame rate
  std::uint64_t seed = 0;
};

/// The path of a tear from texel to texel.
///
/// Where it goes next from a texel: of the eight neighbours within 90° of the step's goal s_i that come nearer to it, the
/// one with the greatest breaking coefficient 1/ν,
///   ν_i(x, y) = (1 - p) P(x, y) + p / G_i(x, y)                                          (eq. 2)
/// P the Perlin noise, the fibres' resistance, and G_i the Gaussian about the line from s_{i-1} to s_i, the hands' stress;
/// taken as the coefficient itself, ν would lead away from the stress. A texel beside one that the path has passed is no
/// neighbour, so that what is torn stays a texel wide.
///
/// Texels fill the sheet; the path keeps off the outermost ones but where it begins and ends.
class TearPath {
 public:
  /// \pre start_m on the border, options.texel_m at most a tenth of either side
  TearPath(const RectangleSize& size, Point2 start_m, const TearDetailOptions& options);

  /// Follows the tip, which moves to `tip_m`. `ahead`: the tear's direction, unit length.
  void follow(Point2 tip_m, Point2 ahead);
  /// Goes on to the border near `border_m` and ends there. False: it found no way; the path is as it was.
  bool finish(Point2 border_m);

  /// [0] lies on the border, as does the last one once it is finished. Others are at least a texel apart.
  std::span<const Point2> points_m() const { return points_; }
  bool finished() const { return finished_; }
  /// The start, moved along the border to where a texel's middle is.
  Point2 start_m() const { return points_.front(); }
  Point2 texel_m() const { return {texel_x_, texel_y_}; }

 private:
  struct Texel {
    int i = 0, j = 0;
    friend bool operator==(Texel, Texel) = default;
  };
  struct Step {
    Point2 from, goal;
  };

  Point2 middle(Texel t) const { return {(t.i + 0.5) * texel_x_, (t.j + 0.5) * texel_y_}; }
  Texel holding(Point2 p) const;
  bool inner(Texel t) const { return t.i > 0 && t.j > 0 && t.i + 1 < columns_ && t.j + 1 < rows_; }
  bool passed(Texel t) const;
  bool beside_the_path(Texel t) const;
  double resistance(Texel t, const Step& step) const;
  std::optional<Texel> next(const Step& step, bool to_border) const;
  void go_to(Texel t);

  TearDetailOptions options_;
  int columns_ = 0, rows_ = 0;
  double texel_x_ = 0, texel_y_ = 0, width_m_ = 0, height_m_ = 0;
  std::vector<Point2> points_;
  std::vector<bool> passed_;  ///< [rows x columns]
  Texel at_;
  std::optional<Step> step_;
  bool finished_ = false;
};

}  // namespace rustle::sheets
