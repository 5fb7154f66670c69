#include <cstring>
#include <memory>
#include <set>

#include <unistd.h>

#include <catch2/catch.hpp>

#include "client_sdk/cpp/session.h"
#include "server/wire/decode.h"
#include "tests/unit/client/fake_daemon.h"

namespace session_test {

using namespace rustle::client;
using namespace rustle::client::test;
using namespace std::chrono_literals;
namespace v1 = rustle::v1;
namespace wire = rustle::wire;

namespace {

const std::vector<std::uint32_t> kTriangles = {0, 1, 2};
const std::vector<float> kPositions = {0, 0, 0, 1, 0, 0, 0, 1, 0};

Connection connect(const FakeDaemon& daemon, std::chrono::milliseconds timeout = 5s) {
  Endpoints endpoints;
  endpoints.control = daemon.control();
  auto connection = Connection::connect(endpoints, timeout);
  if (!connection) FAIL(to_string(connection.error()));
  return *connection;
}

Session attach(const Connection& connection, Clock clock, const AttachOptions& how = {}) {
  SessionOptions options;
  options.name = "test";
  options.clock = clock;
  options.sheets = {SheetOptions{}};
  auto session = Session::attach(connection, options, how);
  if (!session) FAIL(to_string(session.error()));
  return std::move(*session);
}

Topology topology() {
  return {.id = 7, .vertex_count = 3, .triangles = kTriangles};
}

}  // namespace

TEST_CASE("a daemon that is not there is an error that says so", "[client]") {
  Endpoints endpoints;
  endpoints.control = "ipc:///tmp/rustle-test-nobody-serves-this";
  const auto connection = Connection::connect(endpoints, 50ms);
  REQUIRE_FALSE(connection.has_value());
  CHECK(connection.error().code_name == "unreachable");
  CHECK(connection.error().message.find(endpoints.control) != std::string::npos);
  CHECK_FALSE(connection.error().remedy.empty());

  endpoints.control = "nonsense";
  CHECK(Connection::connect(endpoints, 50ms).error().code_name == "invalid");
}

TEST_CASE("a daemon that does not answer is an error that says so", "[client]") {
  FakeDaemon daemon({.answers = false});
  Endpoints endpoints;
  endpoints.control = daemon.control();
  CHECK(Connection::connect(endpoints, 100ms).error().code_name == "unreachable");
}

TEST_CASE("questions and answers on the control socket", "[client]") {
  FakeDaemon daemon({});
  const Connection connection = connect(daemon);
  CHECK(connection.server().server == "fake");
  CHECK(connection.server().rate_hz == 48'000);
  CHECK(connection.ping().has_value());
  CHECK(connection.list_packs()->at(0).models.size() == 2);
  CHECK(connection.list_sessions()->at(0).clock == Clock::kSimulation);
  CHECK(connection.statistics("x")->session_id == "x");
  const auto gains =
      connection.set_gains("x", {{.gain_db = -3, .sheet_id = 2, .kind = SoundKind::kFriction, .material = "m"}});
  REQUIRE(gains.has_value());
  CHECK(gains->at(0).gain_db == -3);
  CHECK(gains->at(0).sheet_id == 2u);
  CHECK(gains->at(0).kind == SoundKind::kFriction);
  const auto pack = connection.change_pack("x", 2, "kraft", "glass");
  REQUIRE(pack.has_value());
  CHECK(pack->material == "kraft");
  CHECK(pack->touched_surface == "glass");
  const auto packs = connection.reload_pack("kraft");
  REQUIRE(packs.has_value());
  REQUIRE(packs->size() == 2);
  CHECK(packs->at(0).name == "kraft");
}

TEST_CASE("questions from several threads get their own answers", "[client]") {
  FakeDaemon daemon({});
  const Connection connection = connect(daemon);
  std::atomic<int> right{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (int k = 0; k < 50; ++k) {
        const std::string id = std::to_string(100 * t + k);
        const auto answer = connection.statistics(id);
        right += answer.has_value() && answer->session_id == id;
      }
    });
  for (auto& thread : threads) thread.join();
  CHECK(right == 200);
}

TEST_CASE("over ipc too", "[client]") {
  FakeDaemon daemon({}, "ipc:///tmp/rustle-test-client-" + std::to_string(::getpid()));
  CHECK(connect(daemon).ping().has_value());
}

TEST_CASE("what attach is refused for comes back whole", "[client]") {
  FakeDaemon daemon({.error_on_attach = "There is no pack for \"gold leaf\"."});
  const auto session = Session::attach(connect(daemon), {});
  REQUIRE_FALSE(session.has_value());
  CHECK(session.error().code == v1::ERROR_CODE_UNKNOWN_MATERIAL);
  CHECK(session.error().code_name == "unknown_material");
  CHECK(session.error().field == "attach.sheets[0].material");
  CHECK(session.error().message.find("gold leaf") != std::string::npos);
  CHECK(session.error().remedy == "Choose another.");
}

TEST_CASE("a daemon that only connects out cannot be attached to", "[client]") {
  FakeDaemon daemon({.takes_streams = false});
  CHECK(Session::attach(connect(daemon), {}).error().code_name == "invalid");
}

TEST_CASE("attach waits for the daemon's subscription", "[client]") {
  FakeDaemon daemon({});
  SECTION("so that the first message arrives, every time") {
    const Connection connection = connect(daemon);
    for (std::size_t round = 1; round <= 20; ++round) {
      Session session = attach(connection, Clock::kLive);
      REQUIRE(session.advance(static_cast<double>(round)).has_value());
      REQUIRE(daemon.wait_until([&] { return daemon.received_count() == round; }));
      CHECK(daemon.received().back().sequence() == 1);
      CHECK(daemon.received().back().advance().time_s() == static_cast<double>(round));
    }
  }
  SECTION("and gives up when none comes") {
    // Something listens there, but it is no subscriber.
    Endpoints endpoints;
    endpoints.control = daemon.control();
    endpoints.stream = daemon.out();
    const auto connection = Connection::connect(endpoints, 300ms);
    REQUIRE(connection.has_value());
    const auto session = Session::attach(*connection, {});
    REQUIRE_FALSE(session.has_value());
    CHECK(session.error().code_name == "timeout");
    CHECK(daemon.wait_until([&] { return daemon.asked().back() == "detach s1"; }));
  }
}

TEST_CASE("everything a session says arrives as it was said, in order", "[client]") {
  FakeDaemon daemon({});
  Session session = attach(connect(daemon), Clock::kSimulation);
  CHECK(session.id() == "s1");
  CHECK(session.options().block_size == 128);

  REQUIRE(session.add_sheet({.id = 2, .name = "flag", .kind = SheetKind::kCloth}).has_value());
  REQUIRE(session.add_topology(topology()).has_value());
  SceneUpdate scene;
  scene.time_s = 0.5;
  scene.obstacles.push_back({.id = 1, .name = "table", .reflecting = true, .shape = Plane{.point = {0, 0, -1}}});
  scene.obstacles.push_back({.id = 2, .shape = Mesh{.triangles = kTriangles, .vertices = kPositions}});
  scene.obstacles.push_back({.id = 3, .shape = Capsule{.radius = 1, .half_length = 2}, .pose = {.position = {1, 2, 3}}});
  scene.vertices.emplace_back(2, kPositions);
  REQUIRE(session.scene(scene).has_value());
  REQUIRE(session.listener({.time_s = 0.5, .position = {1, 2, 3}, .forward = Vector3{0, 1, 0}, .up = {}}).has_value());

  FrameExtras extras;
  const std::vector<std::uint8_t> held = {1, 0, 0};
  const std::vector<std::uint32_t> touching = {2}, partners = {0};
  const std::vector<float> forces = {1.5f};
  extras.velocities = kPositions;
  extras.anchored = held;
  extras.contacts = Contacts{
      .vertices = touching, .partners = partners, .partner_table = {{.is_sheet = false, .id = 2}}, .normal_forces = forces};
  const std::vector<TearTip> tips = {{.id = 1, .position = {0, 1, 0}, .speed = 2, .direction = Vector3{1, 0, 0}}};
  extras.tear_tips = tips;
  REQUIRE(session.frame(2, 7, 1.0, kPositions, extras).has_value());
  REQUIRE(session.tear_tips(2, 1.5, tips).has_value());
  REQUIRE(session.advance(2).has_value());
  REQUIRE(session.end().has_value());
  REQUIRE(session.drain(10s).has_value());

  const auto received = daemon.received();
  REQUIRE(received.size() == 8);
  // The daemon's own decoder takes every one of them.
  wire::Decoder decoder{rustle::session::SessionOptions{}};
  for (std::size_t k = 0; k < received.size(); ++k) {
    CHECK(received[k].sequence() == k + 1);
    CHECK(received[k].session_id() == "s1");
    CHECK(received[k].sent_at_s() > 0);
    const std::string bytes = received[k].SerializeAsString();
    const auto envelope = wire::StreamEnvelope::parse(std::as_bytes(std::span(bytes)), "s1");
    REQUIRE(envelope.has_value());
    const auto decoded = decoder.decode(*envelope);
    if (!decoded) FAIL(wire::to_string(decoded.error()));
  }
  CHECK(received[4].frame().positions().size() == 36);
  CHECK(std::memcmp(received[4].frame().positions().data(), kPositions.data(), 36) == 0);
  CHECK(received[4].frame().contacts().partner_table(0).obstacle_id() == 2);
  CHECK(session.sent_messages() == 8);
  CHECK(session.acknowledged_sequence() == 8);
}

TEST_CASE("mistakes that can be seen on this side are told on this side", "[client]") {
  FakeDaemon daemon({});
  Session session = attach(connect(daemon), Clock::kLive);
  CHECK(session.frame(1, 7, 0, kPositions).error().field == "frame.topology_id");
  REQUIRE(session.add_topology(topology()).has_value());
  const std::vector<float> short_positions(6);
  CHECK(session.frame(1, 7, 0, short_positions).error().field == "frame.positions");
  CHECK(session.sent_messages() == 1);
}

TEST_CASE("with the simulation clock a session waits for credit", "[client]") {
  FakeDaemon daemon({.window_messages = 4, .acknowledges = false});
  Session session = attach(connect(daemon), Clock::kSimulation);
  session.set_send_timeout(100ms);
  REQUIRE(session.add_topology(topology()).has_value());
  for (int k = 0; k < 3; ++k) REQUIRE(session.frame(1, 7, k, kPositions).has_value());

  const auto refused = session.frame(1, 7, 3, kPositions);
  REQUIRE_FALSE(refused.has_value());
  CHECK(refused.error().code_name == "timeout");
  REQUIRE(daemon.wait_until([&] { return daemon.received_count() == 4; }));
  CHECK_FALSE(session.drain(50ms).has_value());

  daemon.acknowledge(2);
  session.set_send_timeout(10s);
  CHECK(session.frame(1, 7, 3, kPositions).has_value());
  CHECK(session.frame(1, 7, 4, kPositions).has_value());
  session.set_send_timeout(50ms);
  CHECK_FALSE(session.frame(1, 7, 5, kPositions).has_value());
  CHECK(session.acknowledged_sequence() == 2);

  // A credit that comes while frame() waits lets it go on.
  session.set_send_timeout(10s);
  std::thread later([&] {
    std::this_thread::sleep_for(30ms);
    daemon.acknowledge(6);
  });
  CHECK(session.frame(1, 7, 5, kPositions).has_value());
  later.join();
  REQUIRE(daemon.wait_until([&] { return daemon.received_count() == 7; }));
  // What was refused was not sent, and took no number.
  for (std::size_t k = 0; k < 7; ++k) CHECK(daemon.received()[k].sequence() == k + 1);
}

TEST_CASE("the window may be bytes too, and one message always fits", "[client]") {
  FakeDaemon daemon({.window_messages = 100, .window_bytes = 200, .acknowledges = false});
  Session session = attach(connect(daemon), Clock::kSimulation);
  session.set_send_timeout(50ms);
  std::vector<float> large(3000);
  std::vector<std::uint32_t> triangles = {0, 1, 999};
  REQUIRE(session.add_topology({.id = 1, .vertex_count = 1000, .triangles = triangles}).has_value());
  CHECK_FALSE(session.frame(1, 1, 0, large).has_value());
  daemon.acknowledge(1);
  session.set_send_timeout(10s);
  CHECK(session.frame(1, 1, 0, large).has_value());
  session.set_send_timeout(50ms);
  CHECK_FALSE(session.advance(1).has_value());
}

TEST_CASE("a thousand frames with a small window arrive whole and in order", "[client]") {
  FakeDaemon daemon({.window_messages = 4});
  Session session = attach(connect(daemon), Clock::kSimulation);
  REQUIRE(session.add_topology(topology()).has_value());
  for (int k = 0; k < 1000; ++k) REQUIRE(session.frame(1, 7, k, kPositions).has_value());
  REQUIRE(session.drain(10s).has_value());
  const auto received = daemon.received();
  REQUIRE(received.size() == 1001);
  for (std::size_t k = 0; k < received.size(); ++k) REQUIRE(received[k].sequence() == k + 1);
}

TEST_CASE("with the live clock frame() never waits: it drops and counts", "[client]") {
  FakeDaemon daemon({});
  Session session = attach(connect(daemon), Clock::kLive);
  constexpr std::uint32_t kVertices = 20'000;
  const std::vector<float> large(std::size_t{3} * kVertices);
  REQUIRE(session.add_topology({.id = 1, .vertex_count = kVertices, .triangles = kTriangles}).has_value());
  REQUIRE(daemon.wait_until([&] { return daemon.received_count() == 1; }));
  daemon.set_running(false);  // nobody reads: 240 kB a frame soon fill the daemon's queue, the sockets' buffers and ours
  int queued = 0, dropped = 0;
  for (int k = 0; k < 2'500 && dropped < 5; ++k) {
    const auto sent = session.frame(1, 1, k, large);
    REQUIRE(sent.has_value());
    (*sent == Sent::kQueued ? queued : dropped) += 1;
  }
  CHECK(dropped == 5);
  CHECK(session.dropped_messages() == 5);
  CHECK(session.next_sequence() == static_cast<std::uint64_t>(queued + dropped + 2));
  daemon.set_running(true);
  REQUIRE(daemon.wait_until([&] { return daemon.received_count() == static_cast<std::size_t>(queued) + 1; }));
}

TEST_CASE("raw messages get the session's id, and a number of their own unless it is kept", "[client]") {
  FakeDaemon daemon({});
  Session session = attach(connect(daemon), Clock::kSimulation);
  v1::StreamMessage captured;
  captured.set_session_id("somebody else's");
  captured.set_sequence(41);
  captured.set_sent_at_s(5);
  captured.mutable_advance()->set_time_s(3);
  const std::string bytes = captured.SerializeAsString();
  REQUIRE(session.raw(std::as_bytes(std::span(bytes))).has_value());
  REQUIRE(session.raw(std::as_bytes(std::span(bytes)), {.keep_sequence = true}).has_value());
  REQUIRE(session.advance(4).has_value());
  REQUIRE(session.drain(10s).has_value());
  const auto received = daemon.received();
  REQUIRE(received.size() == 3);
  CHECK(received[0].session_id() == "s1");
  CHECK(received[0].sequence() == 1);
  CHECK(received[1].session_id() == "s1");
  CHECK(received[1].sequence() == 41);
  CHECK(received[1].sent_at_s() == 5);
  CHECK(received[2].sequence() == 42);
  CHECK(session.raw(std::as_bytes(std::span("\xff\xff"))).error().field == "stream_message");
}

TEST_CASE("notices come to their session", "[client]") {
  FakeDaemon daemon({});
  Session session = attach(connect(daemon), Clock::kLive);
  CHECK(session.poll_notices().empty());
  wire::Error error;
  error.code = wire::ErrorCode::kNotFinite;
  error.field = "frame.positions";
  error.message = "Vertex 3 is nan.";
  error.remedy = "Stop there.";
  error.sequence = 12;
  daemon.post(wire::notices_topic("s1"),
              wire::encode_notice({.session_id = "s1", .sequence = 1}, wire::notice_of(error, 2)));
  std::vector<Notice> notices;
  REQUIRE(daemon.wait_until([&] { return !(notices = session.poll_notices()).empty(); }));
  CHECK(notices[0].level == NoticeLevel::kError);
  CHECK(notices[0].code == "not_finite");
  CHECK(notices[0].field == "frame.positions");
  CHECK(notices[0].remedy == "Stop there.");
  CHECK(notices[0].sequence == 12);
  CHECK(notices[0].count == 2);
  CHECK(session.poll_notices().empty());
}

TEST_CASE("notices are told to who asked for it, by the session's own calls", "[client]") {
  FakeDaemon daemon({});
  std::vector<Notice> told;
  Session session = attach(connect(daemon), Clock::kLive,
                           {.reconnect = {}, .on_notice = [&](const Notice& notice) { told.push_back(notice); }});
  wire::Error error;
  error.code = wire::ErrorCode::kNotFinite;
  error.field = "frame.positions";
  error.message = "Vertex 3 is nan.";
  error.remedy = "Stop there.";
  daemon.post(wire::notices_topic("s1"),
              wire::encode_notice({.session_id = "s1", .sequence = 1}, wire::notice_of(error, 2)));
  REQUIRE(daemon.wait_until([&] { return session.advance(1).has_value() && !told.empty(); }));
  CHECK(told.size() == 1);
  CHECK(to_string(told[0]) == "not_finite in frame.positions: Vertex 3 is nan. Stop there. (2 times)");
  CHECK(session.poll_notices().size() == 1);
}

TEST_CASE("kinds of errors", "[client]") {
  const auto kind = [](int code, const char* name) { return kind_of({.code = code, .code_name = name}); };
  CHECK(kind(0, "invalid") == ErrorKind::kInvalidArgument);
  CHECK(kind(0, "unreachable") == ErrorKind::kUnreachable);
  CHECK(kind(0, "timeout") == ErrorKind::kTimedOut);
  CHECK(kind(0, "closed") == ErrorKind::kClosed);
  CHECK(kind(0, "malformed") == ErrorKind::kOther);
  CHECK(kind(0, "idle") == ErrorKind::kSessionLost);
  CHECK(kind(v1::ERROR_CODE_UNKNOWN_SESSION, "unknown_session") == ErrorKind::kSessionLost);
  CHECK(kind(v1::ERROR_CODE_UNKNOWN_MATERIAL, "unknown_material") == ErrorKind::kRefused);
}

TEST_CASE("a session is detached once, by itself if need be", "[client]") {
  FakeDaemon daemon({});
  const Connection connection = connect(daemon);
  {
    Session session = attach(connection, Clock::kLive);
    const auto statistics = session.detach();
    REQUIRE(statistics.has_value());
    CHECK(statistics->frames_dropped.at("late") == 2);
    CHECK(session.advance(1).error().code_name == "closed");
  }
  CHECK(connection.ping().has_value());
  const auto detaches = [&] {
    int count = 0;
    for (const auto& what : daemon.asked()) count += what == "detach s1";
    return count;
  };
  CHECK(detaches() == 1);
  {
    Session session = attach(connection, Clock::kLive);
    Session moved = std::move(session);
    CHECK(moved.advance(1).has_value());
  }
  CHECK(daemon.wait_until([&] { return detaches() == 2; }));
  // The answer to that stays unread; later questions still get theirs.
  CHECK(connection.ping().has_value());
  CHECK(connection.statistics("z")->session_id == "z");
}

TEST_CASE("a daemon that goes away is noticed, and named", "[client]") {
  const std::string control = "ipc:///tmp/rustle-test-gone-" + std::to_string(::getpid());
  auto daemon = std::make_unique<FakeDaemon>(FakeDaemon::Behaviour{.window_messages = 2, .acknowledges = false}, control);
  const Connection connection = connect(*daemon);
  // Without being noticed its end would be an hour's wait.
  const auto ends_by_itself = [&](auto&& call) {
    daemon.reset();
    const auto result = call();
    REQUIRE_FALSE(result.has_value());
    CHECK(result.error().code_name == "unreachable");
    CHECK(result.error().message.find(control) != std::string::npos);
    CHECK(result.error().remedy.find("start it again") != std::string::npos);
    CHECK(result.error().remedy.find("set_send_timeout") == std::string::npos);
  };
  CHECK(connection.check().has_value());
  SECTION("while frames wait for credit") {
    Session session = attach(connection, Clock::kSimulation);
    session.set_send_timeout(1h);
    REQUIRE(session.add_topology(topology()).has_value());
    REQUIRE(session.frame(1, 7, 0, kPositions).has_value());
    ends_by_itself([&] { return session.frame(1, 7, 1, kPositions); });
  }
  SECTION("while the last messages wait for their acknowledgement") {
    Session session = attach(connection, Clock::kSimulation);
    REQUIRE(session.add_topology(topology()).has_value());
    ends_by_itself([&] { return session.drain(1h); });
  }
  SECTION("by live frames, which wait for nothing") {
    Session session = attach(connection, Clock::kLive, {.reconnect = false});
    REQUIRE(session.add_topology(topology()).has_value());
    ends_by_itself([&] {
      SendResult sent = session.frame(1, 7, 0, kPositions);
      for (int k = 1; sent && k < 10'000; ++k) {
        std::this_thread::sleep_for(1ms);
        sent = session.frame(1, 7, k, kPositions);
      }
      return sent;
    });
  }
  SECTION("by who only asks") {
    daemon.reset();
    bool gone = false;
    for (int k = 0; k < 10'000 && !gone; ++k) {
      std::this_thread::sleep_for(1ms);
      gone = !connection.check();
    }
    CHECK(gone);
    CHECK(connection.ping().error().code_name == "unreachable");
  }
}

TEST_CASE("a daemon that was started anew does not know the session", "[client]") {
  const std::string control = "ipc:///tmp/rustle-test-anew-" + std::to_string(::getpid());
  auto daemon = std::make_unique<FakeDaemon>(FakeDaemon::Behaviour{.window_messages = 2, .acknowledges = false}, control);
  const Connection connection = connect(*daemon);
  Session session = attach(connection, Clock::kSimulation);
  session.set_send_timeout(1h);
  REQUIRE(session.add_topology(topology()).has_value());
  REQUIRE(session.frame(1, 7, 0, kPositions).has_value());
  daemon.reset();
  daemon = std::make_unique<FakeDaemon>(FakeDaemon::Behaviour{.knows_sessions = false}, control);
  const auto sent = session.frame(1, 7, 1, kPositions);
  REQUIRE_FALSE(sent.has_value());
  CHECK((sent.error().code_name == "unknown_session" || sent.error().code_name == "unreachable"));
}

TEST_CASE("a session that the daemon ended takes no more messages", "[client]") {
  FakeDaemon daemon({});
  Session session = attach(connect(daemon), Clock::kLive, {.reconnect = false});
  wire::Error error;
  error.code = wire::ErrorCode::kIdle;
  error.field = "stream";
  error.message = "Nothing came for 300 s.";
  error.remedy = "Attach again.";
  daemon.post(wire::notices_topic("s1"), wire::encode_notice({.session_id = "s1", .sequence = 1}, wire::notice_of(error)));
  std::vector<Notice> notices;
  REQUIRE(daemon.wait_until([&] { return !(notices = session.poll_notices()).empty(); }));
  const auto sent = session.advance(1);
  REQUIRE_FALSE(sent.has_value());
  CHECK(sent.error().code_name == "idle");
  CHECK(sent.error().remedy == "Attach again.");
  CHECK(kind_of(sent.error()) == ErrorKind::kSessionLost);
}

TEST_CASE("who detaches says what was sent last", "[client]") {
  FakeDaemon daemon({});
  {
    Session session = attach(connect(daemon), Clock::kLive);
    for (int k = 1; k <= 3; ++k) REQUIRE(session.advance(k).has_value());
    REQUIRE(session.detach().has_value());
    CHECK(daemon.last_sequence() == 3);
  }
  {
    Session session = attach(connect(daemon), Clock::kLive);
    REQUIRE(session.advance(1).has_value());
  }
  CHECK(daemon.wait_until([&] { return daemon.last_sequence() == 1; }));
}

TEST_CASE("every figure of the statistics has its name and value", "[client]") {
  Statistics statistics;
  statistics.voices_stolen = 3;
  statistics.clock_drift_ppm = -4.5;
  std::set<std::string> names;
  for (const Figure& figure : figures(statistics)) {
    names.insert(figure.name);
    if (figure.name == "voices_stolen") CHECK(std::get<std::uint64_t>(figure.value) == 3);
    if (figure.name == "clock_drift_ppm") CHECK(std::get<double>(figure.value) == -4.5);
  }
  CHECK(names.contains("samples_in_gaps"));
  CHECK(names.size() == static_cast<std::size_t>(v1::Statistics::descriptor()->field_count()) - 2);
}

}  // namespace session_test
