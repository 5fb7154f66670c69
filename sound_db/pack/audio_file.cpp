#include "sound_db/pack/audio_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <memory>
#include <optional>

#include <fmt/format.h>
#include <sndfile.h>

namespace rustle::pack {

namespace {

struct CloseSound {
  void operator()(SNDFILE* file) const { sf_close(file); }
};
using SoundFile = std::unique_ptr<SNDFILE, CloseSound>;

/// libsndfile shortens a cut WAV to what is there; its header still tells.
std::optional<std::string> cut_wav(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::array<char, 8> head{};
  if (!stream.read(head.data(), head.size())) return "is cut short: it has no header";
  if (std::memcmp(head.data(), "RIFF", 4) != 0) return std::nullopt;
  std::uint32_t size = 0;
  std::memcpy(&size, head.data() + 4, 4);
  std::error_code failed;
  const std::uintmax_t length = std::filesystem::file_size(file, failed);
  if (failed || length < std::uintmax_t{size} + 8) {
    return fmt::format("is cut short: its header promises {} bytes, it has {}", std::uintmax_t{size} + 8, length);
  }
  // The chunks, up to the data.
  std::uintmax_t at = 12;
  while (at + 8 <= length) {
    stream.seekg(static_cast<std::streamoff>(at));
    if (!stream.read(head.data(), head.size())) break;
    std::memcpy(&size, head.data() + 4, 4);
    at += 8 + std::uintmax_t{size};
    if (at > length) return "is cut short: a chunk goes beyond the end of the file";
    if (std::memcmp(head.data(), "data", 4) == 0) return std::nullopt;
    at += size & 1;
  }
  return "has no data chunk";
}

/// Interleaved samples of a whole file.
struct Interleaved {
  std::uint32_t rate_hz = 0;
  std::size_t channels = 0;
  std::vector<float> samples;
};

tl::expected<Interleaved, std::string> read_interleaved(const std::filesystem::path& file, int most_channels,
                                                        double longest_s) {
  if (const auto cut = cut_wav(file)) return tl::unexpected(*cut);
  SF_INFO info{};
  const SoundFile sound(sf_open(file.c_str(), SFM_READ, &info));
  if (!sound) return tl::unexpected(fmt::format("cannot be read as WAV or FLAC ({})", sf_strerror(nullptr)));
  const int container = info.format & SF_FORMAT_TYPEMASK;
  if (container != SF_FORMAT_WAV && container != SF_FORMAT_WAVEX && container != SF_FORMAT_FLAC) {
    return tl::unexpected(std::string("is neither WAV nor FLAC"));
  }
  if (most_channels == 1 && info.channels != 1) {
    return tl::unexpected(fmt::format("has {} channels, units are mono", info.channels));
  }
  if (info.channels < 1 || info.channels > most_channels) {
    return tl::unexpected(fmt::format("has {} channels, at most {} are read", info.channels, most_channels));
  }
  if (info.samplerate < 8000 || info.samplerate > 768000) {
    return tl::unexpected(fmt::format("has a rate of {} Hz", info.samplerate));
  }
  if (info.frames <= 0) return tl::unexpected(std::string("is empty"));
  if (static_cast<double>(info.frames) > longest_s * info.samplerate) {
    return tl::unexpected(fmt::format("is longer than {} s, or does not state its length", longest_s));
  }
  const auto channels = static_cast<std::size_t>(info.channels);
  Interleaved result{static_cast<std::uint32_t>(info.samplerate), channels, {}};
  result.samples.resize(static_cast<std::size_t>(info.frames) * channels);
  const sf_count_t read = sf_readf_float(sound.get(), result.samples.data(), info.frames);
  if (read != info.frames || sf_error(sound.get()) != SF_ERR_NO_ERROR) {
    return tl::unexpected(fmt::format("is cut short or damaged: {} of {} samples could be read", read, info.frames));
  }
  const auto bad = std::find_if(result.samples.begin(), result.samples.end(), [](float x) { return !std::isfinite(x); });
  if (bad != result.samples.end()) {
    return tl::unexpected(fmt::format("has a sample that is not finite at index {}", bad - result.samples.begin()));
  }
  return result;
}

/// FLAC of 16 or 24 bits, or WAV with floats.
tl::expected<void, std::string> write_interleaved(const std::filesystem::path& file, std::span<const float> samples,
                                                  std::size_t channels, std::uint32_t rate_hz, int flac_bits) {
  const bool flac = file.extension() == ".flac";
  SF_INFO info{};
  info.samplerate = static_cast<int>(rate_hz);
  info.channels = static_cast<int>(channels);
  info.format =
      flac ? SF_FORMAT_FLAC | (flac_bits == 24 ? SF_FORMAT_PCM_24 : SF_FORMAT_PCM_16) : SF_FORMAT_WAV | SF_FORMAT_FLOAT;
  SoundFile sound(sf_open(file.c_str(), SFM_WRITE, &info));
  if (!sound) return tl::unexpected(fmt::format("cannot be written ({})", sf_strerror(nullptr)));
  const auto count = static_cast<sf_count_t>(samples.size() / channels);
  sf_count_t written = 0;
  if (flac) {
    const long full = 1L << (flac_bits - 1);
    std::vector<int> rounded(samples.size());  // libsndfile takes the upper bits
    std::transform(samples.begin(), samples.end(), rounded.begin(), [&](float x) {
      const long value = std::clamp(std::lround(static_cast<float>(full) * x), -full, full - 1);
      return static_cast<int>(value * (1L << (32 - flac_bits)));
    });
    written = sf_writef_int(sound.get(), rounded.data(), count);
  } else {
    sf_command(sound.get(), SFC_SET_ADD_PEAK_CHUNK, nullptr, SF_FALSE);  // it holds the time of writing
    written = sf_writef_float(sound.get(), samples.data(), count);
  }
  const bool closed = sf_close(sound.release()) == 0;
  if (written != count || !closed) return tl::unexpected(std::string("cannot be written (disk full?)"));
  return {};
}

}  // namespace

tl::expected<Clip, std::string> read_clip(const std::filesystem::path& file) {
  auto read = read_interleaved(file, 1, kLongestUnit_s);
  if (!read) return tl::unexpected(std::move(read.error()));
  return Clip{read->rate_hz, std::move(read->samples)};
}

tl::expected<void, std::string> write_clip(const std::filesystem::path& file, std::span<const float> samples,
                                           std::uint32_t rate_hz) {
  return write_interleaved(file, samples, 1, rate_hz, 16);
}

tl::expected<MultichannelClip, std::string> read_multichannel(const std::filesystem::path& file) {
  const auto read = read_interleaved(file, kMostChannels, kLongestRecording_s);
  if (!read) return tl::unexpected(read.error());
  MultichannelClip clip{read->rate_hz, std::vector<std::vector<float>>(read->channels)};
  for (std::size_t c = 0; c < read->channels; ++c) {
    for (std::size_t i = c; i < read->samples.size(); i += read->channels) clip.channels[c].push_back(read->samples[i]);
  }
  return clip;
}

tl::expected<void, std::string> write_multichannel(const std::filesystem::path& file,
                                                   std::span<const std::vector<float>> channels, std::uint32_t rate_hz) {
  std::vector<float> samples(channels.size() * channels.front().size());
  for (std::size_t c = 0; c < channels.size(); ++c) {
    for (std::size_t n = 0; n < channels[c].size(); ++n) samples[n * channels.size() + c] = channels[c][n];
  }
  return write_interleaved(file, samples, channels.size(), rate_hz, 24);
}

}  // namespace rustle::pack
