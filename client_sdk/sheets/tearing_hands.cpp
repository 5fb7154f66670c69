#include "client_sdk/sheets/tearing_hands.h"

namespace rustle::sheets {

Grips usual_grips(const RectangleSize& size) {
  const double x = size.width_m / 2, y = size.height_m;
  const double apart = size.width_m / 5, below = size.height_m * 0.28;
  // Toward y = 0 the left is where x is greater.
  return {{{{x + apart, y - below}, {x + 0.6 * apart, y - 0.3 * below}},
           {{x - apart, y - below}, {x - 0.6 * apart, y - 0.3 * below}}}};
}

double TearPose::thumbs_angle_rad() const {
  const Point2 left = grips[kLeft].thumb_m - tip_m, right = grips[kRight].thumb_m - tip_m;
  return std::atan2(cross(right, left), dot(right, left));
}

double TearPose::strain() const {
  const double flat_m = length(grips[kLeft].thumb_m - grips[kRight].thumb_m);
  const double now_m = length(region(kLeft).at(grips[kLeft].thumb_m) - region(kRight).at(grips[kRight].thumb_m));
  return flat_m > 0 ? 1 - now_m / flat_m : 0;
}

}  // namespace rustle::sheets
