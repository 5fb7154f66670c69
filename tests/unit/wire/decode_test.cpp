#include <chrono>
#include <limits>

#include <catch2/catch.hpp>

#include "server/wire/fields.h"
#include "tests/unit/wire/messages.h"

namespace decode_test {

using namespace rustle;
using namespace rustle::wire;
using namespace rustle::wire::test;
using sheet::Vec3f;

namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

void require_error(const tl::expected<Decoded, Error>& decoded, ErrorCode code, const std::string& field) {
  REQUIRE_FALSE(decoded.has_value());
  CHECK(code_name(decoded.error().code) == code_name(code));
  CHECK(decoded.error().field == field);
  CHECK_FALSE(decoded.error().message.empty());
  CHECK_FALSE(decoded.error().remedy.empty());
}

bool mentions(const Error& error, const std::string& text) {
  return error.message.find(text) != std::string::npos;
}

session::SessionOptions centimetres_y_up() {
  session::SessionOptions options;
  options.metres_per_unit = 0.01;
  options.up_axis = session::UpAxis::kY;
  return options;
}

}  // namespace

TEST_CASE("a frame comes through as it was sent", "[wire][decode]") {
  Decoder decoder = ready();
  auto sent = frame_message(1.25);
  sent.set_sequence(42);
  sent.set_sent_at_s(3.5);
  auto* frame = sent.mutable_frame();
  std::vector<float> velocities(12);
  for (std::size_t i = 0; i < velocities.size(); ++i) velocities[i] = 0.5f * static_cast<float>(i) - 2;
  frame->set_velocities(pack(velocities));
  frame->set_anchored(std::string("\1\0\0\1", 4));
  frame->set_reset_history(true);
  auto* tip = frame->add_tear_tips();
  tip->set_tip_id(9);
  set(tip->mutable_position(), 1, 2, 3);
  tip->set_speed(0.5);
  set(tip->mutable_direction(), 0, 0, 4);

  const auto decoded = decode(decoder, sent);
  REQUIRE(decoded.has_value());
  CHECK(decoded->sequence == 42);
  CHECK(decoded->sent_at_s == 3.5);
  const auto& read = item_of<sheet::MeshFrame>(decoded);
  CHECK(read.sheet == 1);
  CHECK(read.time_s == 1.25);
  CHECK(read.topology->id() == 7);
  REQUIRE(read.positions_m.size() == kVertices);
  for (std::size_t v = 0; v < kVertices; ++v) {
    CHECK(read.positions_m[v] == Vec3f(kPositions[3 * v], kPositions[3 * v + 1], kPositions[3 * v + 2]));
    CHECK(read.velocities_m_per_s[v] == Vec3f(velocities[3 * v], velocities[3 * v + 1], velocities[3 * v + 2]));
  }
  CHECK(read.anchored == std::vector<bool>{true, false, false, true});
  CHECK(read.reset_history);
  CHECK_FALSE(read.contacts.has_value());
  CHECK_FALSE(read.partition.has_value());
  REQUIRE(read.tear_tips.size() == 1);
  CHECK(read.tear_tips[0].tip_id == 9);
  CHECK(read.tear_tips[0].speed_m_per_s == 0.5f);
  CHECK(*read.tear_tips[0].direction == Vec3f(0, 0, 1));
}

TEST_CASE("frames of one topology share it", "[wire][decode]") {
  Decoder decoder = ready();
  const auto first = decode(decoder, frame_message(0)), second = decode(decoder, frame_message(1));
  CHECK(item_of<sheet::MeshFrame>(first).topology == item_of<sheet::MeshFrame>(second).topology);
}

TEST_CASE("an unaligned payload decodes to the same positions", "[wire][decode]") {
  const std::string bytes = frame_message(1).SerializeAsString();
  for (std::size_t shift = 0; shift < 8; ++shift) {
    std::string moved(shift, 'x');
    moved += bytes;
    const auto envelope = StreamEnvelope::parse(as_bytes(moved).subspan(shift), "");
    REQUIRE(envelope.has_value());
    Decoder decoder = ready();
    const auto decoded = decoder.decode(*envelope);
    REQUIRE(decoded.has_value());
    CHECK(item_of<sheet::MeshFrame>(decoded).positions_m[2] == Vec3f(1, 2, 0.25f));
  }
}

TEST_CASE("centimetres and y up become metres and z up", "[wire][decode]") {
  Decoder decoder(centimetres_y_up());
  REQUIRE(decode(decoder, sheet_message()).has_value());
  auto topology = topology_message();
  topology.mutable_topology()->set_material_coordinates(pack<float>({0, 0, 100, 0, 100, 200, 0, 200}));
  topology.mutable_topology()->set_rest_positions(pack<float>({0, 0, 0, 100, 0, 0, 100, 200, 0, 0, 200, 0}));
  REQUIRE(decode(decoder, topology).has_value());
  auto scene = mesh_obstacle_message(5);
  REQUIRE(decode(decoder, scene).has_value());

  auto sent = frame_message(1);
  auto* frame = sent.mutable_frame();
  frame->set_positions(pack<float>({1, 2, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
  frame->set_velocities(pack<float>({10, 20, 30, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
  auto* contacts = frame->mutable_contacts();
  contacts->set_vertices(pack<std::uint32_t>({2}));
  contacts->set_partners(pack<std::uint32_t>({0}));
  contacts->add_partner_table()->set_obstacle_id(5);
  contacts->set_slip_velocities(pack<float>({100, 200, 300}));
  contacts->set_normal_forces(pack<float>({2}));
  auto* tip = frame->add_tear_tips();
  set(tip->mutable_position(), 1, 2, 3);
  tip->set_speed(50);
  set(tip->mutable_direction(), 0, 1, 0);
  const auto decoded = decode(decoder, sent);
  REQUIRE(decoded.has_value());
  const auto& read = item_of<sheet::MeshFrame>(decoded);
  CHECK((read.positions_m[0] - Vec3f(0.01f, -0.03f, 0.02f)).norm() < 1e-7f);
  CHECK((read.velocities_m_per_s[0] - Vec3f(0.1f, -0.3f, 0.2f)).norm() < 1e-6f);
  CHECK((*read.contacts->at(0).slip_velocity_m_per_s - Vec3f(1, -3, 2)).norm() < 1e-5f);
  CHECK(*read.contacts->at(0).normal_force_n == 2);
  CHECK((read.tear_tips[0].position_m - Vec3f(0.01f, -0.03f, 0.02f)).norm() < 1e-7f);
  CHECK(read.tear_tips[0].speed_m_per_s == Approx(0.5));
  CHECK(*read.tear_tips[0].direction == Vec3f(0, 0, 1));
  CHECK((read.topology->material_coordinates_m()[2] - sheet::Vec2f(1, 2)).norm() < 1e-6f);
  CHECK((read.topology->rest_positions_m()[2] - Vec3f(1, 0, 2)).norm() < 1e-6f);

  auto listener = message();
  set(listener.mutable_listener()->mutable_position(), 100, 200, 300);
  set(listener.mutable_listener()->mutable_forward(), 0, 0, -2);
  const auto heard = decode(decoder, listener);
  CHECK((item_of<scene::Listener>(heard).position_m - sheet::Vec3d(1, -3, 2)).norm() < 1e-12);
  CHECK((*item_of<scene::Listener>(heard).forward - sheet::Vec3d(0, 1, 0)).norm() < 1e-12);
  CHECK(item_of<scene::Listener>(heard).up == sheet::Vec3d(0, 0, 1));
}

TEST_CASE("what is wrong with a frame is named", "[wire][decode]") {
  Decoder decoder = ready();
  REQUIRE(decode(decoder, frame_message(1)).has_value());
  auto sent = frame_message(2);
  auto* frame = sent.mutable_frame();

  SECTION("an unknown sheet") {
    frame->set_sheet_id(8);
    sent.set_sequence(77);
    const auto decoded = decode(decoder, sent);
    require_error(decoded, ErrorCode::kUnknownSheet, "frame.sheet_id");
    CHECK(decoded.error().sequence == 77);
  }
  SECTION("an unknown topology") {
    frame->set_topology_id(8);
    require_error(decode(decoder, sent), ErrorCode::kUnknownTopology, "frame.topology_id");
  }
  SECTION("another number of vertices") {
    frame->set_positions(pack(std::vector<float>(9)));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.positions");
  }
  SECTION("half a float") {
    frame->set_positions(frame->positions() + "ab");
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.positions");
  }
  SECTION("a position that is no number") {
    for (const float bad : {kNan, std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()}) {
      auto positions = kPositions;
      positions[7] = bad;
      frame->set_positions(pack(positions));
      const auto decoded = decode(decoder, sent);
      require_error(decoded, ErrorCode::kNotFinite, "frame.positions");
      CHECK(mentions(decoded.error(), "Vertex 2 "));
    }
  }
  SECTION("a position far away") {
    auto positions = kPositions;
    positions[11] = -2e5f;
    frame->set_positions(pack(positions));
    const auto decoded = decode(decoder, sent);
    require_error(decoded, ErrorCode::kOutOfRange, "frame.positions");
    CHECK(mentions(decoded.error(), "Vertex 3 "));
  }
  SECTION("velocities") {
    frame->set_velocities(pack(std::vector<float>(11)));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.velocities");
    frame->set_velocities(pack(std::vector<float>(12, kNan)));
    require_error(decode(decoder, sent), ErrorCode::kNotFinite, "frame.velocities");
  }
  SECTION("the mask of held vertices") {
    frame->set_anchored("abc");
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.anchored");
  }
  SECTION("time that does not increase") {
    for (const double time_s : {1.0, 0.5, -3.0}) {
      frame->set_time_s(time_s);
      require_error(decode(decoder, sent), ErrorCode::kTimeOrder, "frame.time_s");
    }
  }
  SECTION("time out of range or no number") {
    frame->set_time_s(2e10);
    require_error(decode(decoder, sent), ErrorCode::kOutOfRange, "frame.time_s");
    frame->set_time_s(std::nan(""));
    require_error(decode(decoder, sent), ErrorCode::kNotFinite, "frame.time_s");
  }
  SECTION("tear tips") {
    auto* tip = frame->add_tear_tips();
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.tear_tips[0].position");
    set(tip->mutable_position(), 0, std::nan(""), 0);
    require_error(decode(decoder, sent), ErrorCode::kNotFinite, "frame.tear_tips[0].position");
    set(tip->mutable_position(), 0, 0, 0);
    tip->set_speed(-1);
    require_error(decode(decoder, sent), ErrorCode::kOutOfRange, "frame.tear_tips[0].speed");
  }
  // What was refused left no trace: the next good frame is taken.
  CHECK(decode(decoder, frame_message(1.5)).has_value());
}

TEST_CASE("times are ordered per sheet, not across sheets", "[wire][decode]") {
  Decoder decoder = ready();
  REQUIRE(decode(decoder, sheet_message(2)).has_value());
  CHECK(decode(decoder, frame_message(5, 7, 1)).has_value());
  CHECK(decode(decoder, frame_message(1, 7, 2)).has_value());
  CHECK_FALSE(decode(decoder, frame_message(4, 7, 1)).has_value());
}

TEST_CASE("contacts", "[wire][decode]") {
  Decoder decoder = ready();
  REQUIRE(decode(decoder, mesh_obstacle_message(5)).has_value());
  auto sent = frame_message(1);
  auto* contacts = sent.mutable_frame()->mutable_contacts();
  contacts->add_partner_table()->set_obstacle_id(5);
  contacts->add_partner_table()->set_sheet_id(1);
  contacts->set_vertices(pack<std::uint32_t>({0, 3, 3}));
  contacts->set_partners(pack<std::uint32_t>({0, 1, 0}));

  SECTION("read") {
    const auto decoded = decode(decoder, sent);
    REQUIRE(decoded.has_value());
    const auto& read = *item_of<sheet::MeshFrame>(decoded).contacts;
    REQUIRE(read.size() == 3);
    CHECK(read[1].vertex == 3);
    CHECK(read[1].partner == sheet::ContactPartner(sheet::SheetPartner{1}));
    CHECK(read[2].partner == sheet::ContactPartner(sheet::ObstaclePartner{5}));
    CHECK_FALSE(read[0].slip_velocity_m_per_s.has_value());
    CHECK_FALSE(read[0].normal_force_n.has_value());
  }
  SECTION("an empty list touches nothing, which is not the same as no list") {
    contacts->Clear();
    const auto decoded = decode(decoder, sent);
    REQUIRE(item_of<sheet::MeshFrame>(decoded).contacts.has_value());
    CHECK(item_of<sheet::MeshFrame>(decoded).contacts->empty());
  }
  SECTION("vertex out of range") {
    contacts->set_vertices(pack<std::uint32_t>({0, 4, 3}));
    const auto decoded = decode(decoder, sent);
    require_error(decoded, ErrorCode::kOutOfRange, "frame.contacts.vertices");
    CHECK(mentions(decoded.error(), "Contact 1 "));
  }
  SECTION("partner out of range") {
    contacts->set_partners(pack<std::uint32_t>({0, 1, 2}));
    require_error(decode(decoder, sent), ErrorCode::kOutOfRange, "frame.contacts.partners");
  }
  SECTION("arrays of different length") {
    contacts->set_partners(pack<std::uint32_t>({0, 1}));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.contacts.partners");
    contacts->set_partners(pack<std::uint32_t>({0, 1, 0}));
    contacts->set_slip_velocities(pack(std::vector<float>(6)));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.contacts.slip_velocities");
    contacts->clear_slip_velocities();
    contacts->set_normal_forces(pack(std::vector<float>(2)));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.contacts.normal_forces");
  }
  SECTION("forces and slips that are no numbers") {
    contacts->set_normal_forces(pack<float>({0, -1, 0}));
    require_error(decode(decoder, sent), ErrorCode::kOutOfRange, "frame.contacts.normal_forces");
    contacts->set_normal_forces(pack<float>({0, kNan, 0}));
    require_error(decode(decoder, sent), ErrorCode::kNotFinite, "frame.contacts.normal_forces");
    contacts->clear_normal_forces();
    contacts->set_slip_velocities(pack(std::vector<float>(9, kNan)));
    require_error(decode(decoder, sent), ErrorCode::kNotFinite, "frame.contacts.slip_velocities");
  }
  SECTION("partners nobody knows") {
    contacts->mutable_partner_table(0)->set_obstacle_id(6);
    require_error(decode(decoder, sent), ErrorCode::kUnknownObstacle, "frame.contacts.partner_table");
    contacts->mutable_partner_table(0)->set_sheet_id(6);
    require_error(decode(decoder, sent), ErrorCode::kUnknownSheet, "frame.contacts.partner_table");
    contacts->mutable_partner_table(0)->Clear();
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.contacts.partner_table");
  }
}

TEST_CASE("the simulator's partition", "[wire][decode]") {
  Decoder decoder = ready();
  auto sent = frame_message(1);
  auto* partition = sent.mutable_frame()->mutable_partition();
  partition->set_triangle_regions(pack<std::uint32_t>({1, sheet::kNone}));
  partition->set_region_curved(std::string("\0\1", 2));
  partition->set_rulings(pack<float>({0, 0, 0, 1, 2, 3}));
  partition->set_ruling_regions(pack<std::uint32_t>({1}));
  partition->set_singular_points(pack<float>({4, 5, 6, 7, 8, 9}));
  partition->set_singular_on_border(std::string("\1\0", 2));
  SECTION("read") {
    const auto decoded = decode(decoder, sent);
    REQUIRE(decoded.has_value());
    const auto& read = *item_of<sheet::MeshFrame>(decoded).partition;
    CHECK(read.triangle_regions == std::vector<std::uint32_t>{1, sheet::kNone});
    CHECK(read.region_curved == std::vector<bool>{false, true});
    REQUIRE(read.rulings.size() == 1);
    CHECK(read.rulings[0].end_m == Vec3f(1, 2, 3));
    REQUIRE(read.singular_points.size() == 2);
    CHECK(read.singular_points[0].on_border);
    CHECK_FALSE(read.singular_points[1].on_border);
  }
  SECTION("regions out of range") {
    partition->set_triangle_regions(pack<std::uint32_t>({1, 2}));
    require_error(decode(decoder, sent), ErrorCode::kOutOfRange, "frame.partition.triangle_regions");
    partition->set_triangle_regions(pack<std::uint32_t>({1, 1}));
    partition->set_ruling_regions(pack<std::uint32_t>({sheet::kNone}));
    require_error(decode(decoder, sent), ErrorCode::kOutOfRange, "frame.partition.ruling_regions");
  }
  SECTION("wrong sizes and values") {
    partition->set_triangle_regions(pack<std::uint32_t>({1}));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.partition.triangle_regions");
    partition->set_triangle_regions(pack<std::uint32_t>({1, 0}));
    partition->set_rulings(pack<float>({0, 0, 0, 1, 2, kNan}));
    require_error(decode(decoder, sent), ErrorCode::kNotFinite, "frame.partition.rulings");
    partition->set_rulings(pack<float>({0, 0, 0, 1, 2}));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "frame.partition.rulings");
  }
}

TEST_CASE("topologies", "[wire][decode]") {
  Decoder decoder = ready();
  auto sent = topology_message(8);
  auto* topology = sent.mutable_topology();
  SECTION("an index out of range names its triangle") {
    topology->set_triangles(pack<std::uint32_t>({0, 1, 2, 0, 2, 4}));
    const auto decoded = decode(decoder, sent);
    require_error(decoded, ErrorCode::kOutOfRange, "topology.triangles");
    CHECK(mentions(decoded.error(), "Triangle 1 "));
    CHECK(mentions(decoded.error(), "vertex 4"));
  }
  SECTION("sizes") {
    topology->set_triangles(pack<std::uint32_t>({0, 1}));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "topology.triangles");
    topology->clear_triangles();
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "topology.triangles");
    topology->set_triangles(pack(kTriangles));
    topology->set_material_coordinates(pack(std::vector<float>(9)));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "topology.material_coordinates");
    topology->set_material_coordinates(pack(std::vector<float>(8, kNan)));
    require_error(decode(decoder, sent), ErrorCode::kNotFinite, "topology.material_coordinates");
    topology->clear_material_coordinates();
    topology->set_rest_positions(pack(std::vector<float>(12, 1e6f)));
    require_error(decode(decoder, sent), ErrorCode::kOutOfRange, "topology.rest_positions");
  }
  SECTION("too many vertices or triangles") {
    Limits limits;
    limits.vertices = 3;
    Decoder strict({}, limits);
    require_error(decode(strict, sent), ErrorCode::kTooLarge, "topology.vertex_count");
    limits.vertices = 4;
    limits.triangles = 1;
    Decoder stricter({}, limits);
    require_error(decode(stricter, sent), ErrorCode::kTooLarge, "topology.triangles");
  }
  SECTION("sent again it is the same, with other content it is refused") {
    REQUIRE(decode(decoder, topology_message(7)).has_value());
    CHECK(decoder.topology_count() == 1);
    auto other = topology_message(7);
    other.mutable_topology()->set_triangles(pack<std::uint32_t>({0, 1, 3, 1, 2, 3}));
    require_error(decode(decoder, other), ErrorCode::kMalformed, "topology.topology_id");
  }
}

TEST_CASE("replaced topologies go, those in use and those sent ahead stay", "[wire][decode]") {
  Limits limits;
  limits.replaced_topologies = 4;
  limits.waiting_topologies = 8;
  Decoder decoder({}, limits);
  REQUIRE(decode(decoder, sheet_message(1)).has_value());
  REQUIRE(decode(decoder, sheet_message(2)).has_value());
  REQUIRE(decode(decoder, topology_message(1000)).has_value());
  REQUIRE(decode(decoder, frame_message(0, 1000, 2)).has_value());
  for (std::uint64_t k = 1; k <= 100; ++k) {
    REQUIRE(decode(decoder, topology_message(k)).has_value());
    REQUIRE(decode(decoder, frame_message(static_cast<double>(k), k, 1)).has_value());
  }
  CHECK(decoder.topology_count() == 6);  // two in use, four replaced
  CHECK(decode(decoder, frame_message(1, 1000, 2)).has_value());
  CHECK(decode(decoder, frame_message(200, 97, 1)).has_value());
  CHECK_FALSE(decode(decoder, frame_message(201, 90, 1)).has_value());

  for (std::uint64_t k = 2001; k <= 2008; ++k) REQUIRE(decode(decoder, topology_message(k)).has_value());
  for (std::uint64_t k = 2001; k <= 2008; ++k)
    CHECK(decode(decoder, frame_message(static_cast<double>(k), k, 1)).has_value());
}

TEST_CASE("held topologies are bounded by their triangles", "[wire][decode]") {
  Limits limits;
  limits.kept_triangles = 20;
  Decoder decoder({}, limits);
  for (std::uint64_t k = 1; k <= 100; ++k) REQUIRE(decode(decoder, topology_message(k)).has_value());
  CHECK(decoder.topology_count() == 10);
}

TEST_CASE("sheets", "[wire][decode]") {
  Decoder decoder{session::SessionOptions{}};
  auto sent = sheet_message(3);
  auto* sheet = sent.mutable_sheet();
  sheet->set_name("flag");
  sheet->set_kind(v1::SHEET_KIND_CLOTH);
  sheet->set_grammage_kg_per_m2(0.08);
  SECTION("described once, changed once") {
    const auto decoded = decode(decoder, sent);
    const auto& read = item_of<engine::SheetDescription>(decoded);
    CHECK(read.id == 3);
    CHECK(read.name == "flag");
    CHECK(read.kind == engine::SheetKind::kCloth);
    CHECK(*read.grammage_kg_per_m2 == 0.08);
    CHECK_FALSE(read.thickness_m.has_value());
    CHECK_FALSE(decode(decoder, sent)->item.has_value());
    sheet->set_material("tracing-paper");
    CHECK(decode(decoder, sent)->item.has_value());
    CHECK(decoder.sheet_count() == 1);
  }
  SECTION("texts, numbers and kinds") {
    sheet->set_name(std::string(257, 'a'));
    require_error(decode(decoder, sent), ErrorCode::kTooLarge, "sheet.name");
    sheet->set_name("a\nb");
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "sheet.name");
    sheet->set_name("");
    sheet->set_thickness_m(-1);
    require_error(decode(decoder, sent), ErrorCode::kOutOfRange, "sheet.thickness_m");
    sheet->clear_thickness_m();
    sheet->set_kind(static_cast<v1::SheetKind>(9));
    require_error(decode(decoder, sent), ErrorCode::kUnsupported, "sheet.kind");
  }
  SECTION("too many") {
    for (std::uint32_t k = 0; k < 64; ++k) REQUIRE(decode(decoder, sheet_message(k)).has_value());
    require_error(decode(decoder, sheet_message(64)), ErrorCode::kTooLarge, "sheet.sheet_id");
  }
}

TEST_CASE("tear tips, advance and end", "[wire][decode]") {
  Decoder decoder = ready();
  REQUIRE(decode(decoder, frame_message(1)).has_value());
  auto tips = message();
  tips.mutable_tear_tips()->set_sheet_id(1);
  tips.mutable_tear_tips()->set_time_s(0.5);
  set(tips.mutable_tear_tips()->add_tips()->mutable_position(), 1, 2, 3);
  require_error(decode(decoder, tips), ErrorCode::kTimeOrder, "tear_tips.time_s");
  tips.mutable_tear_tips()->set_time_s(1.5);
  const auto torn = decode(decoder, tips);
  CHECK(item_of<engine::TearTips>(torn).tips.size() == 1);
  tips.mutable_tear_tips()->set_sheet_id(9);
  require_error(decode(decoder, tips), ErrorCode::kUnknownSheet, "tear_tips.sheet_id");

  auto advance = message();
  advance.mutable_advance()->set_time_s(3);
  CHECK(item_of<engine::Advance>(decode(decoder, advance)).time_s == 3);
  CHECK_FALSE(decode(decoder, advance)->item.has_value());
  advance.mutable_advance()->set_time_s(std::nan(""));
  require_error(decode(decoder, advance), ErrorCode::kNotFinite, "advance.time_s");

  auto end = message();
  end.mutable_end();
  CHECK_FALSE(item_of<engine::End>(decode(decoder, end)).time_s.has_value());
  require_error(decode(decoder, frame_message(9)), ErrorCode::kTimeOrder, "body");
}

TEST_CASE("envelopes", "[wire][decode]") {
  auto sent = frame_message(1.5);
  sent.set_sequence(3);
  const auto parse = [&](const std::string& topic) {
    return StreamEnvelope::parse(as_bytes(sent.SerializeAsString()), topic);
  };
  SECTION("the session comes from the message or the topic") {
    CHECK(parse("")->session_id() == "s");
    CHECK(parse("s")->session_id() == "s");
    CHECK(parse("t").error().field == "session_id");
    CHECK(parse("t").error().sequence == 3);
    sent.clear_session_id();
    CHECK(parse("t")->session_id() == "t");
    CHECK_FALSE(parse("").has_value());
    CHECK_FALSE(parse("a/b").has_value());
  }
  SECTION("what it is about, without decoding") {
    const auto envelope = parse("");
    CHECK(envelope->body() == StreamEnvelope::Body::kFrame);
    CHECK(envelope->sheet_id() == 1u);
    CHECK(envelope->time_s() == 1.5);
  }
  SECTION("too large, no body, no protobuf") {
    Limits limits;
    limits.message_bytes = 16;
    CHECK(StreamEnvelope::parse(as_bytes(sent.SerializeAsString()), "", limits).error().code == ErrorCode::kTooLarge);
    sent.clear_body();
    CHECK(parse("").error().code == ErrorCode::kMalformed);
    CHECK(StreamEnvelope::parse(as_bytes("\xff\xff\xff"), "s").error().code == ErrorCode::kMalformed);
    std::string text("\x0a\x02\xc3\x28", 4);  // a session id that is no UTF-8
    CHECK(StreamEnvelope::parse(as_bytes(text), "").error().code == ErrorCode::kMalformed);
  }
  SECTION("an announcement carries the options") {
    sent.mutable_announcement()->set_protocol_version(1);
    sent.mutable_announcement()->mutable_options()->set_seed(99);
    CHECK(parse("")->announcement()->options.seed == 99);
    Decoder decoder = ready();
    CHECK_FALSE(decode(decoder, sent)->item.has_value());
    sent.mutable_announcement()->set_protocol_version(2);
    CHECK(parse("")->announcement().error().code == ErrorCode::kProtocolVersion);
  }
}

TEST_CASE("times go as far as a sample can still be told from the next", "[wire][decode]") {
  const Limits limits;
  constexpr double kSinceLong_s = 4e9;  // since 1970, a century from now
  CHECK(check_time(kSinceLong_s, "frame.time_s", limits).has_value());
  CHECK(std::nextafter(limits.time_s, 2 * limits.time_s) - limits.time_s < 0.5 / 192'000);
  CHECK(std::nextafter(2 * limits.time_s, 4 * limits.time_s) - 2 * limits.time_s > 0.5 / 192'000);
}

}  // namespace decode_test
