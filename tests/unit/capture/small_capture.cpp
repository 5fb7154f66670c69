#include "tests/unit/capture/small_capture.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace rustle::capture {
namespace {

constexpr int kColumns = 6;  // quads along the bend
constexpr int kRows = 5;
constexpr double kSize_m = 0.1;
constexpr double kCurvature_per_m = 15.7;  // a chord 10 % shorter than the sheet
constexpr double kRate_hz = 30;
constexpr int kFrames = 46;

double smooth_step(double from, double to, double x) {
  const double t = std::clamp((x - from) / (to - from), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

double curvature_per_m(double time_s) {
  const double flip = 1 - 2 * smooth_step(0.3, 0.4, time_s);
  return kCurvature_per_m * flip * (1 - smooth_step(0.55, 0.75, time_s));
}

double height_m(double time_s) {
  return 0.002 + 0.048 * (1 - smooth_step(0.6, 0.8, time_s));
}

double slide_m(double time_s) {
  const double t = std::max(0.0, time_s - 0.85);
  return t < 0.2 ? 0.5 * t * t : 0.2 * (t - 0.1);
}

std::vector<float> positions_at(double time_s) {
  std::vector<float> out;
  const double curvature = curvature_per_m(time_s);
  for (int row = 0; row <= kRows; ++row) {
    for (int column = 0; column <= kColumns; ++column) {
      const double s = kSize_m * (static_cast<double>(column) / kColumns - 0.5);
      const double angle = curvature * s;
      const bool bent = std::abs(curvature) > 1e-6;
      const double x = bent ? std::sin(angle) / curvature : s;
      const double z = bent ? (std::cos(angle) - 1) / curvature : 0;
      out.push_back(static_cast<float>(x + slide_m(time_s)));
      out.push_back(static_cast<float>(kSize_m * (static_cast<double>(row) / kRows - 0.5)));
      out.push_back(static_cast<float>(z + height_m(time_s)));
    }
  }
  return out;
}

template <typename Value>
std::string bytes_of(const std::vector<Value>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value)};
}

void fill(v1::Vector3& out, double x, double y, double z) {
  out.set_x(x);
  out.set_y(y);
  out.set_z(z);
}

void fill(v1::Topology& topology) {
  constexpr std::uint32_t kStride = kColumns + 1;
  std::vector<std::uint32_t> triangles;
  std::vector<float> flat;
  for (std::uint32_t row = 0; row < kRows; ++row) {
    for (std::uint32_t column = 0; column < kColumns; ++column) {
      const std::uint32_t a = row * kStride + column;
      for (const std::uint32_t index : {a, a + 1, a + kStride + 1, a, a + kStride + 1, a + kStride})
        triangles.push_back(index);
    }
  }
  for (int row = 0; row <= kRows; ++row) {
    for (int column = 0; column <= kColumns; ++column) {
      flat.push_back(static_cast<float>(kSize_m * column / kColumns));
      flat.push_back(static_cast<float>(kSize_m * row / kRows));
    }
  }
  topology.set_topology_id(1);
  topology.set_vertex_count((kRows + 1) * (kColumns + 1));
  topology.set_triangles(bytes_of(triangles));
  topology.set_material_coordinates(bytes_of(flat));
}

}  // namespace

std::vector<TimedMessage> small_session() {
  std::vector<TimedMessage> session;
  const auto next = [&](double time_s) -> v1::StreamMessage& {
    session.push_back({time_s, {}});
    v1::StreamMessage& message = session.back().message;
    message.set_session_id("small");
    message.set_sequence(session.size());
    return message;
  };
  v1::Announcement& announcement = *next(0).mutable_announcement();
  announcement.set_protocol_version(1);
  announcement.set_name("small");
  announcement.mutable_options()->set_clock(v1::CLOCK_SIMULATION);
  announcement.mutable_options()->set_metres_per_unit(1);
  announcement.mutable_options()->set_up_axis(v1::UP_AXIS_Z);

  v1::Sheet& sheet = *next(0).mutable_sheet();
  sheet.set_sheet_id(1);
  sheet.set_name("sheet");
  sheet.set_kind(v1::SHEET_KIND_PAPER);
  sheet.set_material("printer-paper");

  v1::Obstacle& table = *next(0).mutable_scene()->add_obstacles();
  table.set_obstacle_id(1);
  table.set_name("table");
  table.set_surface_material("wooden-table");
  table.set_reflecting(true);
  fill(*table.mutable_plane()->mutable_normal(), 0, 0, 1);

  fill(*next(0).mutable_listener()->mutable_position(), 0, -0.866, 0.5);
  fill(*next(0).mutable_topology());

  std::vector<std::uint8_t> held((kRows + 1) * (kColumns + 1), 0);
  for (std::size_t row = 0; row <= kRows; ++row) held[row * (kColumns + 1)] = 1;
  for (int f = 0; f < kFrames; ++f) {
    const double time_s = f / kRate_hz;
    v1::MeshFrame& frame = *next(time_s).mutable_frame();
    frame.set_sheet_id(1);
    frame.set_topology_id(1);
    frame.set_time_s(time_s);
    frame.set_positions(bytes_of(positions_at(time_s)));
    frame.set_anchored(bytes_of(held));
  }
  const double last_time_s = (kFrames - 1) / kRate_hz;
  next(last_time_s).mutable_advance()->set_time_s(last_time_s);
  next(last_time_s).mutable_end()->set_time_s(last_time_s);
  return session;
}

}  // namespace rustle::capture
