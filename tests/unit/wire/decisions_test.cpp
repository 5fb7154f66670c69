#include <limits>

#include <catch2/catch.hpp>

#include "server/wire/decisions.h"
#include "server/wire/session_options.h"
#include "tests/unit/wire/messages.h"

namespace decisions_test {

using namespace rustle;
using namespace rustle::wire;
using namespace rustle::wire::test;

namespace {

constexpr auto kLargest = std::numeric_limits<std::int64_t>::max();
constexpr auto kMost = std::numeric_limits<std::uint64_t>::max();

session::Step step(decltype(session::Step::what) what, std::optional<synthesis::SampleTime> earliest = {},
                   synthesis::SampleTime accepted_at = 0, bool start_again = false) {
  return {what, earliest, accepted_at, start_again};
}

ErrorCode refusal_of(const v1::Decision& decision) {
  const auto read = decode_decision(as_bytes(decision.SerializeAsString()));
  REQUIRE_FALSE(read.has_value());
  CHECK_FALSE(read.error().remedy.empty());
  return read.error().code;
}

}  // namespace

TEST_CASE("A decision is read as it was written, to the last bit", "[wire][decisions]") {
  const session::Decision decision = GENERATE(
      session::Decision(engine::TimeMapping{}),
      session::Decision(engine::TimeMapping{0.1, -kLargest, 48000.000000000007, 0.0400000000000000008}),
      session::Decision(engine::TimeMapping{-1e10, kLargest, 5e-324, 0}), session::Decision(step(session::Given{1, 0})),
      session::Decision(step(session::Given{kMost, kMost}, kLargest, kLargest)),
      session::Decision(step(session::Given{7, 8}, 0, 0, true)), session::Decision(step(session::Given{7, 8}, -64, 128)),
      session::Decision(step(session::Failed{3, 4}, 64, 64)), session::Decision(step(session::FellQuiet{}, 192, 256)),
      session::Decision(step(session::Asked(engine::GainChange{}), 64)),
      session::Decision(step(session::Asked(engine::GainChange{
          {{.gain_db = -6.5, .sheet_id = 3, .kind = synthesis::SoundKind::kFriction, .material = "banknote"},
           {.gain_db = -std::numeric_limits<double>::infinity(), .sheet_id = {}, .kind = {}, .material = {}}}}))),
      session::Decision(step(session::Asked(engine::PackChange{2, "tracing-paper", ""}), {}, 128)),
      session::Decision(step(session::Asked(engine::PackReload{}))), session::Decision(step(session::Ended{})),
      session::Decision(step(session::Asked(engine::LoadLevel{4}), 64, 128)),
      session::Decision(step(session::Asked(engine::ListenerMove{{0.1, -1e5, 3e-17}}), 64, 128)),
      session::Decision(session::Dropped{9, 10, "backlog"}), session::Decision(session::Dropped{9, 0, ""}),
      session::Decision(session::RenderedTo{kLargest}), session::Decision(session::RenderedTo{}),
      session::Decision(session::RecordingBegun{}),
      session::Decision(session::RecordingBegun{64 * 1000, 4'000'000'000u, kMost}));
  const std::string bytes = encode_decision("sheet", 12, decision);
  const auto read = decode_decision(as_bytes(bytes));
  REQUIRE(read.has_value());
  CHECK((*read == decision));
  v1::Decision sent;
  REQUIRE(sent.ParseFromString(bytes));
  CHECK(sent.session_id() == "sheet");
  CHECK(sent.sequence() == 12);
}

TEST_CASE("A step without an earliest sample is another than one from sample 0", "[wire][decisions]") {
  const session::Decision without = step(session::Ended{});
  const session::Decision with = step(session::Ended{}, 0);
  CHECK(encode_decision("s", 1, without) != encode_decision("s", 1, with));
}

TEST_CASE("What is no decision, or a later version's, is refused", "[wire][decisions]") {
  CHECK(decode_decision(as_bytes("\xff\xff\xff")).error().code == ErrorCode::kMalformed);
  v1::Decision decision;
  CHECK(refusal_of(decision) == ErrorCode::kUnsupported);
  decision.mutable_step()->set_arrival(1);
  CHECK(refusal_of(decision) == ErrorCode::kUnsupported);
  decision.mutable_step()->set_kind(v1::STEP_KIND_LOAD_LEVEL);
  decision.mutable_step()->set_load_level(5);
  CHECK(refusal_of(decision) == ErrorCode::kUnsupported);
  decision.mutable_time_mapping()->set_samples_per_s(0);
  CHECK(refusal_of(decision) == ErrorCode::kOutOfRange);
  decision.mutable_time_mapping()->set_samples_per_s(std::numeric_limits<double>::infinity());
  CHECK(refusal_of(decision) == ErrorCode::kNotFinite);
}

TEST_CASE("An announcement that the daemon writes says the options in force", "[wire][decisions]") {
  session::SessionOptions options;
  options.clock = session::Clock::kLive;
  options.time_origin_s = 3.25;
  options.seed = kMost;
  options.playout_delay_s = 0.0625;
  options.rate_hz = 44100;
  options.block_size = 256;
  options.channels = session::ChannelLayout::kBinaural;
  options.record = true;
  options.hrtf = "structural";
  const std::string bytes = encode_announcement("flag", "a flag", options);
  const auto envelope = StreamEnvelope::parse(as_bytes(bytes), {});
  REQUIRE(envelope.has_value());
  CHECK(envelope->session_id() == "flag");
  CHECK(envelope->sequence() == 0);
  const auto announcement = envelope->announcement();
  REQUIRE(announcement.has_value());
  CHECK(announcement->name == "a flag");
  CHECK(announcement->options == options);
}

TEST_CASE("A sheet that the daemon writes is described as it was", "[wire][decisions]") {
  const auto kind = GENERATE(engine::SheetKind::kPaper, engine::SheetKind::kCloth);
  const auto thickness_m = GENERATE(std::optional<double>(), std::optional<double>(1e-4));
  const engine::SheetDescription sheet{7, "corner", kind, "tracing-paper", "glass", 0.09, thickness_m};
  const auto envelope = StreamEnvelope::parse(as_bytes(encode_sheet("s", sheet)), {});
  REQUIRE(envelope.has_value());
  const auto read = decode_sheet(envelope->message().sheet(), "sheet", {});
  REQUIRE(read.has_value());
  CHECK(read->id == 7);
  CHECK(read->name == "corner");
  CHECK(read->kind == kind);
  CHECK(read->material == "tracing-paper");
  CHECK(read->touched_surface == "glass");
  CHECK(read->grammage_kg_per_m2 == 0.09);
  CHECK(read->thickness_m == thickness_m);
}

}  // namespace decisions_test
