#include "client_sdk/sheets/tearing_path.h"

#include <algorithm>
#include <cassert>
#include <limits>

#include "client_sdk/sheets/plane_noise.h"
#include "client_sdk/sheets/tearing_direction.h"

namespace rustle::sheets {
namespace {

constexpr double kLeastStress = 1e-3;
constexpr double kNewStep_cos = 0.94;  // the tear's direction has left the step's by 20°
constexpr double kThere = 1.5;         // texels from a step's goal

}  // namespace

TearPath::TearPath(const RectangleSize& size, Point2 start_m, const TearDetailOptions& options)
    : options_(options),
      columns_(std::max(3, static_cast<int>(std::round(size.width_m / options.texel_m)))),
      rows_(std::max(3, static_cast<int>(std::round(size.height_m / options.texel_m)))),
      texel_x_(size.width_m / columns_),
      texel_y_(size.height_m / rows_),
      width_m_(size.width_m),
      height_m_(size.height_m),
      passed_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), false) {
  const Point2 out = outward_at(size, start_m);
  Texel first = holding(start_m);
  // Beside a corner there is no room for a sheet on either side.
  if (out.x != 0) first.j = std::clamp(first.j, 2, rows_ - 3);
  if (out.y != 0) first.i = std::clamp(first.i, 2, columns_ - 3);
  const Point2 p = middle(first);
  points_.push_back({out.x > 0 ? size.width_m : out.x < 0 ? 0 : p.x, out.y > 0 ? size.height_m : out.y < 0 ? 0 : p.y});
  at_ = first;
}

TearPath::Texel TearPath::holding(Point2 p) const {
  return {std::clamp(static_cast<int>(std::floor(p.x / texel_x_)), 0, columns_ - 1),
          std::clamp(static_cast<int>(std::floor(p.y / texel_y_)), 0, rows_ - 1)};
}

bool TearPath::passed(Texel t) const {
  return t.i >= 0 && t.j >= 0 && t.i < columns_ && t.j < rows_ &&
         passed_[static_cast<std::size_t>(t.j) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(t.i)];
}

bool TearPath::beside_the_path(Texel t) const {
  for (const auto& [di, dj] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
    const Texel beside{t.i + di, t.j + dj};
    if (passed(beside) && !(beside == at_)) return true;
  }
  return false;
}

double TearPath::resistance(Texel t, const Step& step) const {
  const Point2 p = middle(t), line = step.goal - step.from;
  const double l2 = dot(line, line);
  const double share = l2 > 0 ? std::clamp(dot(p - step.from, line) / l2, 0.0, 1.0) : 0.0;
  const double away = length(p - (step.from + share * line)) / options_.stress_width_m;
  const double stress = std::max(kLeastStress, std::exp(-away * away / 2));
  const double fibres = perlin_noise(options_.seed, p.x / options_.fibre_m, p.y / options_.fibre_m);
  return (1 - options_.stress_share) * fibres + options_.stress_share / stress;
}

std::optional<TearPath::Texel> TearPath::next(const Step& step, bool to_border) const {
  const Point2 here = middle(at_), to_goal = step.goal - here;
  std::optional<Texel> best;
  double least = std::numeric_limits<double>::infinity();
  for (int dj = -1; dj <= 1; ++dj) {
    for (int di = -1; di <= 1; ++di) {
      const Texel t{at_.i + di, at_.j + dj};
      if ((di == 0 && dj == 0) || t.i < 0 || t.j < 0 || t.i >= columns_ || t.j >= rows_) continue;
      if ((!inner(t) && !to_border) || passed(t) || beside_the_path(t)) continue;
      const Point2 p = middle(t);
      if (dot(p - here, to_goal) <= 0 || length(step.goal - p) >= length(to_goal)) continue;
      const double nu = resistance(t, step);
      if (nu < least) least = nu, best = t;
    }
  }
  return best;
}

void TearPath::go_to(Texel t) {
  at_ = t;
  passed_[static_cast<std::size_t>(t.j) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(t.i)] = true;
  points_.push_back(middle(t));
}

void TearPath::follow(Point2 tip_m, Point2 ahead) {
  if (finished_) return;
  const double texel = std::max(texel_x_, texel_y_);
  const RectangleSize size{width_m_, height_m_};
  for (bool stuck = false;;) {
    const bool begun = points_.size() > 1;
    const Point2 here = begun ? middle(at_) : points_.front();
    const Point2 lag = tip_m - here;
    const bool turned_away = step_ && dot(direction_of(step_->goal - step_->from), ahead) < kNewStep_cos;
    if (!step_ || turned_away || stuck || length(step_->goal - here) < kThere * texel) {
      const double to_border_m = length(border_hit(size, tip_m, ahead) - tip_m);
      step_ = Step{here, tip_m + std::max(texel, std::min(options_.step_m, to_border_m - 2 * texel)) * ahead};
    }
    if (dot(lag, direction_of(step_->goal - step_->from)) < texel / 2) return;
    if (!begun) {
      go_to(at_);
      continue;
    }
    const auto t = next(*step_, false);
    if (!t && stuck) return;
    stuck = !t;
    if (t) go_to(*t);
  }
}

bool TearPath::finish(Point2 border_m) {
  const Point2 out = outward_at({width_m_, height_m_}, border_m);
  const TearPath before = *this;
  if (points_.size() == 1) go_to(at_);
  const auto on_edge = [&](Texel t) {
    return out.x > 0 ? t.i + 1 == columns_ : out.x < 0 ? t.i == 0 : out.y > 0 ? t.j + 1 == rows_ : t.j == 0;
  };
  Texel goal = holding(border_m);
  if (out.x != 0) goal.j = std::clamp(goal.j, 2, rows_ - 3);
  if (out.y != 0) goal.i = std::clamp(goal.i, 2, columns_ - 3);
  const Step step{middle(at_), middle(goal)};
  while (!on_edge(at_)) {
    const auto t = next(step, false);
    const auto last = t ? t : next(step, true);
    if (!last) {
      *this = before;
      return false;
    }
    go_to(*last);
  }
  const Point2 p = middle(at_);
  points_.push_back({out.x > 0 ? width_m_ : out.x < 0 ? 0 : p.x, out.y > 0 ? height_m_ : out.y < 0 ? 0 : p.y});
  finished_ = true;
  return true;
}

}  // namespace rustle::sheets
