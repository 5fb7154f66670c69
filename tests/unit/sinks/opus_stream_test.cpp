#include "server/sinks/opus_stream.h"

#include <catch2/catch.hpp>

#include <opus.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace opus_stream_test {

using namespace rustle::sinks;

namespace {

/// Partials of a gliding tone with beats: no lag but the true one fits.
std::vector<float> sound(std::size_t samples, std::size_t channels, double rate_hz) {
  std::vector<float> out;
  for (std::size_t n = 0; n < samples; ++n) {
    const double t = static_cast<double>(n) / rate_hz;
    for (std::size_t c = 0; c < channels; ++c) {
      const double phase = 2 * std::numbers::pi * (300 * t + 60 * t * t) * (1 + 0.25 * static_cast<double>(c));
      out.push_back(static_cast<float>(0.25 * std::sin(phase) + 0.15 * std::sin(2.7 * phase) * std::sin(7 * t)));
    }
  }
  return out;
}

struct Decoded {
  std::vector<float> samples;
  std::vector<std::int64_t> firsts;
  std::size_t packets = 0, bytes = 0;
};

Decoded decode(const std::vector<OpusPacket>& packets, int rate_hz, int channels) {
  int problem = OPUS_OK;
  OpusDecoder* decoder = opus_decoder_create(rate_hz, channels, &problem);
  REQUIRE(problem == OPUS_OK);
  Decoded out;
  for (const OpusPacket& packet : packets) {
    std::vector<float> whole(static_cast<std::size_t>(rate_hz / 10 * channels));
    const int count = opus_decode_float(decoder, packet.bytes.data(), static_cast<opus_int32>(packet.bytes.size()),
                                        whole.data(), rate_hz / 10, 0);
    REQUIRE(count == rate_hz / 50);
    REQUIRE(packet.skip_samples + packet.samples <= static_cast<std::uint32_t>(count));
    const auto from = whole.begin() + static_cast<std::ptrdiff_t>(packet.skip_samples) * channels;
    out.samples.insert(out.samples.end(), from, from + static_cast<std::ptrdiff_t>(packet.samples) * channels);
    out.firsts.push_back(packet.first_sample);
    out.bytes += packet.bytes.size();
  }
  out.packets = packets.size();
  opus_decoder_destroy(decoder);
  return out;
}

/// Of b against a, b read `lag` values later.
double snr_db(const std::vector<float>& a, const std::vector<float>& b, std::ptrdiff_t lag) {
  double power = 0, error = 0;
  for (std::size_t n = 400; n + 400 < a.size(); ++n) {
    const double x = a[n], y = b[static_cast<std::size_t>(static_cast<std::ptrdiff_t>(n) + lag)];
    power += x * x;
    error += (x - y) * (x - y);
  }
  return 10 * std::log10(power / error);
}

}  // namespace

TEST_CASE("What Opus packets decode to lies sample for sample where it was, at every rate, whatever it was added in") {
  for (const int rate_hz : {8000, 12000, 16000, 24000, 48000}) {
    for (const int channels : {1, 2}) {
      CAPTURE(rate_hz, channels);
      const std::size_t length = static_cast<std::size_t>(rate_hz) + 123;
      const auto wanted = sound(length, static_cast<std::size_t>(channels), rate_hz);
      OpusStream stream(static_cast<std::uint32_t>(rate_hz), channels, 1000);
      std::vector<OpusPacket> packets;
      const std::size_t step = 97 * static_cast<std::size_t>(channels);
      for (std::size_t at = 0; at < wanted.size(); at += step) {
        stream.add(std::span(wanted).subspan(at, std::min(step, wanted.size() - at)));
        while (auto packet = stream.next(false)) packets.push_back(std::move(*packet));
      }
      while (auto packet = stream.next(true)) packets.push_back(std::move(*packet));
      CHECK_FALSE(stream.next(true));
      const Decoded decoded = decode(packets, rate_hz, channels);
      REQUIRE(decoded.samples.size() == wanted.size());
      std::int64_t expected = 1000;
      for (std::size_t k = 0; k < packets.size(); ++k) {
        CHECK(packets[k].first_sample == expected);
        CHECK((packets[k].skip_samples > 0) == (k == 0));
        expected += packets[k].samples;
      }
      const double snr = snr_db(wanted, decoded.samples, 0);
      CHECK(snr > 25);
      for (const int lag : {-1, 1}) CHECK(snr_db(wanted, decoded.samples, lag * channels) < snr - 5);
      CHECK(static_cast<double>(decoded.bytes) < 1.3 * 64000 / 8 * channels);
    }
  }
}

TEST_CASE("Of little sound there is one packet, of none there is none") {
  OpusStream none(48000, 1, 0);
  CHECK_FALSE(none.next(true));
  OpusStream little(48000, 1, 0);
  const std::vector<float> sample{0.5F};
  little.add(sample);
  CHECK_FALSE(little.next(false));
  const auto packet = little.next(true);
  REQUIRE(packet);
  CHECK(packet->samples == 1);
  CHECK_FALSE(little.next(true));
}

TEST_CASE("Samples that just fill packets but for the codec's delay get one packet more") {
  OpusStream stream(48000, 1, 0);
  const std::vector<float> samples(2 * 960, 0.1F);
  stream.add(samples);
  std::uint64_t given = 0;
  int packets = 0;
  while (const auto packet = stream.next(true)) {
    given += packet->samples;
    ++packets;
  }
  CHECK(given == samples.size());
  CHECK(packets == 3);
}

TEST_CASE("Opus has five rates") {
  for (const std::uint32_t rate_hz : {8000U, 12000U, 16000U, 24000U, 48000U}) CHECK(OpusStream::has_rate(rate_hz));
  for (const std::uint32_t rate_hz : {0U, 11025U, 22050U, 44100U, 96000U, 192000U})
    CHECK_FALSE(OpusStream::has_rate(rate_hz));
}

}  // namespace opus_stream_test
