#include <cstdlib>
#include <functional>
#include <new>

#include <catch2/catch.hpp>

#include "server/analysis/contacts.h"
#include "tests/unit/analysis/contact_sheets.h"

using namespace contact_tests;

namespace {

thread_local bool counting = false;
thread_local int allocations = 0;

void* counted(std::size_t size, std::size_t alignment = alignof(std::max_align_t)) {
  if (counting) ++allocations;
  if (void* p = std::aligned_alloc(alignment, (size + alignment) / alignment * alignment)) return p;
  throw std::bad_alloc();
}

}  // namespace

void* operator new(std::size_t size) {
  return counted(size);
}
void* operator new[](std::size_t size) {
  return counted(size);
}
void* operator new(std::size_t size, std::align_val_t at) {
  return counted(size, static_cast<std::size_t>(at));
}
void* operator new[](std::size_t size, std::align_val_t at) {
  return counted(size, static_cast<std::size_t>(at));
}
void operator delete(void* p) noexcept {
  std::free(p);
}
void operator delete[](void* p) noexcept {
  std::free(p);
}
void operator delete(void* p, std::size_t) noexcept {
  std::free(p);
}
void operator delete[](void* p, std::size_t) noexcept {
  std::free(p);
}
void operator delete(void* p, std::align_val_t) noexcept {
  std::free(p);
}
void operator delete[](void* p, std::align_val_t) noexcept {
  std::free(p);
}
void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
  std::free(p);
}
void operator delete[](void* p, std::size_t, std::align_val_t) noexcept {
  std::free(p);
}

TEST_CASE("A warm tracker allocates what it returns and nothing else", "[contacts]") {
  const scene::SceneState table = table_at();
  const scene::SceneState ball = scene_with(scene::SphereShape{0.1});
  const scene::SceneState nothing;
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, 1333);
  const auto topology = topology_of(mesh);
  struct Scene {
    const char* name;
    const scene::SceneState* scene;
    std::function<Vec3d(double, double, double)> at;
    bool touches;
    bool other = false;
  };
  const std::vector<Scene> scenes = {
      {"above", &table, [](double u, double v, double t) { return Vec3d(curled(u, v) + Vec3d(0.1 * t, 0, 0.02)); }, false},
      {"bending", &table, [](double u, double v, double t) { return Vec3d(u, v, 0.02 + (4 + 20 * t) * u * u); }, false},
      {"sliding", &table, [](double u, double v, double t) { return Vec3d(curled(u, v) + Vec3d(0.1 * t, 0, 0)); }, true},
      {"ball", &ball, [](double u, double v, double t) { return Vec3d(u - 0.15 + 0.1 * t, v - 0.1, 0.1005); }, true},
      {"folded", &nothing, [](double u, double v, double t) { return folded(u, v, t); }, true},
      {"stacked", &nothing, [](double u, double v, double t) { return Vec3d(u + 0.1 * t, v, 0.002); }, true, true},
  };
  for (const Scene& scene : scenes) {
    INFO(scene.name);
    std::vector<MeshFrame> frames, below;
    for (int k = 0; k < 8; ++k) {
      const double t = k / 60.0;
      frames.push_back(frame_at(topology, mesh, t, [&](double u, double v) { return scene.at(u, v, t); }));
      below.push_back(frame_at(
          topology, mesh, t, [](double u, double v) { return Vec3d(u, v, 0); }, 2));
    }
    ContactTracker tracker;
    std::uint64_t next_id = 1;
    for (std::size_t n = 0; n < 2 * frames.size(); ++n) {
      const std::size_t k = n % frames.size();
      const std::size_t last = (n + frames.size() - 1) % frames.size();
      const bool warm = n >= frames.size();
      frames[k].time_s = below[k].time_s = static_cast<double>(n) / 60.0;
      SheetSurroundings around = only(*scene.scene);
      around.touched_surface = around.material = "wood";
      NeighbourSheet neighbour{2, &below[k], n > 0 ? &below[last] : nullptr, "wood"};
      if (scene.other) around.others = {&neighbour, 1};
      allocations = 0;
      counting = warm;
      const auto contacts = tracker.update(frames[k], n > 0 ? &frames[last] : nullptr, around, kRadius_m, next_id);
      counting = false;
      CHECK(contacts.empty() != scene.touches);
      // The list, and the vertices of each.
      if (warm) CHECK(allocations == (contacts.empty() ? 0 : static_cast<int>(1 + contacts.size())));
    }
  }
}
