#include "client_sdk/sheets/loops.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "client_sdk/sheets/cloth_motion.h"
#include "client_sdk/sheets/motions.h"
#include "client_sdk/sheets/tearing_scripts.h"

namespace rustle::sheets {
namespace {

constexpr std::array<std::string_view, 4> kLoopNames{"crumple", "slide", "tear", "cloth"};

constexpr double kTo_m = 0.06, kSlidePeriod_s = 1.2;
constexpr double kArch_per_m = 4;

/// Times of the frames of one period, as near to the rate as whole frames allow.
std::vector<double> times_s(double period_s, double frames_per_s) {
  const auto count = static_cast<std::size_t>(std::max(1.0, std::round(period_s * frames_per_s)));
  std::vector<double> times(count);
  for (std::size_t k = 0; k < count; ++k) times[k] = period_s * static_cast<double>(k) / static_cast<double>(count);
  return times;
}

Loop crumple(SheetMesh mesh, double frames_per_s) {
  ShakeOptions options;
  options.wave.start_s = 0;
  options.wave.ramp_s = 0.4;
  options.wave.end_s = options.duration_s = 1e3;
  const double steady_s = 2 * options.wave.ramp_s, period_s = 1 / options.wave.frequency_hz;
  const auto shaken = make_shake(std::move(mesh), options);
  Loop loop{{shaken->mesh()}, shaken->on_table(), false, {}};
  for (const double time_s : times_s(period_s, frames_per_s)) {
    std::vector<float> xyz_m(3 * shaken->mesh().material_coordinates.size());
    shaken->positions(steady_s + time_s, xyz_m);
    loop.frames.push_back({std::move(xyz_m)});
  }
  return loop;
}

Loop slide(SheetMesh mesh, double frames_per_s) {
  SlideOptions options;
  options.curvature_per_m = kArch_per_m;
  const auto standing = make_slide(std::move(mesh), options);
  Loop loop{{standing->mesh()}, standing->on_table(), false, {}};
  std::vector<float> arch(3 * standing->mesh().material_coordinates.size());
  standing->positions(0, arch);
  for (const double time_s : times_s(kSlidePeriod_s, frames_per_s)) {
    const auto x_m = static_cast<float>(kTo_m * std::sin(2 * std::numbers::pi * time_s / kSlidePeriod_s));
    std::vector<float> xyz_m = arch;
    for (std::size_t i = 0; i < xyz_m.size(); i += 3) xyz_m[i] += x_m;
    loop.frames.push_back({std::move(xyz_m)});
  }
  return loop;
}

Loop rubbed(SheetMesh mesh, double frames_per_s) {
  const auto cloth = make_rubbed_cloth(std::move(mesh));
  Loop loop{{cloth->mesh()}, cloth->on_table(), true, {}};
  for (const double time_s : times_s(kRubbingPeriod_s, frames_per_s)) {
    std::vector<float> xyz_m(3 * cloth->mesh().material_coordinates.size());
    cloth->positions(time_s, xyz_m);
    loop.frames.push_back({std::move(xyz_m)});
  }
  return loop;
}

Loop tear(std::size_t triangle_count, double frames_per_s, std::uint64_t seed) {
  TearingOptions options;
  options.triangles = triangle_count;
  options.seed = seed;
  const auto torn = make_tear("steady", options);
  Loop loop{{}, torn->on_table(), false, {}};
  std::shared_ptr<const SheetMesh> mesh;
  bool in_two = false;
  for (std::size_t k = 0; !in_two && static_cast<double>(k) < torn->duration_s() * frames_per_s; ++k) {
    const StreamedFrame& frame = torn->frame(static_cast<double>(k) / frames_per_s);
    if (frame.mesh != mesh) loop.meshes.push_back(*frame.mesh);
    mesh = frame.mesh;
    loop.frames.push_back({frame.xyz_m, loop.meshes.size() - 1, frame.fresh, frame.tear_tips});
    in_two = frame.tear_tips.empty();
  }
  return loop;
}

}  // namespace

std::span<const std::string_view> loop_names() {
  return kLoopNames;
}

std::optional<Loop> make_loop(std::string_view name, std::size_t triangle_count, double frames_per_s, std::uint64_t seed) {
  constexpr RectangleSize kSheet;
  const auto mesh = [&] {
    return make_rectangle(MeshKind::kDelaunay, kSheet.width_m, kSheet.height_m, triangle_count, seed);
  };
  if (name == "crumple") return crumple(mesh(), frames_per_s);
  if (name == "slide") return slide(mesh(), frames_per_s);
  if (name == "cloth")
    return rubbed(make_rectangle(MeshKind::kDelaunay, kClothWidth_m, kClothHeight_m, triangle_count, seed), frames_per_s);
  if (name == "tear") return tear(std::min<std::size_t>(triangle_count, 100'000), frames_per_s, seed);
  return std::nullopt;
}

}  // namespace rustle::sheets
