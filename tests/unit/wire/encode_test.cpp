#include <cstring>
#include <limits>
#include <type_traits>

#include <catch2/catch.hpp>

#include "proto/statistics_figures.h"
#include "server/wire/control.h"
#include "server/wire/encode.h"
#include "server/wire/session_options.h"
#include "tests/unit/wire/messages.h"

namespace encode_test {

using namespace rustle;
using namespace rustle::wire;
using namespace rustle::wire::test;

namespace {

v1::OutMessage parse(const std::string& bytes) {
  v1::OutMessage message;
  REQUIRE(message.ParseFromString(bytes));
  return message;
}

v1::ControlReply parse_reply(const ControlReply& reply) {
  v1::ControlReply message;
  REQUIRE(message.ParseFromString(encode_reply(9, reply)));
  CHECK(message.request_id() == 9);
  return message;
}

tl::expected<ControlRequest, ControlError> control(const v1::ControlRequest& request) {
  return decode_control(as_bytes(request.SerializeAsString()));
}

}  // namespace

TEST_CASE("PCM as floats is exact", "[wire][encode]") {
  const std::vector<float> samples = {0, 0.5f, -0.25f, 1.0f / 3, -1, 1};
  const auto message = parse(encode_pcm({.session_id = "s", .sequence = 4},
                                        {.first_sample = -256,
                                         .rate_hz = 48'000,
                                         .channels = 2,
                                         .format = PcmFormat::kF32,
                                         .missing_samples = 128,
                                         .time_s = 1.5,
                                         .content = MixContent{}},
                                        samples));
  CHECK(message.session_id() == "s");
  CHECK(message.sequence() == 4);
  CHECK(message.pcm().first_sample() == -256);
  CHECK(message.pcm().samples() == 3);
  CHECK(message.pcm().channels() == 2);
  CHECK(message.pcm().missing_samples() == 128);
  CHECK(message.pcm().has_mix());
  REQUIRE(message.pcm().data().size() == samples.size() * sizeof(float));
  CHECK(std::memcmp(message.pcm().data().data(), samples.data(), samples.size() * sizeof(float)) == 0);
}

TEST_CASE("PCM as 16-bit integers is the nearest, and clamped", "[wire][encode]") {
  CHECK(to_s16(0) == 0);
  CHECK(to_s16(1) == 32767);
  CHECK(to_s16(-1) == -32767);
  CHECK(to_s16(2) == 32767);
  CHECK(to_s16(-std::numeric_limits<float>::infinity()) == -32767);
  CHECK(to_s16(std::numeric_limits<float>::quiet_NaN()) == 0);
  CHECK(to_s16(0.4f / 32767) == 0);
  CHECK(to_s16(0.6f / 32767) == 1);
  CHECK(to_s16(-0.6f / 32767) == -1);
  for (int k = -32767; k <= 32767; ++k) REQUIRE(to_s16(static_cast<float>(k) / 32767.0f) == k);

  const std::vector<float> samples = {0.5f, -0.5f, 3};
  const auto message = parse(encode_pcm({.session_id = "s", .sequence = 1},
                                        {.first_sample = 0,
                                         .rate_hz = 44'100,
                                         .channels = 1,
                                         .format = PcmFormat::kS16,
                                         .missing_samples = 0,
                                         .time_s = 0,
                                         .content = StemContent{.sheet_id = 3, .kind = synthesis::SoundKind::kFriction}},
                                        samples));
  CHECK(message.pcm().format() == v1::SAMPLE_FORMAT_S16);
  CHECK(message.pcm().stem().sheet_id() == 3);
  CHECK(message.pcm().stem().kind() == "friction");
  CHECK(message.pcm().data().size() == 6);
}

TEST_CASE("an Opus packet leaves as it is, with what is kept of it", "[wire][encode]") {
  const std::vector<std::uint8_t> packet = {0, 1, 255};
  const auto message = parse(encode_opus({.session_id = "s", .sequence = 4},
                                         {.first_sample = 1920,
                                          .rate_hz = 48'000,
                                          .channels = 2,
                                          .format = PcmFormat::kOpus,
                                          .missing_samples = 7,
                                          .time_s = 0.04,
                                          .content = MixContent{}},
                                         {packet, 840, 120}));
  CHECK(message.sequence() == 4);
  CHECK(message.pcm().format() == v1::SAMPLE_FORMAT_OPUS);
  CHECK(message.pcm().first_sample() == 1920);
  CHECK(message.pcm().samples() == 840);
  CHECK(message.pcm().skip_samples() == 120);
  CHECK(message.pcm().missing_samples() == 7);
  CHECK(message.pcm().channels() == 2);
  CHECK(message.pcm().data() == std::string("\0\1\xff", 3));
  CHECK(message.pcm().has_mix());
}

TEST_CASE("positions leave in the session's axes", "[wire][encode]") {
  EmitterContent emitter;
  emitter.position_m = {1, 2, 3};
  PcmHeader header{.first_sample = 0,
                   .rate_hz = 48'000,
                   .channels = 1,
                   .format = PcmFormat::kF32,
                   .missing_samples = 0,
                   .time_s = 0,
                   .content = emitter};
  const auto message = parse(encode_pcm({.session_id = "s", .sequence = 1}, header, {}, session::UpAxis::kY));
  CHECK(message.pcm().emitter().position().x() == 1);
  CHECK(message.pcm().emitter().position().y() == 3);
  CHECK(message.pcm().emitter().position().z() == -2);
}

TEST_CASE("an observation comes through", "[wire][encode]") {
  observation::Observation seen;
  seen.sheet = 2;
  seen.time_s = 0.5;
  observation::CrumplingEvent event;
  event.id = 11;
  event.continues = 10;
  event.amplitude_m = 0.01;
  event.direction = -1;
  event.position_m = {1, 2, 3};
  event.resonators.resize(2);
  event.resonators[1].ruling_length_m = 0.2;
  event.resonators[1].constrained = false;
  seen.crumpling.push_back(event);
  observation::FrictionContact contact;
  contact.id = 12;
  contact.touched_surface = "wooden-table";
  contact.speed_m_per_s = 0.3;
  contact.source = observation::Source::kSent;
  seen.friction.push_back(contact);
  seen.tears.resize(1);
  const auto message = parse(encode_observation({.session_id = "s", .sequence = 1}, seen, session::UpAxis::kZ));
  const auto& out = message.observation();
  CHECK(out.sheet_id() == 2);
  REQUIRE(out.crumpling_size() == 1);
  CHECK(out.crumpling(0).event_id() == 11);
  CHECK(out.crumpling(0).continues_event_id() == 10);
  CHECK(out.crumpling(0).direction() == -1);
  CHECK(out.crumpling(0).position().y() == 2);
  REQUIRE(out.crumpling(0).resonators_size() == 2);
  CHECK(out.crumpling(0).resonators(1).ruling_length_m() == 0.2);
  CHECK_FALSE(out.crumpling(0).resonators(1).constrained());
  CHECK(out.friction(0).normal_force_n() == 0);  // unknown
  CHECK(out.friction(0).source() == v1::OBSERVATION_SOURCE_SENT);
  CHECK(out.tears_size() == 1);
}

TEST_CASE("credits, notices, ends", "[wire][encode]") {
  const OutHeader header{.session_id = "s", .sequence = 2};
  const auto credit =
      parse(encode_credit(header, {.acknowledged_sequence = 5, .window_messages = 16, .window_bytes = 1000}));
  CHECK(credit.credit().acknowledged_sequence() == 5);
  CHECK(credit.credit().window_messages() == 16);
  CHECK(parse(encode_end(header, 48'000)).end().samples() == 48'000);
  CHECK(parse(encode_stored(header, 7, "a.mcap")).stored().file_name() == "a.mcap");
  Decoder decoder = ready();
  auto bad = frame_message(1, 99);
  bad.set_sequence(31);
  const auto refused = decode(decoder, bad);
  const auto notice = parse(encode_notice(header, notice_of(refused.error(), 3))).notice();
  CHECK(notice.level() == v1::NOTICE_LEVEL_ERROR);
  CHECK(notice.code() == "unknown_topology");
  CHECK(notice.field() == "frame.topology_id");
  CHECK(notice.sequence() == 31);
  CHECK(notice.count() == 3);
  CHECK_FALSE(notice.remedy().empty());
}

TEST_CASE("session options there and back", "[wire][options]") {
  session::SessionOptions options;
  options.clock = session::Clock::kSimulation;
  options.time_origin_s = -2.5;
  options.metres_per_unit = 0.01;
  options.up_axis = session::UpAxis::kY;
  options.seed = 0xfedcba9876543210ull;
  options.mode = session::SynthesisMode::kPublished;
  options.playout_delay_s = 0.0;
  options.rate_hz = 96'000;
  options.block_size = 1000;
  options.channels = session::ChannelLayout::kMono;
  options.cloth_features = session::ClothFeatures::kGlobal;
  options.default_material = "banknote";
  options.record = true;
  options.hrtf = "kemar";
  options.friction_fft_size = 2048;
  v1::SessionOptions sent;
  to_wire(options, &sent);
  CHECK(from_wire(sent, "options").value() == options);
  CHECK(from_wire(v1::SessionOptions(), "options").value() == session::SessionOptions());
}

TEST_CASE("session options out of range are named", "[wire][options]") {
  v1::SessionOptions sent;
  const auto refused = [&](ErrorCode code, const std::string& field) {
    const auto read = from_wire(sent, "o");
    REQUIRE_FALSE(read.has_value());
    CHECK(read.error().code == code);
    CHECK(read.error().field == field);
  };
  sent.set_metres_per_unit(-1);
  refused(ErrorCode::kOutOfRange, "o.metres_per_unit");
  sent.set_metres_per_unit(std::nan(""));
  refused(ErrorCode::kNotFinite, "o.metres_per_unit");
  sent.set_metres_per_unit(1);
  sent.set_time_origin_s(-2e10);
  refused(ErrorCode::kOutOfRange, "o.time_origin_s");
  sent.set_time_origin_s(0);
  sent.set_playout_delay_s(-1);
  refused(ErrorCode::kOutOfRange, "o.playout_delay_s");
  sent.set_playout_delay_s(1);
  sent.set_rate_hz(1);
  refused(ErrorCode::kOutOfRange, "o.rate_hz");
  sent.set_rate_hz(48'000);
  sent.set_block_size(1'000'000);
  refused(ErrorCode::kOutOfRange, "o.block_size");
  sent.set_block_size(0);
  for (const std::uint32_t size : {64u, 1000u, 16'384u}) {
    sent.set_friction_fft_size(size);
    refused(ErrorCode::kOutOfRange, "o.friction_fft_size");
  }
  sent.set_friction_fft_size(128);
  sent.set_hrtf(std::string(5000, 'x'));
  refused(ErrorCode::kTooLarge, "o.hrtf");
  sent.set_hrtf("");
  sent.set_clock(static_cast<v1::Clock>(17));
  refused(ErrorCode::kUnsupported, "o.clock");
}

TEST_CASE("control requests", "[wire][control]") {
  v1::ControlRequest request;
  request.set_request_id(3);
  SECTION("nothing asked") {
    CHECK(control(request).error().request_id == 3);
  }
  SECTION("hello") {
    request.mutable_hello()->set_protocol_version(1);
    request.mutable_hello()->set_client("me");
    CHECK(std::get<HelloRequest>(control(request)->body).client == "me");
    request.mutable_hello()->set_protocol_version(3);
    CHECK(control(request).error().error.code == ErrorCode::kProtocolVersion);
  }
  SECTION("attach") {
    request.mutable_attach()->mutable_options()->set_seed(5);
    request.mutable_attach()->add_sheets()->set_sheet_id(4);
    const auto read = control(request);
    CHECK(std::get<AttachRequest>(read->body).options.seed == 5);
    CHECK(std::get<AttachRequest>(read->body).sheets.at(0).id == 4);
    request.mutable_attach()->mutable_sheets(0)->set_thickness_m(-1);
    CHECK(control(request).error().error.field == "attach.sheets[0].thickness_m");
  }
  SECTION("gains") {
    auto* gain = request.mutable_set_gains()->add_gains();
    gain->set_gain_db(-6);
    gain->set_kind(v1::SOUND_KIND_TEARING);
    const auto read = control(request);
    const Gain& got = std::get<SetGainsRequest>(read->body).gains.at(0);
    CHECK(got.gain_db == -6);
    CHECK(got.kind == synthesis::SoundKind::kTearing);
    CHECK_FALSE(got.sheet_id.has_value());
    gain->set_gain_db(-std::numeric_limits<double>::infinity());  // silence
    CHECK(std::get<SetGainsRequest>(control(request)->body).gains.at(0).gain_db == gain->gain_db());
    gain->set_gain_db(24);
    CHECK(control(request).has_value());
    const auto refused = [&](double gain_db, ErrorCode code) {
      gain->set_gain_db(gain_db);
      const auto error = control(request).error().error;
      CHECK(error.field == "set_gains.gains[0].gain_db");
      CHECK(error.code == code);
      CHECK_FALSE(error.remedy.empty());
    };
    refused(24.1, ErrorCode::kOutOfRange);
    refused(-201, ErrorCode::kOutOfRange);
    refused(std::numeric_limits<double>::infinity(), ErrorCode::kNotFinite);
    refused(std::numeric_limits<double>::quiet_NaN(), ErrorCode::kNotFinite);
  }
  SECTION("a change of pack names something") {
    request.mutable_change_pack()->set_sheet_id(2);
    CHECK(control(request).error().error.field == "change_pack.material");
    request.mutable_change_pack()->set_touched_surface("glass");
    CHECK(std::get<ChangePackRequest>(control(request)->body).touched_surface == "glass");
    request.mutable_change_pack()->set_material("kraft\n");
    CHECK(control(request).error().error.field == "change_pack.material");
  }
}

TEST_CASE("control replies", "[wire][control]") {
  const auto refused = parse_reply(Error{.code = ErrorCode::kQuotaExceeded,
                                         .field = "f",
                                         .message = "m",
                                         .remedy = "r",
                                         .sequence = 2,
                                         .quota = Quota{.name = "sessions", .limit = 4, .asked = 5},
                                         .permission = {}});
  CHECK(refused.error().code() == v1::ERROR_CODE_QUOTA_EXCEEDED);
  CHECK(refused.error().quota().asked() == 5);
  Statistics statistics;
  statistics.frames_dropped["late"] = 3;
  CHECK(parse_reply(Detached{statistics}).detached().statistics().frames_dropped().at("late") == 3);
  // Every other field of the message has a figure of its own, which arrives in it.
  int figures = 0;
  v1::for_each_figure<Statistics>([&](const char*, auto member, auto, auto) {
    statistics.*member = static_cast<std::remove_cvref_t<decltype(statistics.*member)>>(100 + ++figures);
  });
  CHECK(figures == v1::Statistics::descriptor()->field_count() - 2);
  const v1::Statistics arrived = parse_reply(statistics).statistics();
  int next = 0;
  v1::for_each_figure<Statistics>([&](const char* name, auto, auto get, auto) {
    CHECK(static_cast<int>((arrived.*get)()) == 100 + ++next);
    CHECK(v1::Statistics::descriptor()->FindFieldByName(name) != nullptr);
  });
  CHECK(parse_reply(Welcome{.server = "x", .stream_endpoint = "a", .out_endpoint = "b", .rate_hz = 1, .block_size = 2})
            .welcome()
            .protocol_version() == 1);
  const auto attached = parse_reply(
      Attached{.session_id = "s", .options = {}, .credit = FlowCredit{0, 8, 100}, .recording_file_name = "take.mcap"});
  CHECK(attached.attached().credit().window_messages() == 8);
  CHECK(attached.attached().recording_file_name() == "take.mcap");
  SessionList list;
  list.sessions.resize(2);
  list.sessions[1].recording = RecordingProgress{"take.mcap", 7, 8};
  const auto listed = parse_reply(list).session_list();
  CHECK_FALSE(listed.sessions(0).has_recording());
  CHECK(listed.sessions(1).recording().file_name() == "take.mcap");
  CHECK(listed.sessions(1).recording().messages() == 7);
  CHECK(listed.sessions(1).recording().bytes() == 8);
  // The plain codes are the wire's.
  CHECK(static_cast<int>(ErrorCode::kIdle) == v1::ERROR_CODE_IDLE);
  CHECK(static_cast<int>(ErrorCode::kUnidentified) == v1::ERROR_CODE_UNIDENTIFIED);
  for (int code = 1; code < v1::ErrorCode_ARRAYSIZE; ++code) {
    std::string name(code_name(static_cast<ErrorCode>(code)));
    for (char& c : name) c = static_cast<char>(c == '_' ? c : c - 'a' + 'A');
    CHECK("ERROR_CODE_" + name == v1::ErrorCode_Name(static_cast<v1::ErrorCode>(code)));
  }
}

TEST_CASE("topics there and back", "[wire][topics]") {
  for (const char* text : {"s/pcm/mix/f32/4", "a b/pcm/stem/17/friction/s16/1", "s/pcm/emitter/opus/3"}) {
    const auto topic = parse_pcm_topic(text);
    REQUIRE(topic.has_value());
    CHECK(to_string(*topic) == text);
  }
  for (const char* text : {"", "s", "s/pcm", "s/pcm/", "s/pcm/mix/f32/5", "s/pcm/mix/f32/0", "s/pcm/mix/f32/44",
                           "s/pcm/mix/mp3/4", "s/pcm/stem/x/friction/f32/1", "s/pcm/stem/1/singing/f32/1",
                           "s/pcm/mix/f32/4/", "/pcm/mix/f32/4", "s/observations", "s/pcm/stem/99999999999/friction/f32/1"})
    CHECK_FALSE(parse_pcm_topic(text).has_value());
  CHECK(session_of_topic("s/notices") == "s");
}

}  // namespace encode_test
