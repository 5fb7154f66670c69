#include "server/validation/virtual_sheet.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "client_sdk/sheets/shape.h"
#include "server/engine/stream_item.h"

namespace rustle::validation {
namespace {

constexpr double kRubbed_m = 0.2, kRubbingSpeed_m_per_s = 0.1;
constexpr double kShortBase_m = 0.04, kLongBase_m = 0.16, kTrapezoidHeight_m = 0.10;
constexpr double kTrapezoidCompression = 0.30;

sheets::SheetMesh rectangle(double width_m, double height_m, std::size_t triangles) {
  return sheets::make_rectangle(sheets::MeshKind::kDelaunay, width_m, height_m, triangles, 1);
}

/// To and fro at a constant speed: from -10 cm to +10 cm and back in 4 s.
double rubbed_to_m(double time_s) {
  const double way = std::fmod(kRubbingSpeed_m_per_s * time_s, 2 * kRubbed_m);
  return (way < kRubbed_m ? way : 2 * kRubbed_m - way) - kRubbed_m / 2;
}

/// The shape at rest, slid along x; its lowest point is on the table.
std::unique_ptr<sheets::AnimatedSheet> rubbed(sheets::SheetMesh mesh, sheets::MaterialMap shape, double duration_s) {
  double lowest_m = 1e9;
  for (const auto& [u, v] : mesh.material_coordinates) lowest_m = std::min(lowest_m, shape(u, v)[2]);
  sheets::Animation animation;
  animation.duration_s = duration_s;
  animation.on_table = true;
  animation.map_at = [shape = std::move(shape), lowest_m](double time_s) -> sheets::MaterialMap {
    return [shape, lowest_m, shift_m = rubbed_to_m(time_s)](double u, double v) -> sheets::Point3 {
      const sheets::Point3 p = shape(u, v);
      return {p[0] + shift_m, p[1], p[2] - lowest_m};
    };
  };
  return sheets::make_animated(std::move(mesh), std::move(animation));
}

/// Half angle x of an arc whose chord is (1 - compression) of it.
double half_angle_rad(double compression) {
  return 1 / (2 * sheets::radius_from_compression_m(1, compression));
}

/// The trapezoid as material: the long base at v = 0, symmetric about u = kLongBase / 2.
sheets::SheetMesh trapezoid(std::size_t triangles) {
  sheets::SheetMesh mesh = rectangle(kLongBase_m, kTrapezoidHeight_m, triangles);
  for (auto& [u, v] : mesh.material_coordinates) {
    const double narrowed = 1 - (1 - kShortBase_m / kLongBase_m) * v / kTrapezoidHeight_m;
    u = static_cast<float>(kLongBase_m / 2 + narrowed * (u - kLongBase_m / 2));
  }
  return mesh;
}

}  // namespace

sheet::Vec3d listening_point_m() {
  return {0, -std::cos(std::numbers::pi / 6), std::sin(std::numbers::pi / 6)};
}

scene::Obstacle table(bool reflecting) {
  scene::Obstacle plane;
  plane.id = 1;
  plane.name = "table";
  plane.surface_material = "wooden-table";
  plane.reflecting = reflecting;
  plane.shape = scene::PlaneShape{};
  return plane;
}

scene::Obstacle wall(const sheet::Vec3d& point_m, const sheet::Vec3d& normal) {
  scene::Obstacle plane;
  plane.id = 2;
  plane.name = "wall";
  plane.reflecting = true;
  plane.shape = scene::PlaneShape{};
  plane.pose.position_m = point_m;
  plane.pose.orientation = Eigen::Quaterniond::FromTwoVectors(sheet::Vec3d::UnitZ(), normal);
  return plane;
}

std::vector<observation::CrumplingEvent> Heard::crumpling() const {
  std::vector<observation::CrumplingEvent> events;
  for (const auto& frame : observed) events.insert(events.end(), frame.crumpling.begin(), frame.crumpling.end());
  return events;
}

std::vector<float> Heard::between(double from_s, double to_s) const {
  const auto from = static_cast<std::ptrdiff_t>(std::lround(from_s * kRate_hz));
  const auto to = static_cast<std::ptrdiff_t>(std::lround(to_s * kRate_hz));
  std::vector<float> part(static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, to - from)), 0.0F);
  for (std::ptrdiff_t n = std::max<std::ptrdiff_t>(0, from); n < to && n < std::ssize(samples); ++n) {
    part[static_cast<std::size_t>(n - from)] = samples[static_cast<std::size_t>(n)];
  }
  return part;
}

std::vector<engine::StreamItem> stream_of(const Take& take) {
  const auto& mesh = take.sheet->mesh();
  const std::size_t vertices = mesh.material_coordinates.size();
  sheet::Topology::Input input;
  input.id = 1;
  input.vertex_count = vertices;
  for (const auto& t : mesh.triangles) input.triangles.push_back({t[0], t[1], t[2]});
  for (const auto& m : mesh.material_coordinates) input.material_coordinates_m.emplace_back(m[0], m[1]);
  auto topology = sheet::Topology::make(std::move(input));
  if (!topology) throw std::runtime_error(topology.error());

  std::vector<engine::StreamItem> items;
  engine::SheetDescription description;
  description.id = 1;
  description.name = "virtual sheet";
  items.emplace_back(description);
  if (!take.obstacles.empty()) {
    scene::SceneUpdate update;
    update.obstacles = take.obstacles;
    items.emplace_back(update);
  }
  scene::Listener listener;
  listener.position_m = take.listener_m;
  items.emplace_back(listener);

  const auto frames = static_cast<int>(std::floor(take.sheet->duration_s() * take.frame_rate_hz + 1e-6));
  std::vector<float> xyz(3 * vertices);
  std::vector<std::uint8_t> held(vertices);
  for (int k = 0; k <= frames; ++k) {
    sheet::MeshFrame frame;
    frame.sheet = 1;
    frame.time_s = k / take.frame_rate_hz;
    frame.topology = *topology;
    take.sheet->positions(frame.time_s, xyz);
    for (std::size_t v = 0; v < vertices; ++v) frame.positions_m.emplace_back(xyz[3 * v], xyz[3 * v + 1], xyz[3 * v + 2]);
    take.sheet->anchored(frame.time_s, held);
    frame.anchored.assign(held.begin(), held.end());
    items.emplace_back(std::move(frame));
  }
  return items;
}

Heard play(const Setting& setting, const Take& take) {
  std::vector<engine::StreamItem> items = stream_of(take);
  std::size_t next = 0;
  Heard heard;
  std::string refusal;
  session::OfflineEnds ends;
  ends.next = [&]() -> std::optional<engine::StreamItem> {
    if (next == items.size()) return std::nullopt;
    return std::move(items[next++]);
  };
  ends.observed = [&](const observation::Observation& observed) { heard.observed.push_back(observed); };
  ends.refused = [&](const engine::Refusal& refused) { refusal = refused.field + ": " + refused.message; };
  ends.audio = [&](const engine::AudioQuantum& quantum) {
    heard.samples.insert(heard.samples.end(), quantum.mix.begin(), quantum.mix.end());
    return true;
  };
  engine::Options options;
  options.seed = take.seed;
  options.mode = take.mode;
  options.layout = engine::Layout::kMono;
  options.rate_hz = kRate_hz;
  options.default_material = take.material.empty() ? setting.material : take.material;
  options.max_sheets = 1;
  heard.summary = session::render_offline(options, setting.packs, 1, ends);
  if (!refusal.empty()) throw std::runtime_error(refusal);
  return heard;
}

std::unique_ptr<sheets::AnimatedSheet> make_rubbed(const RubbedSheet& sheet, double duration_s) {
  const double curvature_per_m =
      sheet.compression > 0 ? 1 / sheets::radius_from_compression_m(sheet.bent_edge_m, sheet.compression) : 0.0;
  const sheets::BentShape shape(sheet.bent_edge_m, sheet.straight_edge_m, 0, {}, {curvature_per_m});
  return rubbed(
      rectangle(sheet.bent_edge_m, sheet.straight_edge_m, sheet.triangles),
      [shape](double u, double v) { return shape.at(u, v); }, duration_s);
}

std::unique_ptr<sheets::AnimatedSheet> make_rubbed(Trapezoid which, double duration_s, std::size_t triangles) {
  if (which == Trapezoid::kStraightBases) {
    const double curvature_per_m = 2 * half_angle_rad(kTrapezoidCompression) / kTrapezoidHeight_m;
    const sheets::BentShape shape(kTrapezoidHeight_m, kLongBase_m, 0, {}, {curvature_per_m});
    // The bend runs along the height, from base to base.
    return rubbed(
        trapezoid(triangles), [shape](double u, double v) { return shape.at(v, u); }, duration_s);
  }
  // The legs, lengthened, meet at the apex; rolled onto a cone they lie at turns of ±x about its axis.
  const double apex_m = kTrapezoidHeight_m * kLongBase_m / (kLongBase_m - kShortBase_m);
  const double leg_rad = std::atan2(kLongBase_m / 2, apex_m);
  // What is compressed is the straight base, whose ends are sin(leg)/leg as far apart as the arc between them is long.
  const double x_rad = half_angle_rad(1 - (1 - kTrapezoidCompression) * std::sin(leg_rad) / leg_rad);
  const double half_cone_rad = std::asin(leg_rad / x_rad);
  const sheets::ConeShape cone(kLongBase_m, kTrapezoidHeight_m, {kLongBase_m / 2, apex_m}, half_cone_rad);
  // Both legs lie in a plane that rises by this angle along the axis; turned back they lie on the table.
  const double rise_rad = std::atan(std::tan(half_cone_rad) * std::cos(x_rad));
  // Turned a quarter as well: the bases lie along y, toward the listener.
  const auto laid = [cone, rise_rad](double u, double v) -> sheets::Point3 {
    const sheets::Point3 p = cone.at(u, v);
    return {0.1 - p[1] * std::cos(rise_rad) - p[2] * std::sin(rise_rad), p[0],
            p[2] * std::cos(rise_rad) - p[1] * std::sin(rise_rad)};
  };
  return rubbed(trapezoid(triangles), laid, duration_s);
}

std::unique_ptr<sheets::AnimatedSheet> make_flapped(const FlappedSheet& sheet) {
  sheets::Animation animation;
  animation.duration_s = sheet.zero_s(sheet.reversals - 1) + 0.3;
  const double bend_per_m = 1 / sheets::radius_from_compression_m(sheet.bent_edge_m, sheet.compression);
  animation.map_at = [sheet, bend_per_m](double time_s) -> sheets::MaterialMap {
    double share = 1;
    for (int k = 0; k < sheet.reversals; ++k) {
      const double from = share > 0 ? 1 : -1;
      const double begin_s = sheet.zero_s(k) - sheet.reversal_s / 2;
      if (time_s > begin_s) share = from * (1 - 2 * sheets::smooth_step((time_s - begin_s) / sheet.reversal_s));
      if (time_s < begin_s + sheet.reversal_s) break;
    }
    const sheets::BentShape shape(sheet.bent_edge_m, sheet.straight_edge_m, 0, {}, {share * bend_per_m});
    return [shape, sheet](double u, double v) -> sheets::Point3 {
      const sheets::Point3 p = shape.at(u, v);
      const double c = std::cos(sheet.tilt_rad), s = std::sin(sheet.tilt_rad);
      return {p[0] * c + p[2] * s + sheet.centre_m[0], p[1] + sheet.centre_m[1], p[2] * c - p[0] * s + sheet.centre_m[2]};
    };
  };
  return sheets::make_animated(rectangle(sheet.bent_edge_m, sheet.straight_edge_m, sheet.triangles), std::move(animation));
}

std::unique_ptr<sheets::AnimatedSheet> make_crumpled(std::size_t triangles, double duration_s) {
  constexpr double kLength_m = 0.297, kWidth_m = 0.210;
  constexpr int kCreases = 7;
  sheets::Animation animation;
  animation.duration_s = duration_s;
  animation.map_at = [duration_s](double time_s) -> sheets::MaterialMap {
    const double grown = std::clamp(time_s / duration_s, 0.0, 1.0);
    return [time_s, grown](double u, double v) -> sheets::Point3 {
      double height_m = 0;
      for (int k = 0; k < kCreases; ++k) {
        const double direction = 2.4 * k, spacing_m = 0.05 + 0.013 * k;
        const double along =
            ((u - kLength_m / 2) * std::cos(direction) + (v - kWidth_m / 2) * std::sin(direction)) / spacing_m;
        const double fold = std::asin(0.98 * std::sin(2 * std::numbers::pi * (along + 0.07 * k)));
        height_m += 0.12 * grown * spacing_m * fold * std::sin(2 * std::numbers::pi * (0.6 + 0.17 * k) * time_s + k);
      }
      return {u - kLength_m / 2, v - kWidth_m / 2, 0.4 + height_m};
    };
  };
  return sheets::make_animated(rectangle(kLength_m, kWidth_m, triangles), std::move(animation));
}

}  // namespace rustle::validation
