#include <cstring>

#include <catch2/catch.hpp>

#include "server/wire/control.h"
#include "tests/unit/wire/messages.h"

namespace damage_test {

using namespace rustle;
using namespace rustle::wire;
using namespace rustle::wire::test;

namespace {

/// splitmix64
struct Generator {
  std::uint64_t state;
  std::uint64_t next() {
    std::uint64_t z = (state += 0x9e3779b97f4a7c15ull);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return z ^ (z >> 31);
  }
  std::size_t below(std::size_t bound) { return static_cast<std::size_t>(next() % bound); }
};

bool finite(const sheet::Vec3f& v) {
  return v.allFinite() && v.cwiseAbs().maxCoeff() <= 1e5f;
}
bool finite(const sheet::Vec3d& v) {
  return v.allFinite();
}

struct Sound {
  bool operator()(const engine::SheetDescription&) const { return true; }
  bool operator()(const sheet::MeshFrame& frame) const {
    bool good = std::isfinite(frame.time_s) && frame.topology && frame.positions_m.size() == frame.topology->vertex_count();
    for (const auto& p : frame.positions_m) good &= finite(p);
    for (const auto& v : frame.velocities_m_per_s) good &= finite(v);
    good &= frame.velocities_m_per_s.empty() || frame.velocities_m_per_s.size() == frame.positions_m.size();
    good &= frame.anchored.empty() || frame.anchored.size() == frame.positions_m.size();
    if (frame.contacts)
      for (const auto& contact : *frame.contacts) {
        good &= contact.vertex < frame.positions_m.size();
        if (contact.slip_velocity_m_per_s) good &= finite(*contact.slip_velocity_m_per_s);
        if (contact.normal_force_n) good &= *contact.normal_force_n >= 0;
      }
    if (frame.partition) {
      good &= frame.partition->triangle_regions.size() == frame.topology->triangle_count();
      for (const auto region : frame.partition->triangle_regions)
        good &= region == sheet::kNone || region < frame.partition->region_curved.size();
      for (const auto& ruling : frame.partition->rulings) good &= finite(ruling.start_m) && finite(ruling.end_m);
    }
    for (const auto& tip : frame.tear_tips) good &= finite(tip.position_m) && tip.speed_m_per_s >= 0;
    return good;
  }
  bool operator()(const scene::SceneUpdate& update) const {
    bool good = std::isfinite(update.time_s);
    for (const auto& obstacle : update.obstacles) {
      good &= finite(obstacle.pose.position_m) && std::abs(obstacle.pose.orientation.norm() - 1) < 1e-9;
      if (const auto* mesh = std::get_if<scene::MeshShape>(&obstacle.shape)) {
        for (const auto& triangle : mesh->triangles)
          for (const auto vertex : triangle) good &= vertex < mesh->vertices_m.size();
        for (const auto& v : mesh->vertices_m) good &= finite(v);
      }
    }
    for (const auto& pose : update.poses) good &= std::abs(pose.pose.orientation.norm() - 1) < 1e-9;
    for (const auto& vertices : update.vertices)
      for (const auto& v : vertices.vertices_m) good &= finite(v);
    return good;
  }
  bool operator()(const scene::Listener& listener) const {
    return finite(listener.position_m) && std::abs(listener.up.norm() - 1) < 1e-9;
  }
  // Come by control and not in the stream.
  bool operator()(const engine::GainChange&) const { return false; }
  bool operator()(const engine::PackChange&) const { return false; }
  bool operator()(const engine::PackReload&) const { return false; }
  bool operator()(const engine::LoadLevel&) const { return false; }
  bool operator()(const engine::ListenerMove&) const { return false; }
  bool operator()(const engine::TearTips& tips) const {
    bool good = std::isfinite(tips.time_s);
    for (const auto& tip : tips.tips) good &= finite(tip.position_m);
    return good;
  }
  bool operator()(const engine::Advance& advance) const { return std::isfinite(advance.time_s); }
  bool operator()(const engine::End& end) const { return !end.time_s || std::isfinite(*end.time_s); }
};

Decoder knowing() {
  session::SessionOptions options;
  options.up_axis = session::UpAxis::kY;
  options.metres_per_unit = 0.01;
  Decoder decoder = ready(options);
  static_cast<void>(decode(decoder, mesh_obstacle_message(5)));
  return decoder;
}

/// One of every kind, with every field set.
std::vector<std::string> full_messages() {
  std::vector<v1::StreamMessage> messages;
  auto frame_sent = frame_message(1.25);
  frame_sent.set_sequence(3);
  auto* frame = frame_sent.mutable_frame();
  frame->set_velocities(pack(kPositions));
  frame->set_anchored(std::string("\1\0\0\1", 4));
  auto* contacts = frame->mutable_contacts();
  contacts->add_partner_table()->set_obstacle_id(5);
  contacts->add_partner_table()->set_sheet_id(1);
  contacts->set_vertices(pack<std::uint32_t>({0, 3}));
  contacts->set_partners(pack<std::uint32_t>({0, 1}));
  contacts->set_slip_velocities(pack(std::vector<float>(6, 0.5f)));
  contacts->set_normal_forces(pack(std::vector<float>(2, 0.5f)));
  auto* partition = frame->mutable_partition();
  partition->set_triangle_regions(pack<std::uint32_t>({1, 0}));
  partition->set_region_curved(std::string("\0\1", 2));
  partition->set_rulings(pack(std::vector<float>(6, 0.25f)));
  partition->set_ruling_regions(pack<std::uint32_t>({1}));
  partition->set_singular_points(pack(std::vector<float>(3, 0.25f)));
  auto* tip = frame->add_tear_tips();
  set(tip->mutable_position(), 1, 2, 3);
  set(tip->mutable_direction(), 1, 2, 3);
  messages.push_back(frame_sent);
  auto topology = topology_message(8);
  topology.mutable_topology()->set_material_coordinates(pack(std::vector<float>(8, 0.5f)));
  topology.mutable_topology()->set_rest_positions(pack(kPositions));
  messages.push_back(topology);
  auto scene = mesh_obstacle_message(6);
  set(add_obstacle(scene, 7)->mutable_box()->mutable_half_extents(), 1, 2, 3);
  set(add_obstacle(scene, 8)->mutable_plane()->mutable_normal(), 1, 2, 3);
  auto* pose = scene.mutable_scene()->add_poses();
  pose->set_obstacle_id(5);
  pose->mutable_pose()->mutable_orientation()->set_w(1);
  pose->mutable_pose()->mutable_orientation()->set_x(1);
  auto* vertices = scene.mutable_scene()->add_vertices();
  vertices->set_obstacle_id(5);
  vertices->set_vertices(pack(kPositions));
  messages.push_back(scene);
  auto listener = message();
  set(listener.mutable_listener()->mutable_position(), 1, 2, 3);
  set(listener.mutable_listener()->mutable_up(), 1, 2, 3);
  messages.push_back(listener);
  messages.push_back(sheet_message(4));
  auto tips = message();
  tips.mutable_tear_tips()->set_sheet_id(1);
  set(tips.mutable_tear_tips()->add_tips()->mutable_position(), 1, 2, 3);
  messages.push_back(tips);
  auto advance = message();
  advance.mutable_advance()->set_time_s(3);
  messages.push_back(advance);
  std::vector<std::string> out;
  for (const auto& m : messages) out.push_back(m.SerializeAsString());
  return out;
}

/// True when refused or sound.
bool survives(const std::string& bytes, bool* taken = nullptr) {
  Decoder decoder = knowing();
  // A copy without room to spare, so that a sanitizer sees every byte read beyond it.
  const std::vector<std::byte> exact(as_bytes(bytes).begin(), as_bytes(bytes).end());
  const auto envelope = StreamEnvelope::parse(exact, "s");
  if (!envelope) return !envelope.error().message.empty();
  const auto decoded = decoder.decode(*envelope);
  if (!decoded) return !decoded.error().message.empty() && !decoded.error().remedy.empty();
  if (taken != nullptr) *taken = true;
  return !decoded->item || std::visit(Sound{}, *decoded->item);
}

}  // namespace

TEST_CASE("the messages that are damaged below are good when whole", "[wire][damage]") {
  for (const std::string& bytes : full_messages()) {
    bool taken = false;
    CHECK(survives(bytes, &taken));
    CHECK(taken);
  }
}

TEST_CASE("a message cut anywhere is refused or sound", "[wire][damage]") {
  for (const std::string& bytes : full_messages())
    for (std::size_t size = 0; size < bytes.size(); ++size) REQUIRE(survives(bytes.substr(0, size)));
}

TEST_CASE("a message with flipped bytes is refused or sound", "[wire][damage]") {
  Generator generator{20240611};
  const auto messages = full_messages();
  std::size_t taken_count = 0;
  for (int round = 0; round < 20'000; ++round) {
    std::string bytes = messages[generator.below(messages.size())];
    const std::size_t flips = 1 + generator.below(4);
    for (std::size_t k = 0; k < flips; ++k)
      bytes[generator.below(bytes.size())] ^= static_cast<char>(1 + generator.below(255));
    bool taken = false;
    REQUIRE(survives(bytes, &taken));
    taken_count += taken;
  }
  // Most flips hit payloads, so the checks behind the parser were reached.
  CHECK(taken_count > 2'000);
  CHECK(taken_count < 19'000);
}

TEST_CASE("floats of every bit pattern in positions are refused or sound", "[wire][damage]") {
  Generator generator{7};
  for (int round = 0; round < 5'000; ++round) {
    auto sent = frame_message(1);
    auto positions = kPositions;
    const auto bits = static_cast<std::uint32_t>(generator.next());
    std::memcpy(&positions[generator.below(12)], &bits, 4);
    sent.mutable_frame()->set_positions(pack(positions));
    REQUIRE(survives(sent.SerializeAsString()));
  }
}

TEST_CASE("damaged control requests are refused or read", "[wire][damage]") {
  v1::ControlRequest request;
  request.set_request_id(5);
  request.set_session_id("s");
  auto* attach = request.mutable_attach();
  attach->set_name("name");
  attach->mutable_options()->set_metres_per_unit(0.01);
  attach->mutable_options()->set_playout_delay_s(0.1);
  attach->add_sheets()->set_thickness_m(1e-4);
  const std::string bytes = request.SerializeAsString();
  REQUIRE(decode_control(as_bytes(bytes)).has_value());
  for (std::size_t size = 0; size < bytes.size(); ++size)
    if (const auto read = decode_control(as_bytes(bytes.substr(0, size))); !read)
      CHECK_FALSE(read.error().error.message.empty());
  Generator generator{3};
  for (int round = 0; round < 10'000; ++round) {
    std::string flipped = bytes;
    flipped[generator.below(flipped.size())] ^= static_cast<char>(1 + generator.below(255));
    const auto read = decode_control(as_bytes(flipped));
    if (!read) continue;
    if (const auto* body = std::get_if<AttachRequest>(&read->body)) {
      REQUIRE(body->options.metres_per_unit > 0);
      REQUIRE(std::isfinite(body->options.metres_per_unit));
    }
  }
}

}  // namespace damage_test
