#include "client_sdk/c/rustle.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <string>
#include <thread>
#include <vector>

#include "client_sdk/c/from_plain.h"

namespace client = rustle::client;
using rustle::capi::read;

namespace {

void check_error(rustle_status status, const std::string& field) {
  CAPTURE(field);
  CHECK(status == RUSTLE_INVALID_ARGUMENT);
  const rustle_error& error = *rustle_last_error();
  CHECK(error.status == status);
  CHECK(error.code == 0);
  CHECK(error.code_name == std::string("invalid"));
  CHECK(error.field == field);
  CHECK(std::string(error.message).ends_with('.'));
  CHECK(std::string(error.remedy).ends_with('.'));
}

}  // namespace

TEST_CASE("A handle or pointer that is NULL is an error, or nothing") {
  rustle_connection* const connection = nullptr;
  rustle_session* const session = nullptr;
  rustle_reader* const reader = nullptr;
  check_error(rustle_connect(nullptr, nullptr), "connection");
  check_error(rustle_check(connection), "connection");
  check_error(rustle_get_server(connection, nullptr), "connection");
  check_error(rustle_attach(connection, nullptr, nullptr), "connection");
  check_error(rustle_listen_to(connection, nullptr, nullptr, 0, nullptr), "connection");
  check_error(rustle_detach(session, 0), "session");
  check_error(rustle_set_send_timeout(session, 1), "session");
  check_error(rustle_add_sheet(session, nullptr), "session");
  check_error(rustle_add_topology(session, nullptr), "session");
  check_error(rustle_frame(session, nullptr), "session");
  check_error(rustle_set_obstacles(session, 0, nullptr, 0), "session");
  check_error(rustle_move_obstacle(session, 0, 1, nullptr), "session");
  check_error(rustle_deform_obstacle(session, 0, 1, nullptr, 0), "session");
  check_error(rustle_remove_obstacle(session, 0, 1), "session");
  check_error(rustle_set_listener(session, 0, nullptr, nullptr, nullptr), "session");
  check_error(rustle_tear_tips(session, 1, 0, nullptr, 0), "session");
  check_error(rustle_advance(session, 0), "session");
  check_error(rustle_end(session, nullptr), "session");
  check_error(rustle_send_raw(session, nullptr, 0), "session");
  check_error(rustle_drain(session, 0), "session");
  check_error(rustle_next_notice(session, nullptr), "session");
  check_error(rustle_get_progress(session, nullptr), "session");
  check_error(rustle_statistics(session, nullptr, nullptr), "session");
  check_error(rustle_set_gains(session, nullptr, 0), "session");
  check_error(rustle_change_pack(session, 1, nullptr, nullptr), "session");
  check_error(rustle_start_recording(session, nullptr), "session");
  check_error(rustle_stop_recording(session), "session");
  check_error(rustle_listen(session, nullptr, nullptr), "session");
  check_error(rustle_next_block(reader, 0, nullptr), "reader");
  check_error(rustle_read_all(reader, 0, nullptr), "reader");
  check_error(rustle_observe(session, nullptr), "session");
  check_error(rustle_next_observation(nullptr, 0, nullptr), "observer");
  rustle_disconnect(connection);
  rustle_free_session(session);
  rustle_free_reader(reader);
  rustle_free_observer(nullptr);
  CHECK(rustle_missing_samples(reader) == 0);
  CHECK(rustle_session_id(session) == std::string());
  CHECK(rustle_recording_file_name(session) == std::string());
  CHECK(rustle_session_rate_hz(session) == 0);
  CHECK(rustle_figure_named(nullptr, 0, "frames_analysed") == 0);
}

TEST_CASE("The last error is each thread's own, and stays until the next") {
  check_error(rustle_check(nullptr), "connection");
  std::thread([] {
    CHECK(rustle_last_error()->status == RUSTLE_OK);
    CHECK(rustle_last_error()->message == std::string());
    check_error(rustle_advance(nullptr, 0), "session");
  }).join();
  CHECK(rustle_last_error()->field == std::string("connection"));
}

TEST_CASE("Nobody at the endpoint is unreachable, keys that are not there are named") {
  rustle_connection* connection = nullptr;
  rustle_endpoints endpoints{};
  endpoints.control = "ipc:///tmp/rustle-nobody-listens-here";
  endpoints.timeout_s = 0.05;
  CHECK(rustle_connect(&endpoints, &connection) == RUSTLE_UNREACHABLE);
  CHECK(std::string(rustle_last_error()->message).find("rustle-nobody") != std::string::npos);
  endpoints.keys_folder = "/nowhere";
  CHECK(rustle_connect(&endpoints, &connection) == RUSTLE_INVALID_ARGUMENT);
  CHECK(std::string(rustle_last_error()->field).find("/nowhere") != std::string::npos);
  CHECK(connection == nullptr);
}

TEST_CASE("Structs of zeros are the defaults of C++") {
  const auto options = read(rustle_session_options{});
  REQUIRE(options);
  CHECK(options->clock == client::Clock::kLive);
  CHECK(options->channels == client::Channels::kStereo);
  CHECK(options->mode == client::SynthesisMode::kCorrected);
  CHECK(options->metres_per_unit == 1);
  CHECK(!options->playout_delay_s);
  CHECK(options->sheets.empty());
  const auto sheet = read(rustle_sheet{});
  REQUIRE(sheet);
  CHECK(!sheet->grammage_kg_per_m2);
  CHECK(!sheet->thickness_m);
  CHECK(read(static_cast<const rustle_listen_options*>(nullptr))->blocks == 4);
  const rustle_listen_options listen{};
  CHECK(read(&listen)->blocks == 4);
  CHECK(!read(&listen)->queue_messages);
  const auto plane = read(rustle_obstacle{});
  REQUIRE(plane);
  CHECK(std::get<client::Plane>(plane->shape).normal == client::Vector3{0, 0, 1});
  CHECK(plane->pose.orientation == client::Quaternion{1, 0, 0, 0});
  CHECK(plane->reflection_coefficient == 1);
  const auto gain = read(rustle_gain{});
  REQUIRE(gain);
  CHECK(!gain->sheet_id);
  CHECK(!gain->kind);
}

TEST_CASE("What is said in C arrives in C++") {
  const rustle_sheet sheets[] = {{7, RUSTLE_CLOTH, "shirt", "cotton", "skin", 0.12, 3e-4}};
  rustle_session_options options{};
  options.name = "stage";
  options.clock = RUSTLE_CLOCK_SIMULATION;
  options.up_axis = RUSTLE_UP_Y;
  options.channels = RUSTLE_BINAURAL;
  options.sets_playout_delay = 1;
  options.playout_delay_s = 0;
  options.metres_per_unit = 0.01;
  options.sheets = sheets;
  options.sheet_count = 1;
  const auto taken = read(options);
  REQUIRE(taken);
  CHECK(taken->name == "stage");
  CHECK(taken->clock == client::Clock::kSimulation);
  CHECK(taken->up_axis == client::UpAxis::kY);
  CHECK(taken->channels == client::Channels::kBinaural);
  CHECK(taken->playout_delay_s == 0.0);
  CHECK(taken->metres_per_unit == 0.01);
  REQUIRE(taken->sheets.size() == 1);
  CHECK(taken->sheets[0].kind == client::SheetKind::kCloth);
  CHECK(taken->sheets[0].touched_surface == "skin");
  CHECK(taken->sheets[0].thickness_m == 3e-4);

  rustle_listen_options listen{RUSTLE_STEM, 7, RUSTLE_TEARING, RUSTLE_S16, 2, -1};
  const auto stem = read(&listen);
  REQUIRE(stem);
  CHECK(std::get<client::StemContent>(stem->content).sheet_id == 7);
  CHECK(std::get<client::StemContent>(stem->content).kind == client::SoundKind::kTearing);
  CHECK(stem->format == client::SampleFormat::kS16);
  CHECK(stem->blocks == 2);
  CHECK(stem->queue_messages == 0);  // no limit

  const std::uint32_t vertices[] = {3, 5}, partners[] = {0, 1};
  const rustle_contact_partner table[] = {{0, 9}, {1, 2}};
  const float slips[] = {1, 2, 3, 4, 5, 6}, forces[] = {0.5f, 0.25f};
  const rustle_contacts contacts{2, vertices, partners, table, 2, slips, forces};
  const rustle_tear_tip tip{4, {1, 2, 3}, 0.5, 1, {0, 1, 0}};
  rustle_mesh_frame frame{};
  const std::uint32_t regions[] = {0, 1, 1}, ruling_regions[] = {1};
  const std::uint8_t curved[] = {0, 1};
  const float ruling[6] = {0, 0, 0, 1, 0, 0};
  const rustle_partition partition{regions, 3, curved, 2, ruling, ruling_regions, 1, nullptr, nullptr, 0};
  frame.contacts = &contacts;
  frame.partition = &partition;
  frame.tear_tips = &tip;
  frame.tear_tip_count = 1;
  client::FrameExtras extras;
  std::vector<client::TearTip> tips;
  REQUIRE(read(frame, 8, extras, tips));
  REQUIRE(extras.contacts);
  CHECK(extras.contacts->vertices.size() == 2);
  CHECK(extras.contacts->partner_table[1].is_sheet);
  CHECK(extras.contacts->slip_velocities.size() == 6);
  CHECK(extras.contacts->normal_forces[1] == 0.25f);
  REQUIRE(extras.tear_tips.size() == 1);
  CHECK(extras.tear_tips[0].direction == client::Vector3{0, 1, 0});
  CHECK(extras.velocities.empty());
  REQUIRE(extras.partition);
  CHECK(extras.partition->triangle_regions.size() == 3);
  CHECK(extras.partition->rulings.size() == 6);
  CHECK(extras.partition->singular_points.empty());
}

TEST_CASE("Numbers that are no constants and arrays that are not there are named") {
  const auto field_of = [](const auto& result) { return result ? std::string() : result.error().field; };
  rustle_session_options options{};
  options.clock = static_cast<rustle_clock>(2);
  CHECK(field_of(read(options)) == "options.clock");
  options = {};
  options.sheet_count = 1;
  CHECK(field_of(read(options)) == "options.sheets");
  rustle_listen_options listen{};
  listen.content = RUSTLE_STEM;
  CHECK(field_of(read(&listen)) == "options.stem_kind");
  rustle_topology topology{};
  topology.triangle_count = 1;
  CHECK(field_of(read(topology)) == "topology.triangles");
  rustle_obstacle obstacle{};
  obstacle.shape = static_cast<rustle_shape>(-1);
  CHECK(field_of(read(obstacle)) == "obstacle.shape");
  obstacle.shape = RUSTLE_MESH;
  obstacle.vertex_count = 3;
  CHECK(field_of(read(obstacle)) == "obstacle.vertices");
  rustle_contacts contacts{};
  contacts.count = 1;
  rustle_mesh_frame frame{};
  frame.contacts = &contacts;
  client::FrameExtras extras;
  std::vector<client::TearTip> tips;
  CHECK(field_of(read(frame, 1, extras, tips)) == "frame.contacts.vertices");
  rustle_partition partition{};
  partition.singular_count = 1;
  frame = {};
  frame.partition = &partition;
  CHECK(field_of(read(frame, 1, extras, tips)) == "frame.partition.singular_points");
}

TEST_CASE("Seconds are milliseconds, rounded up, within what a clock can count") {
  using rustle::capi::milliseconds;
  CHECK(milliseconds(0.0101).count() == 11);
  CHECK(milliseconds(-1).count() == 0);
  CHECK(milliseconds(std::nan("")).count() == 0);
  CHECK(milliseconds(INFINITY).count() == 1'000'000'000'000);
}
