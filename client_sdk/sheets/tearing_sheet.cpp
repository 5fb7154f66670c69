#include "client_sdk/sheets/tearing_sheet.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>
#include <utility>

#include "client_sdk/sheets/plane_noise.h"
#include "client_sdk/sheets/tearing_direction.h"

namespace rustle::sheets {
namespace {

constexpr double kTexelsPerEdge = 10;
constexpr double kFinest_m = 0.0008, kCoarsest_m = 0.004;
constexpr double kFibreTexels = 4, kStressTexels = 1.3, kStepTexels = 14;
constexpr double kMostStrain = 0.45;
constexpr double kNarrowest_rad = 0.3, kWidest_rad = 2.9;  // angle between the thumbs
constexpr double kLeastLeft_rad = 0.09;                    // of that angle, while the hands turn
constexpr double kLeastToThumb_m = 0.005, kLeastThumbs_m = 0.02;
constexpr double kBridge_m = 0.007;  // what gives way at once
constexpr double kLiesDown_s = 0.12;
constexpr double kFinger_m = 0.012;
constexpr double kAround = 10;  // sides of the sheet: far beyond it
constexpr int kHalvings = 8;
constexpr double kStep_rad = 0.02, kStep_m = 0.001, kMostPieces = 1000;
constexpr std::int64_t kBeginning = 0x7ea4;

bool finite(const HandMotion& m) {
  return std::isfinite(m.rotation_rad) && std::isfinite(m.translation_m.x) && std::isfinite(m.translation_m.y) &&
         std::isfinite(m.slide_m.x) && std::isfinite(m.slide_m.y);
}

bool on_sheet(const RectangleSize& size, Point2 p) {
  return p.x >= 0 && p.x <= size.width_m && p.y >= 0 && p.y <= size.height_m;
}

/// Steps so small that the order of turning and tearing does not matter.
int pieces_of(const HandMotions& motions) {
  double most = 1;
  for (const HandMotion& m : motions) {
    most = std::max(
        {most, std::abs(m.rotation_rad) / kStep_rad, length(m.translation_m) / kStep_m, length(m.slide_m) / kStep_m});
  }
  return static_cast<int>(std::ceil(std::min(most, kMostPieces)));
}

HandMotion part(const HandMotion& m, double share) {
  return {share * m.rotation_rad, share * m.translation_m, share * m.slide_m};
}

TearDetailOptions detail(const TearingOptions& options, double texel_m) {
  return {texel_m,     options.stress_share, kFibreTexels * texel_m, kStressTexels * texel_m, kStepTexels * texel_m,
          options.seed};
}

SheetMesh flat_mesh(const TearingOptions& options) {
  return make_rectangle(MeshKind::kDelaunay, options.size.width_m, options.size.height_m, options.triangles, options.seed);
}

TearPose first_pose(const TearingOptions& options, const Grips& grips, Point2 start_m) {
  return {grips, start_m, start_m - Point2{options.size.width_m / 2, options.size.height_m / 2}, {0, 0}};
}

Point2 ahead_of(const TearPose& pose) {
  return direction_of(direction_of(pose.grips[kLeft].thumb_m - pose.tip_m) +
                      direction_of(pose.grips[kRight].thumb_m - pose.tip_m));
}

/// Whether p lies inside a closed polygon, by the parity of its crossings.
bool inside(std::span<const Point2> outline, Point2 p) {
  bool in = false;
  for (std::size_t k = 0, last = outline.size() - 1; k < outline.size(); last = k++) {
    const Point2 a = outline[k], b = outline[last];
    if ((a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y)) in = !in;
  }
  return in;
}

/// Whether hands can hold a sheet so.
bool possible(const RectangleSize& size, const TearPose& pose) {
  const double between = pose.thumbs_angle_rad(), opening = pose.opening_rad();
  for (const Grip& grip : pose.grips) {
    if (!on_sheet(size, grip.thumb_m) || length(grip.thumb_m - pose.tip_m) < kLeastToThumb_m) return false;
  }
  return length(pose.grips[kLeft].thumb_m - pose.grips[kRight].thumb_m) >= kLeastThumbs_m && between >= kNarrowest_rad &&
         between <= kWidest_rad && opening >= 0 && opening <= between - kLeastLeft_rad && pose.strain() <= kMostStrain;
}

}  // namespace

double cone_roundness(std::string_view material) {
  if (material == "tracing-paper") return 0.9;
  if (material == "banknote") return 1.15;
  return 1;
}

tl::expected<TearingSheet, std::string> TearingSheet::make(const TearingOptions& options) {
  const auto wrong = [](std::string what) { return tl::unexpected(std::move(what)); };
  const auto& size = options.size;
  const double shorter = std::min(size.width_m, size.height_m), longer = std::max(size.width_m, size.height_m);
  const bool sized = std::isfinite(size.width_m) && std::isfinite(size.height_m) && shorter >= 0.02 && longer <= 10;
  if (!sized) return wrong("size: sides of 0.02 to 10 m can be torn");
  if (options.triangles < 50 || options.triangles > 100'000) return wrong("triangles: take 50 to 100,000");
  if (!(options.stress_share >= 0 && options.stress_share <= 1)) return wrong("stress_share: take 0 to 1");
  if (!(options.torn_m_per_rad > 0 && options.torn_m_per_rad <= 10))
    return wrong("torn_m_per_rad: take what is above 0 and at most 10 m");
  const double edge_m = std::sqrt(2 * size.width_m * size.height_m / static_cast<double>(options.triangles));
  const double texel_m =
      options.texel_m.value_or(std::min(std::clamp(edge_m / kTexelsPerEdge, kFinest_m, kCoarsest_m), shorter / 20));
  if (!(texel_m >= 1e-4 && texel_m <= shorter / 10))
    return wrong("texel_m: take 0.1 mm to a tenth of the sheet's shorter side");
  const Grips grips = options.grips.value_or(usual_grips(size));
  for (const Grip& grip : grips) {
    if (!on_sheet(size, grip.thumb_m) || !on_sheet(size, grip.index_m)) return wrong("grips: put all fingers on the sheet");
    if (length(grip.thumb_m - grip.index_m) < 1e-3)
      return wrong("grips: put thumb and index of a hand 1 mm apart at least: the ray between them says where it tears");
  }
  TearPath path(size, tear_start(size, grips, hashed_unit(options.seed, kBeginning, 0)), detail(options, texel_m));
  const TearPose pose = first_pose(options, grips, path.start_m());
  if (!possible(size, pose))
    return wrong(
        "grips: put the thumbs 2 cm apart and 5 mm from the tear's beginning at least, the left hand's to the left "
        "of one who goes along with the tear, and not so wide that the tear begins between them");
  return TearingSheet(options, std::move(path), pose);
}

TearingSheet::TearingSheet(const TearingOptions& options, TearPath path, const TearPose& pose)
    : options_(options),
      pose_(pose),
      path_(std::move(path)),
      torn_(flat_mesh(options), options.size, std::max(path_.texel_m().x, path_.texel_m().y), options.seed),
      cone_(pose_, cone_roundness(options.material)),
      ahead_(ahead_of(pose_)) {
  torn_.cut(path_.points_m(), false);
  mesh_ = std::make_shared<const SheetMesh>(torn_.mesh());
}

TearingSheet::Planned TearingSheet::plan(const HandMotions& motions, double share) const {
  HandMotions scaled{part(motions[kLeft], share), part(motions[kRight], share)};
  Planned out{pose_, {}, false};
  TearPose& pose = out.pose;
  for (const auto side : {kLeft, kRight}) {
    pose.grips[side].thumb_m = pose.grips[side].thumb_m + scaled[side].slide_m;
    pose.grips[side].index_m = pose.grips[side].index_m + scaled[side].slide_m;
  }
  out.advance_m = rotation_advance(pose, scaled, options_.torn_m_per_rad) + translation_advance(pose, scaled);
  // Lips that meet stop the hands.
  const double turn = scaled[kLeft].rotation_rad + scaled[kRight].rotation_rad;
  const double closing = turn < 0 ? std::min(1.0, pose.opening_rad() / -turn) : 1.0;
  pose.angle_rad[kLeft] -= closing * scaled[kLeft].rotation_rad;
  pose.angle_rad[kRight] += closing * scaled[kRight].rotation_rad;
  if (pose.opening_rad() < 0) pose.angle_rad[kRight] = pose.angle_rad[kLeft];

  const double way_m = length(out.advance_m);
  if (way_m > 0) {
    const Point2 along = (1 / way_m) * out.advance_m;
    const Point2 hit = border_hit(options_.size, pose.tip_m, along);
    // Where it has just begun, the border behind it is no goal.
    const double left_m = length(hit - pose.tip_m);
    if (left_m - way_m <= kBridge_m && torn_m_ + way_m > 4 * kBridge_m) {
      out.through = true;
      out.advance_m = hit - pose.tip_m;
    } else if (left_m <= way_m) {
      out.advance_m = {};
    }
  }
  const Point2 mean_m = 0.5 * (scaled[kLeft].translation_m + scaled[kRight].translation_m);
  pose.placed_tip_m = pose.placed_tip_m + mean_m +
                      0.5 * (turned(out.advance_m, pose.angle_rad[kLeft]) + turned(out.advance_m, pose.angle_rad[kRight]));
  pose.tip_m = pose.tip_m + out.advance_m;
  return out;
}

tl::expected<TearAdvance, std::string> TearingSheet::advance(const HandMotions& motions, double dt_s) {
  if (!finite(motions[kLeft]) || !finite(motions[kRight]))
    return tl::unexpected(std::string("motions: take finite numbers"));
  if (!(dt_s > 0) || !std::isfinite(dt_s)) return tl::unexpected(std::string("dt_s: take a time above 0"));
  TearAdvance result;
  if (separated_) {
    move_pieces(motions, dt_s);
    result.separated = true;
    return result;
  }
  const auto points = path_.points_m().size();
  const int pieces = pieces_of(motions);
  const double each = 1.0 / pieces;
  result.share = 0;
  for (int k = 0; k < pieces; ++k) {
    if (separated_) {
      result.share += each;
      continue;
    }
    HandMotions piece{part(motions[kLeft], each), part(motions[kRight], each)};
    const double share = possible_share(piece);
    result.torn_m += follow(plan(piece, share));
    result.share += share * each;
    if (share == 1 || separated_) continue;
    // What the sheet holds back, the fingers do not: they grip farther on all the same.
    for (HandMotion& hand : piece) hand = {0, {}, (1 - share) * hand.slide_m};
    follow(plan(piece, possible_share(piece)));
  }
  result.share = std::min(1.0, result.share);
  result.separated = separated_;
  speed_m_per_s_ = separated_ ? 0 : result.torn_m / dt_s;
  torn_m_ += result.torn_m;
  if (!separated_) cone_ = TearCone(pose_, cone_roundness(options_.material));
  result.mesh_changed = path_.points_m().size() != points;
  if (result.mesh_changed) {
    torn_.cut(path_.points_m(), separated_);
    mesh_ = std::make_shared<const SheetMesh>(torn_.mesh());
  }
  return result;
}

double TearingSheet::possible_share(const HandMotions& motions) const {
  const auto fits = [&](double share) {
    const Planned planned = plan(motions, share);
    return planned.through || possible(options_.size, planned.pose);
  };
  if (fits(1)) return 1;
  double can = 0, cannot = 1;
  for (int k = 0; k < kHalvings; ++k) {
    const double mid = (can + cannot) / 2;
    (fits(mid) ? can : cannot) = mid;
  }
  return can;
}

double TearingSheet::follow(const Planned& planned) {
  const double way_m = length(planned.advance_m);
  if (planned.through && !path_.finish(planned.pose.tip_m)) return 0;
  pose_ = planned.pose;
  if (way_m > 0) ahead_ = direction_of(planned.advance_m);
  if (!planned.through) {
    path_.follow(pose_.tip_m, ahead_);
    return way_m;
  }
  separated_ = true;  // the cone stays as it was, and lies down from there
  for (const auto side : {kLeft, kRight}) pieces_[side] = pieces_at_first_[side] = pose_.region(side);
  return way_m;
}

void TearingSheet::move_pieces(const HandMotions& motions, double dt_s) {
  lying_down_s_ += dt_s;
  for (const auto side : {kLeft, kRight}) {
    const HandMotion& hand = motions[side];
    Grip& grip = pose_.grips[side];
    grip.thumb_m = grip.thumb_m + hand.slide_m;
    grip.index_m = grip.index_m + hand.slide_m;
    PlanarPose& piece = pieces_[side];
    piece = {piece.angle_rad, grip.thumb_m, piece.at(grip.thumb_m) + hand.translation_m};
    piece.angle_rad += side == kLeft ? -hand.rotation_rad : hand.rotation_rad;
  }
}

/// What lies to the left of the tear, far beyond the sheet's borders: back along the tear, round the sheet.
std::vector<Point2> TearingSheet::left_outline_m() const {
  const auto path = path_.points_m();
  std::vector<Point2> outline(path.begin(), path.end());
  const Point2 start = path.front();
  double heading = 0;
  if (separated_) {
    heading = angle_of(outward_at(options_.size, path.back()));
  } else {
    outline.push_back(pose_.tip_m);
    heading = angle_of(ahead_of(pose_));
  }
  const Point2 centre = outline.back();
  const double far_m = kAround * (options_.size.width_m + options_.size.height_m);
  const Point2 back = outward_at(options_.size, start);
  double turn = std::fmod(angle_of(back) - heading + 4 * std::numbers::pi, 2 * std::numbers::pi);
  constexpr int kPieces = 8;
  for (int k = 0; k <= kPieces; ++k) outline.push_back(centre + far_m * turned({1, 0}, heading + turn * k / kPieces));
  return outline;
}

std::vector<TornSide> TearingSheet::sides() const {
  const auto outline = left_outline_m();
  const auto& uv = mesh_->material_coordinates;
  std::vector<TornSide> sides(uv.size());
  for (std::size_t v = 0; v < uv.size(); ++v) {
    const TornVertex kind = torn_.vertices()[v];
    const bool left =
        kind == TornVertex::kLeftLip ||
        (kind == TornVertex::kSheet && inside(outline, {static_cast<double>(uv[v][0]), static_cast<double>(uv[v][1])}));
    sides[v] = left ? kLeft : kRight;
  }
  return sides;
}

Point3 TearingSheet::place(Point2 material_m, TornSide side) const {
  if (!separated_) {
    if (cone_.covers(material_m)) return cone_.at(material_m);
    const Point2 p = pose_.region(side).at(material_m);
    return {p.x, p.y, 0};
  }
  const Point2 p = pieces_[side].at(material_m);
  const double still = 1 - smooth_step(lying_down_s_ / kLiesDown_s);
  if (still == 0 || !cone_.covers(material_m)) return {p.x, p.y, 0};
  const Point3 was = cone_.at(material_m);
  const Point2 flat = pieces_at_first_[side].at(material_m);
  return {p.x + still * (was[0] - flat.x), p.y + still * (was[1] - flat.y), still * was[2]};
}

void TearingSheet::positions(std::span<float> xyz_m) const {
  const auto& uv = mesh_->material_coordinates;
  assert(xyz_m.size() == 3 * uv.size());
  const auto side_of = sides();
  for (std::size_t v = 0; v < uv.size(); ++v) {
    const Point2 m{static_cast<double>(uv[v][0]), static_cast<double>(uv[v][1])};
    Point3 p = place(m, side_of[v]);
    if (torn_.vertices()[v] == TornVertex::kTip && !cone_.covers(m)) {  // both regions hold it
      const Point3 left = place(m, kLeft), right = place(m, kRight);
      for (std::size_t k = 0; k < 3; ++k) p[k] = (left[k] + right[k]) / 2;
    }
    for (std::size_t k = 0; k < 3; ++k) xyz_m[3 * v + k] = static_cast<float>(p[k]);
  }
}

void TearingSheet::anchored(std::span<std::uint8_t> mask) const {
  const auto& uv = mesh_->material_coordinates;
  assert(mask.size() == uv.size());
  const auto side_of = sides();
  for (std::size_t v = 0; v < uv.size(); ++v) {
    const Point2 m{static_cast<double>(uv[v][0]), static_cast<double>(uv[v][1])};
    const Grip& grip = pose_.grips[side_of[v]];
    const bool covered = !separated_ && cone_.covers(m);
    mask[v] = !covered && (length(m - grip.thumb_m) < kFinger_m || length(m - grip.index_m) < kFinger_m) ? 1 : 0;
  }
}

std::optional<SheetTearTip> TearingSheet::tip() const {
  if (separated_) return std::nullopt;
  const Point2 along = turned(ahead_, (pose_.angle_rad[kLeft] + pose_.angle_rad[kRight]) / 2);
  return SheetTearTip{1, {pose_.placed_tip_m.x, pose_.placed_tip_m.y, 0}, {along.x, along.y, 0}, speed_m_per_s_};
}

}  // namespace rustle::sheets
