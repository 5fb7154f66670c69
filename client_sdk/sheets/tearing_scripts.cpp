#include "client_sdk/sheets/tearing_scripts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "client_sdk/sheets/tearing_direction.h"

namespace rustle::sheets {
namespace {

constexpr double kMostStep_s = 1.0 / 240;
constexpr double kBeforeBorder_m = 0.002;  // the thumbs go no farther
constexpr double kLeastApart_m = 0.024;    // of the thumbs
constexpr double kKeptOpen_rad = 0.12;     // while the hands grip farther on
constexpr double kFollowed = 12;           // thumbs grip farther on by so many times the way still to go, a second

/// What the hands do from `from_s` to `to_s`.
struct Stroke {
  double from_s, to_s;
  double left_rad = 0, right_rad = 0;  ///< turned in all, by smooth steps
  double apart_m = 0;                  ///< moved apart in all, at an even pace between soft ends
  bool grips = false;                  ///< the fingers let go and grip as far from the tip as at first
};

double part_between(const Stroke& stroke, double from_s, double to_s) {
  const double length_s = stroke.to_s - stroke.from_s;
  return smooth_step((to_s - stroke.from_s) / length_s) - smooth_step((from_s - stroke.from_s) / length_s);
}

class Strokes : public TearScript {
 public:
  Strokes(std::vector<Stroke> strokes, double duration_s) : strokes_(std::move(strokes)), duration_s_(duration_s) {}

  double duration_s() const override { return duration_s_; }

  HandMotions motions(const TearingSheet& sheet, double time_s, double dt_s) override {
    HandMotions motions;
    const TearPose& pose = sheet.pose();
    if (!begun_) {
      thumbs_from_tip_ = thumbs_from_tip(pose);
      begun_ = true;
    }
    if (sheet.separated()) {
      if (!apart_from_s_) apart_from_s_ = time_s;
      draw_apart(pose, time_s, dt_s, motions);
      return motions;
    }
    const Point2 across =
        direction_of(pose.region(kRight).at(pose.grips[kRight].thumb_m) - pose.region(kLeft).at(pose.grips[kLeft].thumb_m));
    for (const Stroke& stroke : strokes_) {
      const double part = part_between(stroke, time_s, time_s + dt_s);
      motions[kLeft].rotation_rad += part * stroke.left_rad;
      motions[kRight].rotation_rad += part * stroke.right_rad;
      motions[kLeft].translation_m = motions[kLeft].translation_m - (part * stroke.apart_m / 2) * across;
      motions[kRight].translation_m = motions[kRight].translation_m + (part * stroke.apart_m / 2) * across;
      if (!stroke.grips || time_s < stroke.from_s || time_s >= stroke.to_s) continue;
      motions = grip_farther_on(sheet, thumbs_from_tip_, std::min(1.0, dt_s / std::max(dt_s, stroke.to_s - time_s)));
    }
    const bool pulls = std::any_of(strokes_.begin(), strokes_.end(), [&](const Stroke& stroke) {
      return stroke.apart_m != 0 && time_s >= stroke.from_s && time_s < stroke.to_s;
    });
    if (!pulls) return motions;
    const HandMotions on = grip_farther_on(sheet, thumbs_from_tip_, std::min(1.0, kFollowed * dt_s));
    for (const auto side : {kLeft, kRight}) motions[side].slide_m = on[side].slide_m;
    return motions;
  }

 private:
  void draw_apart(const TearPose& pose, double time_s, double dt_s, HandMotions& motions) const {
    constexpr double kFor_s = 0.8, kBy_m = 0.03;
    const Stroke away{*apart_from_s_ + 0.1, *apart_from_s_ + 0.1 + kFor_s};
    const double part = part_between(away, time_s, time_s + dt_s);
    for (const auto side : {kLeft, kRight}) {
      const double out = side == kLeft ? 1 : -1;
      motions[side].translation_m = turned({out * part * kBy_m, 0}, pose.angle_rad[side] / 2);
    }
  }

  std::vector<Stroke> strokes_;
  double duration_s_;
  bool begun_ = false;
  std::array<Point2, 2> thumbs_from_tip_;
  std::optional<double> apart_from_s_;
};

/// Strokes of the same kind one after another, the fingers gripping anew between them.
std::vector<Stroke> repeated(int count, double from_s, double stroke_s, double grip_s, double left_rad, double right_rad) {
  std::vector<Stroke> strokes;
  for (int k = 0; k < count; ++k) {
    const double begin_s = from_s + k * (stroke_s + grip_s);
    strokes.push_back({begin_s, begin_s + stroke_s, left_rad, right_rad, 0, false});
    strokes.push_back({begin_s + stroke_s, begin_s + stroke_s + grip_s, 0, 0, 0, true});
  }
  return strokes;
}

constexpr double kTurn_rad = 0.32;

std::unique_ptr<TearScript> slow() {
  return std::make_unique<Strokes>(repeated(6, 0.3, 1.1, 0.35, kTurn_rad, kTurn_rad), 9.0);
}

std::unique_ptr<TearScript> fast() {
  return std::make_unique<Strokes>(repeated(6, 0.3, 0.3, 0.2, kTurn_rad, kTurn_rad), 4.0);
}

std::unique_ptr<TearScript> one_handed() {
  return std::make_unique<Strokes>(repeated(12, 0.3, 0.5, 0.25, 0, 1.1 * kTurn_rad), 10.5);
}

std::unique_ptr<TearScript> curved() {
  auto strokes = repeated(3, 0.3, 0.8, 0.3, 1.7 * kTurn_rad, 0.3 * kTurn_rad);
  const auto back = repeated(5, 0.3 + 3 * 1.1, 0.8, 0.3, 0.3 * kTurn_rad, 1.7 * kTurn_rad);
  strokes.insert(strokes.end(), back.begin(), back.end());
  return std::make_unique<Strokes>(std::move(strokes), 10.0);
}

std::unique_ptr<TearScript> pulled() {
  return std::make_unique<Strokes>(
      std::vector<Stroke>{{0.3, 0.8, 0.9 * kTurn_rad, 0.9 * kTurn_rad, 0, false}, {0.9, 2.1, 0, 0, 0.25, false}}, 3.2);
}

std::unique_ptr<TearScript> steady() {
  return std::make_unique<Strokes>(
      std::vector<Stroke>{{0, 0.5, 0.8 * kTurn_rad, 0.8 * kTurn_rad, 0, false}, {0.3, 4.3, 0, 0, 0.22, false}}, 4.5);
}

std::unique_ptr<TearScript> torn() {
  auto strokes = repeated(2, 0.3, 1.0, 0.35, 0.8 * kTurn_rad, kTurn_rad);
  const auto faster = repeated(2, 3.1, 0.35, 0.3, kTurn_rad, 0.8 * kTurn_rad);
  strokes.insert(strokes.end(), faster.begin(), faster.end());
  strokes.push_back({4.5, 4.7, 0.9 * kTurn_rad, 0.9 * kTurn_rad, 0, false});
  strokes.push_back({4.7, 5.2, 0, 0, 0.2, false});
  return std::make_unique<Strokes>(std::move(strokes), 6.4);
}

constexpr std::array<std::string_view, 7> kScriptNames = {"slow",   "fast",   "one_handed", "curved",
                                                          "pulled", "steady", "torn"};

class TearStream : public SheetStream {
 public:
  TearStream(TearingSheet sheet, std::unique_ptr<TearScript> script)
      : sheet_(std::move(sheet)), script_(std::move(script)) {}

  double duration_s() const override { return script_->duration_s(); }
  bool on_table() const override { return true; }
  const StreamedFrame& frame(double time_s) override {
    frame_.fresh = !frame_.mesh;
    const double way_s = time_s - time_s_;
    const auto steps = static_cast<int>(std::ceil(way_s / kMostStep_s - 1e-6));
    double torn_m = 0;
    for (int k = 0; k < steps; ++k) {
      const double dt_s = way_s / steps;
      if (const auto step = sheet_.advance(script_->motions(sheet_, time_s_ + k * dt_s, dt_s), dt_s)) torn_m += step->torn_m;
    }
    time_s_ = std::max(time_s_, time_s);
    frame_.mesh = sheet_.mesh();
    const std::size_t vertices = frame_.mesh->material_coordinates.size();
    frame_.xyz_m.resize(3 * vertices);
    frame_.anchored.resize(vertices);
    sheet_.positions(frame_.xyz_m);
    sheet_.anchored(frame_.anchored);
    frame_.tear_tips.clear();
    if (auto tip = sheet_.tip()) {
      if (way_s > 0) tip->speed_m_per_s = torn_m / way_s;  // over the whole frame
      frame_.tear_tips.push_back(*tip);
    }
    return frame_;
  }

 private:
  TearingSheet sheet_;
  std::unique_ptr<TearScript> script_;
  StreamedFrame frame_;
  double time_s_ = 0;
};

}  // namespace

std::array<Point2, 2> thumbs_from_tip(const TearPose& pose) {
  return {pose.grips[kLeft].thumb_m - pose.tip_m, pose.grips[kRight].thumb_m - pose.tip_m};
}

HandMotions grip_farther_on(const TearingSheet& sheet, const std::array<Point2, 2>& from_tip_m, double share) {
  const auto& size = sheet.size();
  const TearPose& pose = sheet.pose();
  const Point2 ahead = direction_of(from_tip_m[kLeft] + from_tip_m[kRight]);
  const double room_m = length(border_hit(size, pose.tip_m, ahead) - pose.tip_m) - kBeforeBorder_m;
  const double narrowest = kLeastApart_m / length(from_tip_m[kLeft] - from_tip_m[kRight]);
  HandMotions motions;
  for (const auto side : {kLeft, kRight}) {
    const double ahead_m = dot(from_tip_m[side], ahead);
    const double closer = std::clamp(room_m / ahead_m, 0.0, 1.0);
    const Point2 across = from_tip_m[side] - ahead_m * ahead;
    const Point2 wanted = pose.tip_m + std::max(closer, std::min(1.0, narrowest)) * across + closer * ahead_m * ahead;
    const Point2 on_sheet = {std::clamp(wanted.x, kBeforeBorder_m, size.width_m - kBeforeBorder_m),
                             std::clamp(wanted.y, kBeforeBorder_m, size.height_m - kBeforeBorder_m)};
    motions[side].slide_m = share * (on_sheet - pose.grips[side].thumb_m);
    motions[side].rotation_rad = -share * std::max(0.0, pose.opening_rad() - kKeptOpen_rad) / 2;
  }
  return motions;
}

std::span<const std::string_view> tear_script_names() {
  return kScriptNames;
}

std::unique_ptr<TearScript> make_tear_script(std::string_view name) {
  const std::array<std::unique_ptr<TearScript> (*)(), kScriptNames.size()> makers = {slow,   fast,   one_handed, curved,
                                                                                     pulled, steady, torn};
  for (std::size_t k = 0; k < kScriptNames.size(); ++k) {
    if (kScriptNames[k] == name) return makers[k]();
  }
  return nullptr;
}

std::unique_ptr<SheetStream> make_tear(std::string_view script, const TearingOptions& options) {
  auto made = make_tear_script(script);
  if (!made) return nullptr;
  auto sheet = TearingSheet::make(options);
  if (!sheet) return nullptr;
  return std::make_unique<TearStream>(std::move(*sheet), std::move(made));
}

}  // namespace rustle::sheets
