#include "client_sdk/sheets/loops.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <catch2/catch.hpp>

namespace loops_test {

namespace {

using namespace rustle::sheets;

float farthest_m(const std::vector<float>& a, const std::vector<float>& b) {
  float most = 0;
  for (std::size_t i = 0; i < a.size(); i += 3)
    most = std::max(most, std::hypot(a[i] - b[i], a[i + 1] - b[i + 1], a[i + 2] - b[i + 2]));
  return most;
}

TEST_CASE("A loop goes on from its last frame to its first as from any to the next, and never stands") {
  for (const auto name : loop_names()) {
    for (const double frames_per_s : {30.0, 60.0, 100.0}) {
      INFO(name << " " << frames_per_s);
      const auto loop = make_loop(name, 446, frames_per_s);
      REQUIRE(loop);
      const auto& frames = loop->frames;
      REQUIRE(frames.size() >= 12);
      float most = 0;
      for (std::size_t k = 0; k + 1 < frames.size(); ++k) {
        REQUIRE(frames[k].xyz_m.size() == 3 * loop->meshes[frames[k].mesh].material_coordinates.size());
        if (frames[k].mesh != frames[k + 1].mesh) continue;
        const float step = farthest_m(frames[k].xyz_m, frames[k + 1].xyz_m);
        CHECK(step > 0);
        most = std::max(most, step);
      }
      if (frames.front().fresh) continue;
      CHECK(farthest_m(frames.back().xyz_m, frames.front().xyz_m) <= 1.02f * most);
    }
  }
}

TEST_CASE("Loops have names, and the same arguments give the same bits") {
  CHECK_FALSE(make_loop("no such loop", 446, 60));
  CHECK(make_loop("slide", 446, 60)->on_table);
  CHECK_FALSE(make_loop("crumple", 446, 60)->on_table);
  const auto once = make_loop("crumple", 446, 60, 3), again = make_loop("crumple", 446, 60, 3);
  for (std::size_t k = 0; k < once->frames.size(); ++k) CHECK(once->frames[k].xyz_m == again->frames[k].xyz_m);
}

TEST_CASE("The loop of tears begins with a fresh sheet, cuts its mesh again and again and ends in two pieces") {
  const auto loop = make_loop("tear", 446, 60);
  REQUIRE(loop);
  CHECK(loop->on_table);
  CHECK(loop->meshes.size() > 40);
  CHECK(loop->frames.front().fresh);
  CHECK(loop->frames.front().mesh == 0);
  for (std::size_t k = 1; k < loop->frames.size(); ++k) {
    const LoopFrame &before = loop->frames[k - 1], &now = loop->frames[k];
    CHECK_FALSE(now.fresh);
    CHECK((now.mesh == before.mesh || now.mesh == before.mesh + 1));
    CHECK(now.tear_tips.empty() == (k + 1 == loop->frames.size()));
  }
  double fastest = 0;
  for (const auto& frame : loop->frames) {
    for (const auto& tip : frame.tear_tips) fastest = std::max(fastest, tip.speed_m_per_s);
  }
  CHECK(fastest > 0.05);
  CHECK(fastest < 0.3);
}

}  // namespace

}  // namespace loops_test
