#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "bench.h"
#include "client_sdk/sheets/animated_sheet.h"
#include "client_sdk/sheets/rectangle.h"
#include "client_sdk/sheets/shape.h"
#include "server/analysis/contacts.h"
#include "server/analysis/crumpling.h"
#include "server/analysis/curvature.h"
#include "server/analysis/region_mesh.h"
#include "server/analysis/resonators.h"
#include "server/analysis/sheet_analyzer.h"
#include "server/scene/scene_state.h"
#include "tests/support/animated_frames.h"

/// Geometry of one frame (P1-P5), warm, beside the plain dihedral pass over the same positions, timed in turn. An A4 sheet
/// of paper at 60 frames a second, a flat foot and a bow on a table, sliding at 0.1 m/s, a tenth of it in contact, its
/// resonators sought in every frame:
///   analysis/frame       SheetAnalyzer while the bow bends through its whole range (±30 %) in half a second and back, 2 % a
///                        frame: a partition serves for several frames (Parameters), p95 is a frame that makes it anew
///   analysis/remade      the same sheet bending five times as fast, 10 % a frame, and no partition may serve for a second
///                        frame: everything is found anew in every frame
///   analysis/free        the motion of frame a metre higher, with a tear tip that asks for regions and resonators all the
///                        same
///   analysis/calm        as frame, bending by 3 ‰ a frame
/// and the stages on their own in the motion of remade, everything anew in every frame:
///   analysis/curvature   relative positions, dihedral angles, H
///   analysis/events      sign events from the angles (H once more within)
///   analysis/contacts    proximity, components, slip
///   analysis/regions     the partition, on the mesh or its coarse proxy
///   analysis/resonators  those that the contacts reach, measured
namespace rustle::bench {
namespace {

using sheet::MeshFrame;
using sheet::Vec3d;
using sheet::Vec3f;

constexpr double kWidth_m = 0.297;
constexpr double kHeight_m = 0.210;
constexpr double kRate_hz = 60;
constexpr int kDiscarded = 20;

/// What is measured is also looked at, so that nothing is left out as unused.
double checksum = 0;

/// A benchmark of the wrong thing is worth nothing.
void require(bool holds, std::string_view what) {
  if (holds) return;
  fmt::print(stderr, "bench_analysis: {}\n", what);
  std::exit(1);
}

/// An A4 sheet with a flat foot at one end and the other end's edge on the table, bowed between. It slides along x while
/// its bow bends more and less, to and fro at a constant pace, by this share in a frame.
sheets::MaterialMap bowed_at(double time_s, double change_per_frame, double lift_m) {
  const double swing = 0.3;
  const double phase = std::fmod(time_s * kRate_hz * change_per_frame / (2 * swing), 2.0);
  const double rise_per_m = 25 * (1 - swing + 2 * swing * std::abs(phase - 1));
  const double foot_m = 0.008;
  const double rise_end_m = foot_m + 0.026;
  const auto curve = [=](double bow_per_m) {
    return sheets::ArcCurve({foot_m, rise_end_m}, {0, -rise_per_m, bow_per_m}, 0, {});
  };
  double low = 0;
  double high = 12;
  for (int k = 0; k < 50; ++k) {  // the bow whose end comes down to the table
    const double middle = (low + high) / 2;
    (curve(middle).at(kWidth_m).z_m > 0 ? low : high) = middle;
  }
  return [bow = curve(low), shift_m = 0.1 * time_s, lift_m](double u, double v) -> sheets::Point3 {
    const auto pose = bow.at(u);
    return {pose.x_m + shift_m, v, pose.z_m + lift_m};
  };
}

std::unique_ptr<sheets::AnimatedSheet> bowed_sheet(std::size_t triangles, double change_per_frame, double lift_m) {
  sheets::Animation animation;
  animation.duration_s = 1e9;
  animation.map_at = [=](double time_s) { return bowed_at(time_s, change_per_frame, lift_m); };
  return sheets::make_animated(sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, triangles, 1),
                               std::move(animation));
}

scene::SceneState table() {
  scene::SceneState scene;
  scene::Obstacle plane;
  plane.id = 1;
  plane.shape = scene::PlaneShape{};
  scene::SceneUpdate update;
  update.obstacles.push_back(std::move(plane));
  require(scene.apply(std::move(update)).has_value(), "the table is refused");
  return scene;
}

/// The plain dihedral pass: what anyone would write first. θ of every interior edge, then H = Σ θ|e| / (4 A) with A the
/// barycentric dual area.
class PlainDihedralPass {
 public:
  explicit PlainDihedralPass(const sheet::Topology& topology) : topology_(topology), hinges_(sheet::hinges(topology)) {}

  void run(std::span<const Vec3f> p) {
    angle_rad_.resize(hinges_.size());
    for (std::size_t e = 0; e < hinges_.size(); ++e) {
      const auto [start, end, left, right] = hinges_[e];
      const Vec3f edge = (p[end] - p[start]).normalized();
      const Vec3f n_left = (p[end] - p[start]).cross(p[left] - p[start]).normalized();
      const Vec3f n_right = (p[right] - p[start]).cross(p[end] - p[start]).normalized();
      angle_rad_[e] = std::atan2(n_left.cross(n_right).dot(edge), n_left.dot(n_right));
    }
    area_m2_.assign(p.size(), 0.0f);
    for (const sheet::Triangle& t : topology_.triangles()) {
      const float third = (p[t[1]] - p[t[0]]).cross(p[t[2]] - p[t[0]]).norm() / 6;
      for (std::uint32_t v : t) area_m2_[v] += third;
    }
    curvature_per_m.assign(p.size(), 0.0f);
    for (std::size_t e = 0; e < hinges_.size(); ++e) {
      const float bend = angle_rad_[e] * (p[hinges_[e][1]] - p[hinges_[e][0]]).norm();
      curvature_per_m[hinges_[e][0]] += bend;
      curvature_per_m[hinges_[e][1]] += bend;
    }
    for (std::size_t v = 0; v < p.size(); ++v) curvature_per_m[v] /= 4 * area_m2_[v];
  }

  std::vector<float> curvature_per_m;

 private:
  const sheet::Topology& topology_;
  std::vector<sheet::Hinge> hinges_;
  std::vector<float> angle_rad_, area_m2_;
};

/// The stages on their own, as SheetAnalyzer calls them, but the partition made anew in every frame.
class Stages {
 public:
  explicit Stages(const MeshFrame& first)
      : curvature_(analysis::curvature_stencils(first.topology, sheet::rest_plane(*first.topology, first.positions_m),
                                                parameters_)),
        regions_(analysis::region_mesh(first.topology, curvature_.plane, parameters_)),
        finder_(parameters_),
        marks_(regions_.stencils.topology->vertex_count(), 0) {}

  void run(const MeshFrame& frame, const analysis::SheetSurroundings& surroundings) {
    const Vec3f near_m = sheet::mean_position_m(frame.positions_m);
    const Vec3d origin_m = near_m.cast<double>();
    timings["curvature"].run([&] {
      sheet::relative_positions_m(frame.positions_m, near_m, relative_m_);
      angles_rad_.resize(curvature_.hinges.size());
      sheet::dihedral_angles_rad(curvature_.hinges, relative_m_, angles_rad_);
      analysis::measure_curvature(curvature_, angles_rad_, now_);
    });
    timings["events"].run([&] {
      const std::span<const Vec3f> before = last_ ? std::span<const Vec3f>(last_->positions_m) : std::span<const Vec3f>();
      const auto events = analysis::find_crumpling({curvature_, angles_rad_, frame.positions_m, {}, before, frame.time_s},
                                                   parameters_, crumpling_, next_event_id_);
      checksum += static_cast<double>(events.size());
    });
    std::vector<observation::FrictionContact> friction;
    timings["contacts"].run([&] {
      friction = contacts_.update(
          {frame, last_ ? &*last_ : nullptr, surroundings, parameters_.contact_radius_m, near_m, relative_m_},
          next_event_id_);
    });
    timings["regions"].run([&] {
      positions_m_ = regions_.positions_m(relative_m_, gathered_m_);
      const auto angles_rad =
          regions_.proxy || !curvature_.in_edge_order ? std::span<const float>() : std::span<const float>(angles_rad_);
      analysis::segment(regions_.stencils, {positions_m_, angles_rad}, frame.time_s, parameters_, &history_, scratch_, map_);
    });
    timings["resonators"].run([&] {
      holds_.anchored.assign(positions_m_.size(), 0);
      holds_.touching.assign(positions_m_.size(), 0);
      vertices_.clear();
      for (const auto& contact : friction) {
        for (const auto& vertex : contact.vertices) vertices_.push_back(vertex.vertex);
      }
      regions_.mark(vertices_, holds_.touching);
      regions_.gather_triangles(vertices_, marks_, triangles_);
      finder_.turn_to({regions_.stencils, map_, positions_m_, origin_m, holds_, nullptr});
      for (const auto& resonator : finder_.reached_from(triangles_, analysis::ResonatorFinder::StopAt::kRidgesAndAnchors)) {
        checksum += resonator.ruling_length_m;
      }
    });
    last_ = frame;
  }

  std::map<std::string, Timings> timings;

 private:
  analysis::Parameters parameters_;
  analysis::CurvatureStencils curvature_;
  analysis::RegionMesh regions_;
  analysis::ResonatorFinder finder_;
  analysis::CrumplingState crumpling_;
  analysis::ContactTracker contacts_;
  analysis::RegionState history_;
  std::optional<MeshFrame> last_;
  std::uint64_t next_event_id_ = 1;
  std::vector<sheet::Vec4f> relative_m_, gathered_m_;
  std::span<const sheet::Vec4f> positions_m_;
  std::vector<float> angles_rad_;
  analysis::Curvature now_;
  analysis::RegionScratch scratch_;
  analysis::RegionMap map_;
  analysis::Holds holds_;
  std::vector<std::uint8_t> marks_;
  std::vector<std::uint32_t> vertices_, triangles_;
};

bool slides(const observation::Observation& seen) {
  return !seen.friction.empty() && !seen.friction[0].resonators.empty();
}

struct SizeResult {
  double frame_us, frame_mean_us, remade_us, free_us, frame_ratio;
};

SizeResult measure(std::size_t triangles, const Options& options, Report& report) {
  const auto on_table = bowed_sheet(triangles, 0.02, 0);
  const auto above = bowed_sheet(triangles, 0.02, 1);
  const auto wildly = bowed_sheet(triangles, 0.1, 0);
  const auto calmly = bowed_sheet(triangles, 0.003, 0);
  const test_support::AnimatedFrames table_frames(*on_table);
  const test_support::AnimatedFrames free_frames(*above);
  const test_support::AnimatedFrames calm_frames(*calmly);
  const test_support::AnimatedFrames wild_frames(*wildly);
  const scene::SceneState scene = table();
  analysis::SheetSurroundings surroundings;
  surroundings.scene = &scene;
  const MeshFrame first = table_frames.at(0);
  PlainDihedralPass reference(*first.topology);
  analysis::SheetAnalyzer frame_analyzer(1, {});
  analysis::SheetAnalyzer free_analyzer(1, {});
  analysis::SheetAnalyzer calm_analyzer(1, {});
  analysis::Parameters forgetful;
  forgetful.partition_age_s = 0;
  analysis::SheetAnalyzer remaking_analyzer(1, forgetful);
  Stages stages(first);
  Timings reference_times, frame_times, remade_times, free_times, calm_times;
  std::uint64_t next_event_id = 1;
  observation::Observation seen;
  std::size_t touching = 0;
  const int frames = triangles > 50000 ? std::min(options.frames, 100) : options.frames;
  for (int k = 0; k < kDiscarded + frames; ++k) {
    if (k == kDiscarded) {
      for (Timings* times : {&reference_times, &frame_times, &remade_times, &free_times, &calm_times}) times->discard();
      for (auto& [name, times] : stages.timings) times.discard();
    }
    const double time_s = k / kRate_hz;
    const MeshFrame frame = table_frames.at(time_s);
    const MeshFrame calm = calm_frames.at(time_s);
    const MeshFrame wild = wild_frames.at(time_s);
    MeshFrame free = free_frames.at(time_s);
    free.tear_tips.push_back({1, free.positions_m[free.positions_m.size() / 2], 0.1f, std::nullopt});

    reference_times.run([&] { reference.run(frame.positions_m); });
    checksum += static_cast<double>(reference.curvature_per_m[frame.positions_m.size() / 2]);
    frame_times.run([&] { seen = frame_analyzer.analyze(frame, surroundings, next_event_id); });
    touching = 0;
    for (const auto& contact : seen.friction) touching += contact.vertices.size();
    require(k == 0 || slides(seen), "the sheet on the table does not slide");
    remade_times.run([&] { seen = remaking_analyzer.analyze(wild, surroundings, next_event_id); });
    require(k == 0 || slides(seen), "the wild sheet does not slide");
    free_times.run([&] { seen = free_analyzer.analyze(free, surroundings, next_event_id); });
    require(seen.friction.empty() && !seen.tears.empty() && !seen.tears[0].resonators.empty(),
            "the sheet in the air does not ring");
    calm_times.run([&] { seen = calm_analyzer.analyze(calm, surroundings, next_event_id); });
    require(k == 0 || slides(seen), "the calm sheet does not slide");
    stages.run(wild, surroundings);
  }
  const std::size_t count = first.topology->triangle_count();
  const double reference_us = reference_times.median_us();
  const auto add = [&](const std::string& name, const Timings& times) {
    report.add(
        {"analysis/" + name, count, times.median_us(), times.quantile_us(0.95), reference_us, "triangles", times.mean_us()});
  };
  add("frame", frame_times);
  add("remade", remade_times);
  add("free", free_times);
  add("calm", calm_times);
  for (const char* name : {"curvature", "events", "contacts", "regions", "resonators"}) add(name, stages.timings[name]);
  report.note(fmt::format("{} of {} vertices touch", touching, first.positions_m.size()));
  return {frame_times.median_us(), frame_times.mean_us(), remade_times.median_us(), free_times.median_us(),
          frame_times.median_us() / reference_us};
}

}  // namespace
}  // namespace rustle::bench

int main(int argc, char** argv) {
  using namespace rustle::bench;
  const Options options = read_options(argc, argv);
  Report report(options);
  std::map<int, SizeResult> results;
  for (const int triangles : {183, 446, 1000, 1333, 20000, 100000}) {
    if (options.triangles == 0 || options.triangles == triangles)
      results.emplace(triangles, measure(static_cast<std::size_t>(triangles), options, report));
  }
  if (options.triangles != 0) return report.finish();
  report.goal("frame, 183 triangles, us", results.at(183).frame_us, 15);
  report.goal("frame, 446 triangles, us", results.at(446).frame_us, 30);
  report.goal("frame, 1333 triangles, us", results.at(1333).frame_us, 75);
  report.goal("mean of frame, 1333 triangles, us", results.at(1333).frame_mean_us, 75);
  report.goal("remade, 1333 triangles, us", results.at(1333).remade_us, 75);
  report.goal("frame beside reference, 1333 triangles", results.at(1333).frame_ratio, 5);
  report.goal("100,000 triangles beside 1,000", results.at(100000).frame_us / results.at(1000).frame_us, 110);
  report.goal("remade, 100,000 triangles beside 1,000", results.at(100000).remade_us / results.at(1000).remade_us, 110);
  for (const auto& [triangles, result] : results) {
    report.goal(fmt::format("contact beside free, {} triangles", triangles), result.frame_us / result.free_us, 2);
  }
  if (!std::isfinite(checksum)) fmt::print(stderr, "a result was not finite\n");
  return report.finish();
}
