#include <spdlog/spdlog.h>
#include <unistd.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <functional>
#include <thread>

#include "client_sdk/cpp/attachment.h"
#include "client_sdk/cpp/session.h"
#include "client_sdk/sheets/demos.h"
#include "server/apps/daemon.h"

namespace daemon_test {

using namespace rustle;
using namespace std::chrono_literals;

namespace {

/// Real time, and what a test adds to it.
class ForwardClock final : public session::WallClock {
 public:
  Duration now() const override {
    return std::chrono::steady_clock::now().time_since_epoch() + std::chrono::seconds(ahead_s_.load());
  }
  void forward(int seconds) { ahead_s_ += seconds; }

 private:
  std::atomic<int> ahead_s_{0};
};

class RunningDaemon {
 public:
  explicit RunningDaemon(const std::string& name, const std::string& recordings = {}) {
    spdlog::set_level(spdlog::level::off);
    const std::string start = "ipc:///tmp/rustle-test-daemon-" + name + "-" + std::to_string(::getpid());
    apps::DaemonOptions options;
    options.sockets.control = start + "-control";
    options.sockets.stream = start + "-stream";
    options.sockets.out = start + "-out";
    options.recordings = recordings;
    control = options.sockets.control;
    auto packs = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
    auto opened = apps::Daemon::open(options, packs, clock);
    if (!opened) FAIL(opened.error());
    daemon_ = std::move(*opened);
    thread_ = std::thread([this] { daemon_->run(stop_); });
  }
  ~RunningDaemon() {
    stop_ = true;
    thread_.join();
  }

  client::Connection connect() const {
    auto connection = client::Connection::connect({control, {}, {}});
    if (!connection) FAIL(client::to_string(connection.error()));
    return *connection;
  }

  std::string control;
  const std::shared_ptr<ForwardClock> clock = std::make_shared<ForwardClock>();

 private:
  std::unique_ptr<apps::Daemon> daemon_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// Waits, at most ten seconds.
bool wait_until(const std::function<bool()>& condition) {
  for (int round = 0; round < 1000; ++round) {
    if (condition()) return true;
    std::this_thread::sleep_for(10ms);
  }
  return false;
}

client::Session attach(const client::Connection& connection, client::Clock clock, const client::AttachOptions& how = {}) {
  client::SessionOptions options;
  options.name = "sheet";
  options.clock = clock;
  options.sheets = {client::SheetOptions{}};
  auto session = client::Session::attach(connection, options, how);
  if (!session) FAIL(client::to_string(session.error()));
  return std::move(*session);
}

/// Sends the frames of a demo, the first of them at `first_s`.
void play(client::Session& session, const sheets::AnimatedSheet& sheet, int frames, double first_s = 0) {
  const auto& mesh = sheet.mesh();
  const std::size_t vertices = mesh.material_coordinates.size();
  client::Topology topology;
  topology.vertex_count = static_cast<std::uint32_t>(vertices);
  topology.triangles = {mesh.triangles.front().data(), 3 * mesh.triangles.size()};
  topology.material_coordinates = {mesh.material_coordinates.front().data(), 2 * vertices};
  REQUIRE(session.add_topology(topology).has_value());
  std::vector<float> positions(3 * vertices);
  for (int k = 0; k < frames; ++k) {
    sheet.positions(first_s + k / 60.0, positions);
    REQUIRE(session.frame(1, 1, k / 60.0, positions).has_value());
  }
}

}  // namespace

TEST_CASE("a session that falls silent is ended, and told so", "[apps]") {
  const RunningDaemon daemon("idle");
  const auto connection = daemon.connect();
  client::Session session = attach(connection, client::Clock::kLive, {.reconnect = false});
  REQUIRE(session.advance(1).has_value());
  REQUIRE(wait_until([&] { return session.statistics()->messages_received == 1; }));
  daemon.clock->forward(290);
  std::this_thread::sleep_for(100ms);
  CHECK(session.poll_notices().empty());
  CHECK(connection.list_sessions()->size() == 1);

  daemon.clock->forward(20);
  std::vector<client::Notice> notices;
  REQUIRE(wait_until([&] { return !(notices = session.poll_notices()).empty(); }));
  CHECK(notices[0].code == "idle");
  CHECK(notices[0].level == client::NoticeLevel::kError);
  CHECK(notices[0].message.find("300 s") != std::string::npos);
  CHECK_FALSE(notices[0].remedy.empty());
  CHECK(wait_until([&] { return connection.list_sessions()->empty(); }));
  CHECK(session.advance(2).error().code_name == "idle");
}

TEST_CASE("a live session whose client was killed ends soon, and one that is silent does not", "[apps]") {
  const RunningDaemon daemon("killed");
  const auto asking = daemon.connect();
  client::Session silent = attach(asking, client::Clock::kLive);
  {
    // Of a killed client the connections are gone, and nothing was said.
    rustle::v1::ControlRequest request;
    request.mutable_attach()->mutable_options()->set_clock(rustle::v1::CLOCK_LIVE);
    request.set_session_id("killed");
    REQUIRE(asking.link()->ask(request).has_value());
    auto streams = client::internal::StreamOpening::begin(*asking.link(), "killed", client::Clock::kLive);
    REQUIRE(streams.has_value());
    REQUIRE(wait_until([&] { return streams->step(); }));
  }
  std::this_thread::sleep_for(200ms);
  CHECK(asking.list_sessions()->size() == 2);
  daemon.clock->forward(15);
  REQUIRE(wait_until([&] { return asking.list_sessions()->size() == 1; }));
  CHECK(asking.list_sessions()->front().session_id == silent.id());
  CHECK(silent.advance(1).has_value());
}

TEST_CASE("the figures of a detach account for everything that was sent", "[apps]") {
  const RunningDaemon daemon("figures");
  const auto connection = daemon.connect();
  const auto sheet = sheets::make_demo("snap", 183);
  SECTION("on the simulation clock, heard") {
    client::Session session = attach(connection, client::Clock::kSimulation);
    auto pcm = session.listen();
    REQUIRE(pcm.has_value());
    play(session, *sheet, 90);
    REQUIRE(session.end().has_value());
    std::uint64_t heard = 0;
    for (bool end = false; !end;) {
      const auto block = pcm->next(20s);
      REQUIRE(block.has_value());
      end = block->end;
      heard += block->samples;
    }
    const auto figures = session.detach();
    REQUIRE(figures.has_value());
    CHECK(figures->frames_received == 90);
    CHECK(figures->frames_analysed == 90);
    CHECK(figures->samples_due == heard);
    CHECK(figures->samples_sent == heard);
    CHECK(figures->samples_in_gaps == 0);
    CHECK(figures->crumpling_events > 0);
    CHECK(figures->voices == 0);
    CHECK(figures->voices_most > 0);
    CHECK(figures->cues_dropped == 0);
  }
  SECTION("on the live clock, where the detach could overtake what was sent") {
    for (int round = 0; round < 5; ++round) {
      client::Session session = attach(connection, client::Clock::kLive);
      play(session, *sheet, 40);
      const std::uint64_t dropped = session.dropped_messages();
      const auto figures = session.detach();
      REQUIRE(figures.has_value());
      CHECK(figures->frames_received + dropped == 40);
      std::uint64_t lost = 0;
      for (const auto& [cause, frames] : figures->frames_dropped) {
        CHECK(cause == "backlog");
        lost += frames;
      }
      CHECK(figures->frames_analysed + lost == figures->frames_received);
      CHECK(figures->samples_sent == 0);  // nobody listened
    }
  }
}

TEST_CASE("a session's name is cut between characters", "[apps]") {
  const RunningDaemon daemon("name");
  const auto connection = daemon.connect();
  client::SessionOptions options;
  options.name = std::string(63, 'a') + "\u00e9\u00e9";
  const auto session = client::Session::attach(connection, options);
  REQUIRE(session.has_value());
  CHECK(session->id() == std::string(63, 'a'));
}

TEST_CASE("a session is recorded by its client's word, and told what is stored", "[apps]") {
  const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("rustle-recordings-" + std::to_string(::getpid()));
  {
    const RunningDaemon daemon("recording", folder.string());
    const auto connection = daemon.connect();
    client::SessionOptions options;
    options.name = "sheet";
    options.record = true;
    options.sheets = {client::SheetOptions{}};
    auto session = client::Session::attach(connection, options);
    REQUIRE(session.has_value());
    CHECK(session->options().record);
    CHECK(session->recording_file_name().starts_with("sheet_"));
    CHECK(session->start_recording("second").error().code_name == "unsupported");
    play(*session, *sheets::make_demo("snap", 183), 20);
    REQUIRE(wait_until([&] {
      CHECK(session->poll_notices().empty());  // takes what the daemon says
      return session->stored_sequence() + 1 == session->next_sequence();
    }));
    const auto listed = connection.list_sessions();
    REQUIRE(listed->front().recording.has_value());
    CHECK(listed->front().recording->file_name == session->recording_file_name());
    CHECK(listed->front().recording->messages > 20);
    const auto stopped = session->stop_recording();
    REQUIRE(stopped.has_value());
    CHECK(std::filesystem::file_size(folder / stopped->file_name) == stopped->bytes);
    CHECK(session->recording_file_name().empty());
    CHECK_FALSE(connection.list_sessions()->front().recording.has_value());

    const auto begun = session->start_recording("second");
    REQUIRE(begun.has_value());
    CHECK(*begun == "second.mcap");
    CHECK(session->recording_file_name() == "second.mcap");
    REQUIRE(session->detach().has_value());
    const auto ended = connection.stop_recording("sheet");
    REQUIRE(ended.has_value());
    CHECK(ended->file_name == "second.mcap");
    CHECK(connection.stop_recording("nobody").error().code_name == "unsupported");
  }
  CHECK(std::distance(std::filesystem::directory_iterator(folder), {}) == 2);
  std::filesystem::remove_all(folder);
}

}  // namespace daemon_test
