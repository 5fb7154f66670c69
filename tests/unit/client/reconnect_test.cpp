#include <memory>

#include <unistd.h>

#include <catch2/catch.hpp>

#include "client_sdk/cpp/session.h"
#include "tests/unit/client/fake_daemon.h"

namespace reconnect_test {

/// A daemon that dies and comes back: what the session does about it, what the new daemon is told, what readers mark.
using namespace rustle::client;
using namespace rustle::client::test;
using namespace std::chrono_literals;
namespace v1 = rustle::v1;
namespace wire = rustle::wire;

namespace {

const std::vector<std::uint32_t> kTriangles = {0, 1, 2};
const std::vector<float> kPositions = {0, 0, 0, 1, 0, 0, 0, 1, 0};

/// A daemon at a control endpoint of its own, which may die and come back; its other endpoints differ each time.
struct Restarting {
  const std::string control;
  std::unique_ptr<FakeDaemon> daemon;

  explicit Restarting(const std::string& name, FakeDaemon::Behaviour behaviour = {})
      : control("ipc:///tmp/rustle-test-" + name + "-" + std::to_string(::getpid())) {
    start(std::move(behaviour));
  }
  void start(FakeDaemon::Behaviour behaviour) { daemon = std::make_unique<FakeDaemon>(std::move(behaviour), control); }
  /// Dies without a word.
  void die() { daemon.reset(); }
  /// Comes back, knowing nothing.
  void come_back(FakeDaemon::Behaviour behaviour = {}) {
    behaviour.knows_sessions = false;
    start(std::move(behaviour));
  }

  Connection connect() const {
    Endpoints endpoints;
    endpoints.control = control;
    return Connection::connect(endpoints).value();
  }
};

Session attach(const Connection& connection, Clock clock, const AttachOptions& how = {}) {
  SessionOptions options;
  options.name = "test";
  options.clock = clock;
  options.seed = 5;
  options.sheets = {SheetOptions{}};
  auto session = Session::attach(connection, options, how);
  if (!session) FAIL(to_string(session.error()));
  return std::move(*session);
}

Topology topology(std::uint64_t id = 7) {
  return {.id = id, .vertex_count = 3, .triangles = kTriangles};
}

/// Sends frames as a live simulator does, at most ten seconds; no call may be refused.
bool live_until(Session& session, double& time_s, const std::function<bool()>& condition) {
  for (int round = 0; round < 5'000 && !condition(); ++round) {
    const auto sent = session.frame(1, 7, time_s += 1.0 / 60, kPositions);
    if (!sent) FAIL(to_string(sent.error()));
    std::this_thread::sleep_for(2ms);
  }
  return condition();
}

std::vector<v1::StreamMessage::BodyCase> bodies(const std::vector<v1::StreamMessage>& messages, std::size_t count) {
  std::vector<v1::StreamMessage::BodyCase> out;
  for (std::size_t k = 0; k < std::min(count, messages.size()); ++k) out.push_back(messages[k].body_case());
  return out;
}

}  // namespace

TEST_CASE("a live session goes on at a daemon that was started anew", "[client][reconnect]") {
  Restarting place("live");
  const Connection connection = place.connect();
  Session session = attach(connection, Clock::kLive);
  double time_s = 0;
  REQUIRE(session.add_topology(topology()).has_value());
  REQUIRE(session.scene({.time_s = 0, .obstacles = {{.id = 1, .shape = Plane{}}}}).has_value());
  REQUIRE(session.scene({.time_s = 0.5, .poses = {{1, {.position = {0, 0, 3}}}}}).has_value());
  REQUIRE(session.listener({.time_s = 0, .position = {1, 2, 3}}).has_value());
  REQUIRE(session.set_gains({{.gain_db = -6}}).has_value());
  REQUIRE(session.change_pack(1, "kraft").has_value());
  REQUIRE(session.frame(1, 7, time_s, kPositions) == Sent::kQueued);

  for (std::uint64_t round = 1; round <= 3; ++round) {
    place.die();
    REQUIRE(live_until(session, time_s, [&] { return !session.connected(); }));
    const std::uint64_t dropped = session.dropped_messages();
    CHECK(session.frame(1, 7, time_s, kPositions) == Sent::kDropped);
    CHECK(session.dropped_messages() == dropped + 1);
    CHECK(session.listener({.time_s = time_s, .position = {3, 2, 1}}) == Sent::kDropped);

    place.come_back();
    REQUIRE(live_until(session, time_s, [&] { return session.connected(); }));
    CHECK(session.reattached() == round);
    REQUIRE(session.frame(1, 7, time_s += 1, kPositions) == Sent::kQueued);
    const double last_s = time_s;
    REQUIRE(place.daemon->wait_until([&] {
      const auto received = place.daemon->received();
      return !received.empty() && received.back().frame().time_s() == last_s;
    }));
    const auto received = place.daemon->received();
    using Message = v1::StreamMessage;
    CHECK(bodies(received, 5) ==
          std::vector{Message::kSheet, Message::kTopology, Message::kScene, Message::kListener, Message::kFrame});
    CHECK(received[0].sheet().material() == "kraft");
    CHECK(received[2].scene().obstacles(0).pose().position().z() == 3);
    CHECK(received[3].listener().position().x() == 3);  // said while the daemon was away
    for (std::size_t k = 1; k < received.size(); ++k) CHECK(received[k].sequence() == received[k - 1].sequence() + 1);
    CHECK(place.daemon->asked_count("attach test") == 1);
    CHECK(place.daemon->asked_count("gains") == 1);
    CHECK(place.daemon->attached_materials() == std::vector<std::string>{"kraft"});
    CHECK(place.daemon->attached_options().seed == 5);
  }
  CHECK(session.detach().has_value());
}

TEST_CASE("what is said while the daemon is away is told when it is back", "[client][reconnect]") {
  const std::string ends = "ipc:///tmp/rustle-test-meanwhile-" + std::to_string(::getpid());
  FakeDaemon::Behaviour same_ends;
  same_ends.stream = ends + "-stream";
  same_ends.out = ends + "-out";
  Restarting place("meanwhile", same_ends);
  const Connection connection = place.connect();
  Session session = attach(connection, Clock::kLive);
  double time_s = 0;
  REQUIRE(session.add_topology(topology()).has_value());
  REQUIRE(session.scene({.time_s = 0, .obstacles = {{.id = 1, .shape = Plane{}}}}).has_value());
  REQUIRE(place.daemon->wait_until([&] { return place.daemon->received_count() == 2; }));
  place.die();
  REQUIRE(live_until(session, time_s, [&] { return !session.connected(); }));
  CHECK(session.add_sheet({.id = 2}) == Sent::kQueued);
  CHECK(session.add_topology(topology(8)) == Sent::kQueued);
  const auto received_of = [&](v1::StreamMessage::BodyCase body) {
    const auto received = place.daemon->received();
    return std::ranges::count(received, body, &v1::StreamMessage::body_case);
  };
  SECTION("by one that was started anew") {
    place.come_back();
    REQUIRE(live_until(session, time_s, [&] { return session.connected(); }));
    REQUIRE(place.daemon->wait_until([&] { return received_of(v1::StreamMessage::kScene) == 1; }));
    CHECK(received_of(v1::StreamMessage::kSheet) == 2);
    CHECK(received_of(v1::StreamMessage::kTopology) == 2);
    CHECK(session.reattached() == 1);
  }
  SECTION("by one that had the session all the time, and hears only what it does not know") {
    place.start(same_ends);
    REQUIRE(live_until(session, time_s, [&] { return session.connected(); }));
    CHECK(session.reattached() == 0);
    REQUIRE(live_until(session, time_s, [&] { return received_of(v1::StreamMessage::kFrame) > 0; }));
    CHECK(place.daemon->asked_count("attach test") == 0);
  }
  SECTION("however much it was: what stands is told then") {
    for (int k = 0; k < 1'000; ++k)
      REQUIRE(session.scene({.time_s = 1, .poses = {{1, {.position = {0, 0, 1.0 * k}}}}}) == Sent::kQueued);
    place.come_back();
    REQUIRE(live_until(session, time_s, [&] { return session.connected(); }));
    REQUIRE(live_until(session, time_s, [&] { return received_of(v1::StreamMessage::kFrame) > 0; }));
    CHECK(received_of(v1::StreamMessage::kScene) == 1);
  }
}

TEST_CASE("what a new daemon refuses for good is the error of every later call", "[client][reconnect]") {
  Restarting place("refuses");
  const Connection connection = place.connect();
  Session session = attach(connection, Clock::kLive);
  double time_s = 0;
  REQUIRE(session.add_topology(topology()).has_value());
  place.die();
  REQUIRE(live_until(session, time_s, [&] { return !session.connected(); }));
  place.come_back({.error_on_attach = "There is no pack for \"gold leaf\"."});
  SendResult sent = Sent::kDropped;
  for (int k = 0; k < 5'000 && sent; ++k) {
    sent = session.frame(1, 7, time_s, kPositions);
    std::this_thread::sleep_for(2ms);
  }
  for (int again = 0; again < 2; ++again) {
    REQUIRE_FALSE(sent.has_value());
    CHECK(sent.error().code == v1::ERROR_CODE_UNKNOWN_MATERIAL);
    CHECK(kind_of(sent.error()) == ErrorKind::kRefused);
    sent = session.add_topology(topology(9));
  }
}

TEST_CASE("a live session that was idle for too long begins again", "[client][reconnect]") {
  FakeDaemon daemon({});
  Endpoints endpoints;
  endpoints.control = daemon.control();
  Session session = attach(Connection::connect(endpoints).value(), Clock::kLive);
  double time_s = 0;
  REQUIRE(session.add_topology(topology()).has_value());
  daemon.forget_session();
  wire::Error error;
  error.code = wire::ErrorCode::kIdle;
  error.message = "Nothing came for 300 s.";
  daemon.post(wire::notices_topic("s1"), wire::encode_notice({.session_id = "s1", .sequence = 1}, wire::notice_of(error)));
  REQUIRE(live_until(session, time_s, [&] { return session.reattached() == 1 && session.connected(); }));
  CHECK(daemon.asked_count("attach test") == 2);
}

TEST_CASE("a simulation that asks for it goes on from what was acknowledged", "[client][reconnect]") {
  Restarting place("simulation", {.window_messages = 4, .acknowledges = false});
  const Connection connection = place.connect();
  Session session = attach(connection, Clock::kSimulation, {.reconnect = true});
  REQUIRE(session.add_topology(topology()).has_value());
  for (int k = 1; k <= 3; ++k) REQUIRE(session.frame(1, 7, 0.25 * k, kPositions).has_value());
  REQUIRE(place.daemon->wait_until([&] { return place.daemon->received_count() == 4; }));
  place.daemon->acknowledge(3);
  REQUIRE(place.daemon->wait_until([&] { return session.poll_notices().empty() && session.acknowledged_sequence() == 3; }));
  place.die();
  std::thread starter([&] {
    std::this_thread::sleep_for(100ms);
    place.come_back({.window_messages = 4});
  });
  // They wait for the daemon.
  const auto next = session.frame(1, 7, 1.0, kPositions);
  const auto drained = session.drain(10s);
  starter.join();
  REQUIRE(next.has_value());
  REQUIRE(drained.has_value());
  CHECK(session.reattached() == 1);
  CHECK(session.dropped_messages() == 0);
  const auto received = place.daemon->received();
  using Message = v1::StreamMessage;
  CHECK(bodies(received, 9) == std::vector{Message::kSheet, Message::kTopology, Message::kFrame, Message::kFrame});
  CHECK(received[2].frame().time_s() == 0.75);  // sent before, and not acknowledged
  CHECK(received[3].frame().time_s() == 1.0);
  CHECK(place.daemon->attached_options().time_origin_s == 0.5);
}

TEST_CASE("a simulation gives up waiting for a daemon after its timeout", "[client][reconnect]") {
  Restarting place("timeout", {.window_messages = 4});
  const Connection connection = place.connect();
  Session session = attach(connection, Clock::kSimulation, {.reconnect = true});
  REQUIRE(session.add_topology(topology()).has_value());
  REQUIRE(session.drain(10s).has_value());
  place.die();
  session.set_send_timeout(100ms);
  SendResult sent = Sent::kQueued;
  for (int k = 0; k < 1'000 && sent; ++k) sent = session.frame(1, 7, k, kPositions);
  REQUIRE_FALSE(sent.has_value());
  CHECK((kind_of(sent.error()) == ErrorKind::kUnreachable || kind_of(sent.error()) == ErrorKind::kTimedOut));
  CHECK(sent.error().message.find(place.control) != std::string::npos);
  // It is not lost by that.
  place.come_back({.window_messages = 1'000});
  session.set_send_timeout(10s);
  CHECK(session.frame(1, 7, 2'000, kPositions).has_value());
  CHECK(session.drain(10s).has_value());
  CHECK(session.reattached() == 1);
}

// ---- readers

namespace {

std::string pcm(std::uint64_t sequence, std::int64_t first_sample, double time_s) {
  static const std::vector<float> samples(200, 0.5f);
  return wire::encode_pcm({.session_id = "s1", .sequence = sequence},
                          {.first_sample = first_sample,
                           .rate_hz = 48'000,
                           .channels = 2,
                           .format = wire::PcmFormat::kF32,
                           .missing_samples = 0,
                           .time_s = time_s,
                           .content = wire::MixContent{}},
                          samples);
}

constexpr const char* kMix = "s1/pcm/mix/f32/4";

}  // namespace

TEST_CASE("a reader follows to the daemon that came back, and marks where it began anew", "[client][reconnect][pcm]") {
  Restarting place("reader");
  const Connection connection = place.connect();
  const bool simulation = GENERATE(true, false);
  Session session = attach(connection, simulation ? Clock::kSimulation : Clock::kLive, {.reconnect = true});
  auto reader = std::move(*session.listen());
  auto observations = std::move(*session.observe());
  CHECK(reader.is_heard());
  place.daemon->post(kMix, pcm(1, 0, 0));
  place.daemon->post(kMix, pcm(2, 100, 100 / 48'000.0));
  CHECK(reader.next(10s).has_value());
  CHECK_FALSE(reader.next(10s)->restarted);
  place.die();
  CHECK_FALSE(reader.next(300ms).has_value());
  CHECK(reader.check().has_value());  // it is waited for
  place.come_back();
  REQUIRE(place.daemon->wait_until([&] {
    CHECK(session.advance(1).has_value());
    static_cast<void>(reader.next(0ms));
    static_cast<void>(observations.next(0ms));
    return session.connected() && session.reattached() == 1 && reader.is_heard() && observations.is_heard();
  }));
  // The socket is connected; its subscription arrives soon after.
  std::optional<PcmBlock> block;
  for (std::uint64_t k = 1; k < 500 && !block; ++k) {
    place.daemon->post(kMix, pcm(k, 0, 1.0));
    block = reader.next(20ms);
  }
  REQUIRE(block.has_value());
  CHECK(block->restarted);
  CHECK(block->first_sample == 0);
  if (simulation) {
    CHECK(block->missing_samples == 48'000 - 200);
  } else {
    CHECK(block->missing_samples >= 48'000 * 3 / 10 - 100);  // at least as long as nothing was there
  }
  CHECK(reader.missing_samples() == block->missing_samples);
}

TEST_CASE("a reader whose daemon has gone says so once it has read everything", "[client][reconnect][pcm]") {
  Restarting place("gone-reader");
  const Connection connection = place.connect();
  auto reader = std::move(*PcmReader::listen(connection, "s1"));
  auto observations = std::move(*ObservationReader::listen(connection, "s1"));
  for (std::uint64_t k = 0; k < 3; ++k) place.daemon->post(kMix, pcm(k + 1, 100 * static_cast<std::int64_t>(k), 0));
  CHECK(reader.next(10s).has_value());
  CHECK(reader.check().has_value());
  std::this_thread::sleep_for(50ms);
  place.die();
  CHECK(reader.next(10s)->first_sample == 100);
  CHECK(reader.next(10s)->first_sample == 200);
  CHECK_FALSE(reader.next(1h).has_value());  // ends by itself
  CHECK(kind_of(reader.check().error()) == ErrorKind::kUnreachable);
  CHECK_FALSE(observations.next(1h).has_value());
  CHECK(kind_of(observations.check().error()) == ErrorKind::kUnreachable);
  CHECK(kind_of(reader.read_all(1h).error()) == ErrorKind::kUnreachable);
}

TEST_CASE("a whole stream in one piece, its gaps silent and named", "[client][pcm]") {
  Restarting place("whole");
  auto reader = std::move(*PcmReader::listen(place.connect(), "s1"));
  place.daemon->post(kMix, pcm(1, 100, 0));
  place.daemon->post(kMix, pcm(2, 250, 0));  // 50 lost
  CHECK(kind_of(reader.read_all(100ms).error()) == ErrorKind::kTimedOut);
  auto again = std::move(*PcmReader::listen(place.connect(), "s1"));
  place.daemon->post(kMix, pcm(3, 100, 0));
  place.daemon->post(kMix, pcm(4, 250, 0));
  place.daemon->post(kMix, wire::encode_end({.session_id = "s1", .sequence = 5}, 360));
  const auto sound = again.read_all(10s);
  REQUIRE(sound.has_value());
  CHECK(sound->first_sample == 100);
  CHECK(sound->channels == 2);
  CHECK(sound->rate_hz == 48'000);
  REQUIRE(sound->gaps.size() == 2);
  CHECK(sound->gaps[0].first == 100);
  CHECK(sound->gaps[0].samples == 50);
  CHECK(sound->gaps[1].first == 250);
  CHECK(sound->gaps[1].samples == 10);
  REQUIRE(sound->interleaved.size() == 2 * 260);
  for (std::size_t k = 0; k < 260; ++k)
    CHECK(sound->interleaved[2 * k] == ((k >= 100 && k < 150) || k >= 250 ? 0.0f : 0.5f));
}

}  // namespace reconnect_test
