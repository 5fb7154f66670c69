#include <catch2/catch.hpp>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "server/page/encode.h"

namespace page_encode_test {
namespace {

using namespace rustle;
using namespace rustle::page;
using Json = nlohmann::json;

std::shared_ptr<const sheet::Topology> square() {
  sheet::Topology::Input input;
  input.vertex_count = 5;  // one in no triangle
  input.triangles = {{0, 1, 2}, {0, 2, 3}};
  return sheet::Topology::make(std::move(input)).value();
}

/// Reads numbers one after the other.
class Reader {
 public:
  explicit Reader(const std::string& bytes) : bytes_(bytes) {}
  template <class Number>
  Number next() {
    Number number{};
    REQUIRE(at_ + sizeof number <= bytes_.size());
    std::memcpy(&number, bytes_.data() + at_, sizeof number);
    at_ += sizeof number;
    return number;
  }
  void expect_floats(std::initializer_list<float> expected) {
    for (const float value : expected) CHECK(next<float>() == value);
  }
  bool at_end() const { return at_ == bytes_.size(); }

 private:
  const std::string& bytes_;
  std::size_t at_ = 0;
};

}  // namespace

TEST_CASE("a frame lies in its message as the protocol says", "[page]") {
  sheet::MeshFrame frame;
  frame.time_s = 12.25;
  frame.topology = square();
  for (int v = 0; v < 5; ++v) frame.positions_m.emplace_back(static_cast<float>(v), 0.5F, -1.0F);
  const std::vector<std::uint16_t> regions = {0, 1, 2, 3, kNoRegion};
  const std::vector<Segment> ridges = {{sheet::Vec3f(1, 2, 3), sheet::Vec3f(4, 5, 6)}},
                             rulings = {{sheet::Vec3f(7, 8, 9), sheet::Vec3f(10, 11, 12)}};
  const std::string bytes = frame_bytes(3, frame, regions, ridges, rulings);
  Reader in(bytes);
  CHECK(in.next<std::uint32_t>() == 2);
  CHECK(in.next<std::uint32_t>() == 3);
  CHECK(in.next<double>() == 12.25);
  for (const std::uint32_t count : {5U, 1U, 1U}) CHECK(in.next<std::uint32_t>() == count);
  for (int v = 0; v < 5; ++v) in.expect_floats({static_cast<float>(v), 0.5F, -1.0F});
  for (const std::uint16_t region : regions) CHECK(in.next<std::uint16_t>() == region);
  CHECK(in.next<std::uint16_t>() == 0);  // so that floats begin at a multiple of their size
  in.expect_floats({1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12});
  CHECK(in.at_end());
}

TEST_CASE("topologies, sound and obstacles lie as the protocol says", "[page]") {
  const std::string topology = topology_bytes(1, *square());
  Reader of_topology(topology);
  for (const std::uint32_t number : {1U, 1U, 5U, 2U, 0U, 1U, 2U, 0U, 2U, 3U})
    CHECK(of_topology.next<std::uint32_t>() == number);
  CHECK(of_topology.at_end());

  const std::vector<float> samples = {0.25F, -0.25F, 0.5F, -0.5F};
  const std::string sound = pcm_bytes(std::int64_t{1} << 40, 2, samples);
  Reader of_sound(sound);
  for (const std::uint32_t number : {3U, 0U}) CHECK(of_sound.next<std::uint32_t>() == number);
  CHECK(of_sound.next<std::uint64_t>() == std::uint64_t{1} << 40);
  for (const std::uint32_t number : {2U, 2U}) CHECK(of_sound.next<std::uint32_t>() == number);
  of_sound.expect_floats({0.25F, -0.25F, 0.5F, -0.5F});
  CHECK(of_sound.at_end());

  const std::vector<sheet::Vec3f> corners = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const std::vector<sheet::Triangle> faces = {{0, 1, 2}};
  const std::string obstacle = obstacle_bytes(4, corners, faces);
  Reader of_obstacle(obstacle);
  for (const std::uint32_t number : {4U, 4U, 3U, 1U}) CHECK(of_obstacle.next<std::uint32_t>() == number);
  of_obstacle.expect_floats({0, 0, 0, 1, 0, 0, 0, 1, 0});
  for (const std::uint32_t number : {0U, 1U, 2U}) CHECK(of_obstacle.next<std::uint32_t>() == number);
  CHECK(of_obstacle.at_end());
}

TEST_CASE("a hello tells rights, a notice its level", "[page]") {
  const Json hello = Json::parse(hello_text({"rustled 1", "here", 44100, 2, {true, false}, true}));
  CHECK(hello == Json::parse(R"({"type": "hello", "version": 1, "daemon": "rustled 1", "machine": "here",
      "sample_rate": 44100, "channels": 2, "rights": {"listen": true, "change": false}, "needs_key": true})"));
  // A name that is no UTF-8 breaks nothing.
  CHECK(Json::parse(notice_text("no \xff such", NoticeLevel::kError)).at("level") == "error");
  CHECK(Json::parse(notice_text("", NoticeLevel::kInfo)).at("level") == "info");
  CHECK(Json::parse(notice_text("", NoticeLevel::kWarning)).at("level") == "warning");
}

TEST_CASE("figures tell only losses that were, and silence as null", "[page]") {
  Figures figures;
  figures.load_level = 2;
  SessionFigures session;
  session.id = "a";
  session.frames_dropped = {{"backlog", 3}, {"late", 0}};
  session.gains = {{-6, {}, {}, ""},
                   {-std::numeric_limits<double>::infinity(), {}, synthesis::SoundKind::kTearing, ""},
                   {-9, 3, {}, ""},
                   {-9, {}, synthesis::SoundKind::kFriction, "banknote"}};
  figures.sessions.push_back(session);
  session.id = "b";
  session.level = {1, 50, 200};
  figures.sessions.push_back(session);
  const std::vector<Rights> rights = {{true, true}};  // of the second nothing is known
  OwnFigures own;
  own.latency_p50_s = 0.002;
  const Json told = Json::parse(figures_text(figures, own, rights));
  CHECK(told.at("load_level_name") == "fewer voices");
  CHECK(told.at("latency_ms") == Json({{"p50", 2.0}, {"p99", nullptr}}));
  const Json &silent = told.at("sessions").at(0), &loud = told.at("sessions").at(1);
  CHECK(silent.at("frames").at("dropped") == Json({{"backlog", 3}}));
  CHECK(silent.at("peak_db").is_null());
  CHECK(silent.at("rms_db").is_null());
  CHECK(silent.at("gains_db") == Json({{"master", -6.0}, {"tearing", nullptr}}));
  CHECK(silent.at("rights") == Json({{"listen", true}, {"change", true}}));
  CHECK(loud.at("peak_db") == 0.0);
  CHECK(loud.at("rms_db").get<double>() == Approx(-6.02).margin(0.01));
  CHECK(loud.at("rights") == Json({{"listen", false}, {"change", false}}));
}

TEST_CASE("a quantile lies in the range that holds it", "[page]") {
  session::DurationHistogram::Counts counts;
  CHECK_FALSE(quantile_s(counts, 0.5));
  counts.in_range[3] = 100;  // 50 to 100 us
  CHECK(*quantile_s(counts, 0.5) == Approx(75e-6));
  CHECK(*quantile_s(counts, 1) == Approx(100e-6));
  counts.in_range.back() = 100;  // beyond the last end
  CHECK(*quantile_s(counts, 0.99) == 1.0);
}

TEST_CASE("a scene tells every obstacle's shape and place", "[page]") {
  scene::SceneUpdate update;
  const std::vector<scene::Shape> shapes = {scene::PlaneShape{}, scene::BoxShape{{1, 2, 3}}, scene::SphereShape{4},
                                            scene::CapsuleShape{5, 6},
                                            scene::MeshShape{{{0, 1, 2}}, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}};
  for (const auto& shape : shapes) {
    scene::Obstacle obstacle;
    obstacle.id = static_cast<std::uint32_t>(10 + update.obstacles.size());
    obstacle.shape = shape;
    obstacle.pose.position_m = {0, 0, 1};
    update.obstacles.push_back(obstacle);
  }
  scene::SceneState state;
  REQUIRE(state.apply(update));
  engine::Surroundings around{std::make_shared<const scene::SceneState>(state), scene::Listener{}, {}, 0};
  around.sheets.resize(2);
  around.sheets[1].id = 7;
  around.sheets[1].material = "banknote";
  const std::vector<SheetSize> sizes = {{3, 1}};
  const Json told = Json::parse(scene_text("s", around, sizes));
  CHECK(told.at("listener") == Json({{"position", {0.0, 0.0, 0.0}}, {"forward", nullptr}, {"up", {0.0, 0.0, 1.0}}}));
  const Json& obstacles = told.at("obstacles");
  REQUIRE(obstacles.size() == 5);
  std::vector<std::string> kinds;
  for (const Json& obstacle : obstacles) {
    kinds.push_back(obstacle.at("kind"));
    CHECK(obstacle.at("position") == Json({0.0, 0.0, 1.0}));
    CHECK(obstacle.at("orientation") == Json({1.0, 0.0, 0.0, 0.0}));
  }
  CHECK(kinds == std::vector<std::string>{"plane", "box", "sphere", "capsule", "mesh"});
  CHECK(obstacles.at(1).at("half_extents") == Json({1.0, 2.0, 3.0}));
  CHECK(obstacles.at(3).at("radius") == 5.0);
  CHECK(obstacles.at(3).at("half_length") == 6.0);
  CHECK(obstacles.at(4).at("mesh") == true);
  CHECK(told.at("sheets").at(0).at("triangles") == 1);
  CHECK(told.at("sheets").at(1) ==
        Json({{"index", 1}, {"id", 7}, {"name", ""}, {"material", "banknote"}, {"vertices", 0}, {"triangles", 0}}));
}

}  // namespace page_encode_test
