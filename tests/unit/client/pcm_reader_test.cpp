#include <opus.h>
#include <catch2/catch.hpp>

#include <cmath>

#include "client_sdk/cpp/session.h"
#include "tests/unit/client/fake_daemon.h"

namespace pcm_reader_test {

using namespace rustle::client;
using namespace rustle::client::test;
using namespace std::chrono_literals;
namespace wire = rustle::wire;

namespace {

Connection connect(const FakeDaemon& daemon) {
  Endpoints endpoints;
  endpoints.control = daemon.control();
  return Connection::connect(endpoints).value();
}

std::string pcm(std::int64_t first_sample, const std::vector<float>& samples, wire::PcmFormat format = wire::PcmFormat::kF32,
                std::uint64_t missing = 0) {
  static std::uint64_t sequence = 0;
  return wire::encode_pcm({.session_id = "s1", .sequence = ++sequence},
                          {.first_sample = first_sample,
                           .rate_hz = 48'000,
                           .channels = 2,
                           .format = format,
                           .missing_samples = missing,
                           .time_s = static_cast<double>(first_sample) / 48'000,
                           .content = wire::MixContent{}},
                          samples);
}

constexpr const char* kMix = "s1/pcm/mix/f32/4";

}  // namespace

TEST_CASE("what is sent after listen() returns is heard, every time", "[client][pcm]") {
  FakeDaemon daemon({});
  const Connection connection = connect(daemon);
  for (int round = 0; round < 20; ++round) {
    auto reader = PcmReader::listen(connection, "s1");
    REQUIRE(reader.has_value());
    daemon.post(kMix, pcm(round, {0.25f, -0.5f}));
    const auto block = reader->next(10s);
    REQUIRE(block.has_value());
    CHECK(block->first_sample == round);
    CHECK(block->interleaved == std::vector<float>{0.25f, -0.5f});
  }
}

TEST_CASE("several listeners of one topic each hear everything", "[client][pcm]") {
  FakeDaemon daemon({});
  const Connection connection = connect(daemon);
  std::vector<PcmReader> readers;
  for (int k = 0; k < 3; ++k) readers.push_back(std::move(*PcmReader::listen(connection, "s1")));
  for (int k = 0; k < 10; ++k) daemon.post(kMix, pcm(k, {0, 0}));
  for (auto& reader : readers)
    for (int k = 0; k < 10; ++k) CHECK(reader.next(10s)->first_sample == k);
}

TEST_CASE("blocks, gaps and the end", "[client][pcm]") {
  FakeDaemon daemon({});
  auto reader = std::move(*PcmReader::listen(connect(daemon), "s1"));
  CHECK_FALSE(reader.next(10ms).has_value());
  daemon.post(kMix, pcm(-2, {1, 2, 3, 4}));
  daemon.post(kMix, pcm(0, {5, 6}));
  daemon.post(kMix, pcm(11, {7, 8}));                            // ten lost on the way
  daemon.post(kMix, pcm(12, {7, 8}, wire::PcmFormat::kF32, 5));  // five never rendered
  daemon.post(kMix, "nonsense");
  daemon.post(kMix, wire::encode_end({.session_id = "s1", .sequence = 9}, 20));
  const auto first = reader.next(10s);
  CHECK(first->first_sample == -2);
  CHECK(first->samples == 2);
  CHECK(first->channels == 2);
  CHECK(first->rate_hz == 48'000);
  CHECK(first->missing_samples == 0);
  CHECK_FALSE(first->end);
  CHECK(reader.next(10s)->missing_samples == 0);
  CHECK(reader.next(10s)->missing_samples == 10);
  CHECK(reader.next(10s)->missing_samples == 5);
  const auto end = reader.next(10s);
  CHECK(end->end);
  CHECK(end->first_sample == 20);
  CHECK(end->missing_samples == 7);
  CHECK(reader.missing_samples() == 22);
  CHECK(reader.unreadable_messages() == 1);
}

TEST_CASE("16-bit PCM is within half a step", "[client][pcm]") {
  FakeDaemon daemon({});
  auto reader = std::move(
      *PcmReader::listen(connect(daemon), "s1", {.content = MixContent{}, .format = SampleFormat::kS16, .blocks = 1}));
  const std::vector<float> samples = {0.1234567f, -0.9999f, 1, -1, 0, 1e-5f};
  daemon.post("s1/pcm/mix/s16/1", pcm(0, samples, wire::PcmFormat::kS16));
  const auto block = reader.next(10s);
  REQUIRE(block.has_value());
  REQUIRE(block->interleaved.size() == samples.size());
  for (std::size_t k = 0; k < samples.size(); ++k)
    CHECK(std::abs(block->interleaved[k] - samples[k]) <= 0.5f / 32767 * 1.001f);
}

TEST_CASE("stems and emitters", "[client][pcm]") {
  FakeDaemon daemon({});
  const Connection connection = connect(daemon);
  auto stem =
      std::move(*PcmReader::listen(connection, "s1", {.content = StemContent{.sheet_id = 3, .kind = SoundKind::kFriction}}));
  daemon.post("s1/pcm/stem/3/friction/f32/4", pcm(0, {1, 1}));
  CHECK(stem.next(10s).has_value());

  auto emitters = std::move(*PcmReader::listen(connection, "s1", {.content = EmitterContent{}}));
  wire::EmitterContent content;
  content.emitter_id = 5;
  content.kind = rustle::synthesis::SoundKind::kTearing;
  content.position_m = {1, 2, 3};
  content.last = true;
  wire::PcmHeader header;
  header.channels = 1;
  header.content = content;
  header.first_sample = 1000;
  const std::vector<float> one = {1};
  daemon.post("s1/pcm/emitter/f32/4", wire::encode_pcm({.session_id = "s1", .sequence = 1}, header, one));
  header.first_sample = 0;  // another emitter's: no gap
  daemon.post("s1/pcm/emitter/f32/4", wire::encode_pcm({.session_id = "s1", .sequence = 2}, header, one));
  const auto block = emitters.next(10s);
  REQUIRE(block->emitter.has_value());
  CHECK(block->emitter->emitter_id == 5);
  CHECK(block->emitter->kind == SoundKind::kTearing);
  CHECK(block->emitter->position == Vector3{1, 2, 3});
  CHECK(block->emitter->last);
  CHECK(emitters.next(10s)->missing_samples == 0);
}

TEST_CASE("messages that were lost are counted, and each emitter's samples", "[client][pcm]") {
  FakeDaemon daemon({});
  auto reader = std::move(*PcmReader::listen(connect(daemon), "s1", {.content = EmitterContent{}}));
  const auto post = [&](std::uint64_t sequence, std::uint64_t emitter, std::int64_t first_sample, bool last = false) {
    wire::EmitterContent content;
    content.emitter_id = emitter;
    content.last = last;
    wire::PcmHeader header;
    header.rate_hz = 48'000;
    header.channels = 1;
    header.first_sample = first_sample;
    header.content = content;
    daemon.post("s1/pcm/emitter/f32/4",
                wire::encode_pcm({.session_id = "s1", .sequence = sequence}, header, std::vector<float>(10)));
  };
  post(4, 1, 100);
  post(5, 2, 100);
  post(8, 1, 130);        // twenty lost, in two messages, perhaps with another emitter's
  post(9, 2, 110, true);  // nothing
  post(10, 2, 500);       // begun again
  post(11, 1, 140);
  daemon.post("s1/pcm/emitter/f32/4", wire::encode_end({.session_id = "s1", .sequence = 13}, 600));
  std::vector<std::uint64_t> missing;
  for (auto block = reader.next(10s); block && !block->end; block = reader.next(10s))
    missing.push_back(block->missing_samples);
  CHECK(missing == std::vector<std::uint64_t>{0, 0, 20, 0, 0, 0});
  CHECK(reader.missing_samples() == 20);
  CHECK(reader.missing_messages() == 3);
  CHECK(reader.read_all().error().field == "content");
}

TEST_CASE("Opus packets are decoded to where they were, emitter by emitter", "[client][pcm]") {
  FakeDaemon daemon({});
  const Connection connection = connect(daemon);
  constexpr int kFrame = 960;
  struct Encoder {
    Encoder() {
      int problem = 0;
      handle = opus_encoder_create(48'000, 1, OPUS_APPLICATION_RESTRICTED_LOWDELAY, &problem);
      opus_encoder_ctl(handle, OPUS_GET_LOOKAHEAD(&lookahead));
    }
    ~Encoder() { opus_encoder_destroy(handle); }
    std::vector<unsigned char> packet(const float* samples) {
      std::vector<unsigned char> bytes(4000);
      bytes.resize(static_cast<std::size_t>(
          opus_encode_float(handle, samples, kFrame, bytes.data(), static_cast<opus_int32>(bytes.size()))));
      return bytes;
    }
    OpusEncoder* handle;
    opus_int32 lookahead = 0;
  };
  std::vector<float> tone(10 * kFrame);
  for (std::size_t n = 0; n < tone.size(); ++n) tone[n] = 0.3f * std::sin(0.05f * static_cast<float>(n));

  std::string topic;
  ListenOptions options;
  options.format = SampleFormat::kOpus;
  options.blocks = 1;
  const bool emitters = GENERATE(false, true);
  if (emitters) options.content = EmitterContent{};
  topic = emitters ? "s1/pcm/emitter/opus/4" : "s1/pcm/mix/opus/4";
  auto reader = std::move(*PcmReader::listen(connection, "s1", options));
  Encoder encoders[2];
  std::uint64_t sequence = 0;
  for (int k = 0; k < 10; ++k) {
    for (std::uint64_t id = 0; id < (emitters ? 2 : 1); ++id) {
      // The second emitter is the first one's opposite.
      std::vector<float> samples(tone.begin() + k * kFrame, tone.begin() + (k + 1) * kFrame);
      if (id == 1)
        for (float& x : samples) x = -x;
      const auto packet = encoders[id].packet(samples.data());
      const auto skip = static_cast<std::uint32_t>(k == 0 ? encoders[id].lookahead : 0);
      wire::PcmHeader header;
      header.rate_hz = 48'000;
      header.channels = 1;
      header.format = wire::PcmFormat::kOpus;
      header.first_sample = k == 0 ? 0 : k * kFrame - encoders[id].lookahead;
      if (emitters) {
        wire::EmitterContent content;
        content.emitter_id = 5 + id;
        header.content = content;
      }
      daemon.post(topic,
                  wire::encode_opus({.session_id = "s1", .sequence = ++sequence}, header, {packet, kFrame - skip, skip}));
    }
  }
  daemon.post(topic, wire::encode_opus(
                         {.session_id = "s1", .sequence = ++sequence},
                         {.rate_hz = 48'000, .channels = 1, .format = wire::PcmFormat::kOpus, .content = wire::MixContent{}},
                         {{}, 5, 0}));
  std::vector<float> heard[2];
  for (auto block = reader.next(2s); block; block = reader.next(500ms)) {
    auto& into = heard[block->emitter ? block->emitter->emitter_id - 5 : 0];
    CHECK(block->first_sample == static_cast<std::int64_t>(into.size()));
    CHECK(block->missing_samples == 0);
    into.insert(into.end(), block->interleaved.begin(), block->interleaved.end());
  }
  for (std::size_t id = 0; id < (emitters ? 2 : 1); ++id) {
    REQUIRE(heard[id].size() == tone.size() - static_cast<std::size_t>(encoders[0].lookahead));
    double error = 0, power = 0;
    for (std::size_t n = kFrame; n < heard[id].size(); ++n) {
      const double wanted = id == 0 ? tone[n] : -tone[n];
      error += (heard[id][n] - wanted) * (heard[id][n] - wanted);
      power += wanted * wanted;
    }
    CHECK(error < 1e-3 * power);
  }
  CHECK(reader.unreadable_messages() == 1);
}

TEST_CASE("a listener of a simulation that reads late misses nothing", "[client][pcm]") {
  FakeDaemon daemon({});
  const Connection connection = connect(daemon);
  SessionOptions options;
  options.clock = Clock::kSimulation;
  auto session = std::move(*Session::attach(connection, options));
  auto reader = std::move(*session.listen());
  const std::vector<float> samples(1024, 0.5f);
  constexpr int kBlocks = 6'000;
  for (int k = 0; k < kBlocks; ++k) daemon.post(kMix, pcm(512 * k, samples));
  std::this_thread::sleep_for(1s);  // longer than the heartbeats' patience
  int heard = 0;
  while (heard < kBlocks && reader.next(10s)) ++heard;
  CHECK(heard == kBlocks);
  CHECK(reader.missing_samples() == 0);
}

TEST_CASE("impossible requests", "[client][pcm]") {
  FakeDaemon daemon({});
  CHECK(PcmReader::listen(connect(daemon), "s1", {.content = MixContent{}, .blocks = 5}).error().field == "blocks");
}

}  // namespace pcm_reader_test
