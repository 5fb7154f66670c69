#include <unistd.h>

#include <catch2/catch.hpp>

#include "client_sdk/capture/capture_writer.h"
#include "server/apps/directed_source.h"
#include "server/wire/decisions.h"

namespace directed_source_test {

namespace {

using namespace rustle;
using session::Given;

/// A recording as a daemon writes it, message by message.
class WrittenRecording {
 public:
  explicit WrittenRecording(const session::SessionOptions& options) {
    auto created = capture::CaptureWriter::create(file_);
    REQUIRE(created.has_value());
    writer_.emplace(std::move(*created));
    message(wire::encode_announcement("s", "sheet", options));
  }
  ~WrittenRecording() { std::filesystem::remove(file_); }

  void message(std::string bytes) { write("/s/any", std::move(bytes), capture::Kind::kStreamMessage); }
  void decide(const session::Decision& decision) {
    write("/s/decision", wire::encode_decision("s", ++decisions_, decision), capture::Kind::kDecision);
  }
  void sheet(std::uint32_t id) {
    message(wire::encode_sheet("s", {id, "sheet", engine::SheetKind::kPaper, "", "", {}, {}}));
  }
  void listener(double time_s) {
    v1::StreamMessage sent;
    sent.mutable_listener()->set_time_s(time_s);
    sent.mutable_listener()->mutable_position()->set_x(time_s);
    message(sent.SerializeAsString());  // names no session: its topic does
  }
  void given(std::uint64_t arrival, synthesis::SampleTime earliest, synthesis::SampleTime accepted_at,
             bool start_again = false) {
    decide(session::Step{Given{arrival, 0}, earliest, accepted_at, start_again});
  }

  apps::CaptureSource open() {
    REQUIRE(writer_->close().has_value());
    auto source = apps::CaptureSource::open(file_);
    if (!source) FAIL(source.error());
    return std::move(*source);
  }

 private:
  void write(std::string topic, std::string bytes, capture::Kind kind) {
    REQUIRE(writer_->write({std::move(topic), 0, 0, 0, std::move(bytes), kind}).has_value());
  }

  const std::filesystem::path file_ =
      std::filesystem::temp_directory_path() / ("rustle-directed-" + std::to_string(::getpid()) + ".mcap");
  std::optional<capture::CaptureWriter> writer_;
  std::uint64_t decisions_ = 0;
};

std::optional<double> listener_time(const std::optional<session::DirectedItem>& directed) {
  const auto* item = directed ? std::get_if<engine::StreamItem>(&directed->what) : nullptr;
  const auto* listener = item != nullptr ? std::get_if<scene::Listener>(item) : nullptr;
  return listener != nullptr ? std::optional(listener->time_s) : std::nullopt;
}

bool says_nothing(const std::optional<session::DirectedItem>& directed) {
  return directed && std::holds_alternative<session::RenderedTo>(directed->what);
}

session::SessionOptions live_options() {
  session::SessionOptions options;
  options.rate_hz = 48000;
  options.block_size = 128;
  return options;
}

}  // namespace

TEST_CASE("a recorded session's steps come in the order of its decisions, what was dropped does not", "[apps]") {
  WrittenRecording recording(live_options());
  recording.decide(session::RecordingBegun{0, 0, 1});
  recording.sheet(1);                                                          // 1
  recording.message(wire::encode_announcement("s", "again", live_options()));  // 2: no item, and counts
  recording.message("\xff\xff no message");                                    // 3: cannot be read, and counts
  recording.listener(1);                                                       // 4
  recording.listener(2);                                                       // 5
  recording.listener(3);                                                       // 6
  const engine::TimeMapping mapping{1, 640, 48000, 0.04};
  recording.given(1, 64, 128);
  recording.decide(session::Dropped{5, 0, "backlog"});
  recording.decide(mapping);
  recording.given(6, 192, 256, true);
  recording.given(4, 192, 320);
  recording.decide(session::Step{session::FellQuiet{}, 400, 448, false});
  recording.decide(session::Step{session::Failed{99, 0}, 448, 448, false});
  recording.decide(session::Step{session::Ended{}, 512, 576, false});
  recording.decide(session::RenderedTo{1024});

  auto source = recording.open();
  REQUIRE(source.begun().has_value());
  apps::DirectedSource steps(source);
  auto step = steps.next();
  REQUIRE(step.has_value());
  CHECK(std::holds_alternative<engine::SheetDescription>(std::get<engine::StreamItem>(step->what)));
  CHECK(step->earliest == 64);
  CHECK(step->accepted_at == 128);
  CHECK_FALSE(step->mapping.has_value());
  step = steps.next();
  CHECK(listener_time(step) == 3.0);
  CHECK(step->mapping == mapping);
  CHECK(step->start_again);
  step = steps.next();
  CHECK(listener_time(step) == 1.0);
  CHECK(step->accepted_at == 320);
  CHECK_FALSE(step->mapping.has_value());
  CHECK_FALSE(step->start_again);
  step = steps.next();
  CHECK(std::holds_alternative<session::FellQuiet>(step->what));
  step = steps.next();
  CHECK(says_nothing(step));
  CHECK(step->accepted_at == 448);
  step = steps.next();
  CHECK(std::holds_alternative<engine::End>(std::get<engine::StreamItem>(step->what)));
  step = steps.next();
  CHECK(says_nothing(step));
  CHECK(step->accepted_at == 1024);
  CHECK_FALSE(steps.next().has_value());
  CHECK(source.refused().at("malformed").count == 1);
}

TEST_CASE("a recording that began under way counts samples from its first, and begins with what held", "[apps]") {
  WrittenRecording recording(live_options());
  recording.decide(session::RecordingBegun{6400, 2, 50});
  recording.decide(engine::TimeMapping{1, 6000, 48000, 0.04});
  recording.sheet(1);
  recording.listener(1);
  recording.listener(2);            // 50
  recording.given(49, 6000, 6400);  // of before
  recording.given(50, 6464, 6528);

  auto source = recording.open();
  apps::DirectedSource steps(source);
  auto step = steps.next();
  REQUIRE(step.has_value());
  CHECK(std::holds_alternative<engine::SheetDescription>(std::get<engine::StreamItem>(step->what)));
  REQUIRE(step->mapping.has_value());
  CHECK(step->mapping->first_sample == -400);
  CHECK(step->mapping->first_time_s == 1);
  CHECK(step->earliest == 0);
  CHECK(step->accepted_at == 0);
  CHECK(listener_time(steps.next()) == 1.0);
  step = steps.next();
  CHECK(says_nothing(step));
  CHECK(step->earliest == 0);
  step = steps.next();
  CHECK(listener_time(step) == 2.0);
  CHECK(step->earliest == 64);
  CHECK(step->accepted_at == 128);
  CHECK_FALSE(steps.next().has_value());
}

TEST_CASE("a recording is a capture like any other to who asks for its items", "[apps]") {
  WrittenRecording recording(live_options());
  recording.decide(session::RecordingBegun{0, 0, 1});
  recording.sheet(1);
  recording.listener(1);
  recording.decide(session::Dropped{2, 0, "backlog"});
  recording.listener(2);
  auto source = recording.open();
  CHECK(source.options() == live_options());
  int items = 0;
  while (source.next()) ++items;
  CHECK(items == 3);
}

}  // namespace directed_source_test
