#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include "client_sdk/sheets/motions.h"
#include "moving_sheet.h"
#include "tests/support/animated_frames.h"

namespace reversal_test {

using namespace rustle;
using observation::CrumplingEvent;
using sheets::MeshKind;

namespace {

constexpr std::array<std::size_t, 4> kSizes = {183, 446, 1333, 20000};
constexpr std::array<double, 4> kRates_hz = {30, 60, 120, 240};

std::vector<CrumplingEvent> events_of(const sheets::AnimatedSheet& sheet, double rate_hz, double duration_s) {
  const test_support::AnimatedFrames frames(sheet);
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  std::vector<CrumplingEvent> out;
  for (int k = 0; k <= duration_s * rate_hz; ++k) {
    auto seen = analyzer.analyze(frames.at(k / rate_hz), {}, next_id);
    for (auto& event : seen.crumpling) out.push_back(std::move(event));
  }
  return out;
}

struct Heard {
  std::string where;
  double amplitude_m;
};

/// Checks one run and returns its loudness: the event's with its continuations.
Heard hear_once(const sheets::SheetMesh& mesh, const std::string& where, const sheets::ReversalOptions& options,
                double rate_hz) {
  const auto sheet = sheets::make_reversal(mesh, options);
  const auto events = events_of(*sheet, rate_hz, sheet->duration_s());
  const std::string run = fmt::format("{} at {} fps", where, rate_hz);
  CAPTURE(run, options.reversal_s);
  double amplitude_m = 0;
  std::size_t beginnings = 0;
  for (const auto& event : events) {
    amplitude_m += event.amplitude_m;
    beginnings += event.continues == 0 ? 1 : 0;
    CHECK(event.direction == -1);
  }
  CHECK(beginnings == 1);
  if (!events.empty()) {
    const double bound_s = options.reversal_s * rate_hz >= 3 - 1e-9 ? 1e-3 : 1 / (3 * rate_hz);
    CHECK(std::abs(events[0].time_s - options.zero_time_s()) <= bound_s);
  }
  return {run, amplitude_m};
}

void check_spread(const std::vector<Heard>& heard, double reversal_s) {
  const auto [least, most] = std::minmax_element(
      heard.begin(), heard.end(), [](const Heard& a, const Heard& b) { return a.amplitude_m < b.amplitude_m; });
  CAPTURE(reversal_s, least->where, least->amplitude_m, most->where, most->amplitude_m);
  CHECK(most->amplitude_m <= 1.2 * least->amplitude_m);
}

const char* name_of(MeshKind kind) {
  return kind == MeshKind::kStructured ? "structured" : kind == MeshKind::kDelaunay ? "delaunay" : "graded";
}

}  // namespace

TEST_CASE("a reversal is one event at every size, triangulation and rate, dated, of one loudness", "[reversal]") {
  for (const auto& [width_m, height_m, curvature_per_m] : {std::tuple{0.297, 0.210, 5.0}, {0.10, 0.05, 12.0}}) {
    for (const double reversal_s : {0.2, 0.1, 0.03}) {
      sheets::ReversalOptions options;
      options.size = {width_m, height_m};
      options.curvature_per_m = curvature_per_m;
      options.start_s = 0.1063;
      options.reversal_s = reversal_s;
      options.rest_s = 0.1;
      std::vector<Heard> heard;
      for (const MeshKind kind : {MeshKind::kStructured, MeshKind::kDelaunay}) {
        for (const std::size_t triangles : kSizes) {
          if (triangles == 20000 && width_m < 0.2) continue;
          const auto mesh = sheets::make_rectangle(kind, width_m, height_m, triangles);
          for (const double rate_hz : kRates_hz) {
            const std::string where = fmt::format("{} cm {} {}", width_m * 100, name_of(kind), triangles);
            heard.push_back(hear_once(mesh, where, options, rate_hz));
          }
        }
      }
      check_spread(heard, reversal_s);
    }
  }
}

TEST_CASE("the date does not depend on where the frames fall", "[reversal]") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 446);
  for (const double rate_hz : kRates_hz) {
    for (const double frames : {0.5, 1.5, 2.5, 3.0, 4.0, 8.0}) {
      for (int phase = 0; phase < 8; ++phase) {
        sheets::ReversalOptions options;
        options.start_s = (6 + phase / 8.0) / rate_hz;
        options.reversal_s = frames / rate_hz;
        options.rest_s = 8 / rate_hz;
        hear_once(mesh, fmt::format("{} frames, phase {}/8", frames, phase), options, rate_hz);
      }
    }
  }
}

TEST_CASE("rigid motion ten metres from the origin makes no event: flat, bent, nearly flat, bent otherwise", "[reversal]") {
  sheets::RigidMotionOptions options;
  options.start_m = {10, -10, 10};
  options.velocity_m_per_s = {1, 2, -0.5};
  options.angular_velocity_rad_per_s = {3, -2, 4};
  const auto bent = [](double curvature_per_m) {
    return std::make_shared<sheets::BentShape>(0.297, 0.210, 0.3, std::vector<double>{}, std::vector{curvature_per_m});
  };
  const std::vector<std::pair<std::string, std::shared_ptr<const sheets::Shape>>> shapes = {
      {"flat", bent(0)},
      {"bent", bent(6)},
      {"R = 5 m", bent(0.2)},
      {"R = -5 m", bent(-0.2)},
      {"R = 2 m", bent(0.5)},
      {"cone", sheets::find_shape("cone")->shape},
      {"sbend", sheets::find_shape("sbend_oblique")->shape}};
  for (const MeshKind kind : {MeshKind::kStructured, MeshKind::kDelaunay, MeshKind::kGraded}) {
    for (const std::size_t triangles : kSizes) {
      const auto mesh = sheets::make_rectangle(kind, 0.297, 0.210, triangles, 5);
      for (const auto& [name, shape] : shapes) {
        if (triangles == 20000 && name[0] != 'R' && name != "flat") continue;
        CAPTURE(name, name_of(kind), triangles);
        CHECK(events_of(*sheets::make_rigid_motion(mesh, shape, options), 60, triangles == 20000 ? 0.2 : 0.5).empty());
      }
    }
  }
}

TEST_CASE("a snap is one event whose loudness is that of the bend it left", "[reversal]") {
  for (const std::size_t triangles : kSizes) {
    const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, triangles);
    for (const double rate_hz : kRates_hz) {
      if (triangles == 20000 && rate_hz != 60) continue;
      sheets::ReversalOptions options;
      options.start_s = 0.1063;
      options.reversal_s = 1e-4;
      options.rest_s = 0.1;
      CAPTURE(triangles);
      const Heard heard = hear_once(mesh, fmt::format("snap {}", triangles), options, rate_hz);
      CHECK(heard.amplitude_m == Approx(0.297 * 0.210 * options.curvature_per_m).epsilon(0.1));
    }
  }
}

TEST_CASE("a frame in which the sheet is exactly flat is the date", "[reversal]") {
  const double rate_hz = 60;
  sheets::ReversalOptions options;
  options.start_s = 20 / rate_hz;
  options.reversal_s = 8 / rate_hz;
  options.rest_s = 8 / rate_hz;
  const auto sheet = sheets::make_reversal(sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 446), options);
  const test_support::AnimatedFrames frames(*sheet);
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  std::vector<CrumplingEvent> events;
  for (int k = 0; k <= 36; ++k) {
    auto frame = frames.at(k / rate_hz);
    if (k == 24) {
      for (auto& position : frame.positions_m) position.z() = 0;
    }
    for (auto& event : analyzer.analyze(frame, {}, next_id).crumpling) events.push_back(std::move(event));
  }
  REQUIRE(!events.empty());
  CHECK(events[0].time_s == Approx(24 / rate_hz).margin(1e-3));
}

}  // namespace reversal_test
