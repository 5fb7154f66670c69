#include "sound_db/build/recording.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cctype>
#include <cmath>
#include <memory>
#include <string_view>

#include <fmt/format.h>
#include <sndfile.h>

namespace rustle::build {

namespace {

constexpr sf_count_t kMostSamples = sf_count_t{1} << 28;
constexpr int kMostChannels = 64;

struct CloseSound {
  void operator()(SNDFILE* file) const { sf_close(file); }
};

}  // namespace

tl::expected<Recording, std::string> read_recording(const std::filesystem::path& file) {
  SF_INFO info{};
  const std::unique_ptr<SNDFILE, CloseSound> sound(sf_open(file.c_str(), SFM_READ, &info));
  if (!sound) return tl::unexpected(fmt::format("cannot be read as a sound file ({})", sf_strerror(nullptr)));
  if (info.samplerate < 8000 || info.samplerate > 768000)
    return tl::unexpected(fmt::format("has a rate of {} Hz, expected 8000 to 768000", info.samplerate));
  if (info.channels < 1 || info.channels > kMostChannels)
    return tl::unexpected(fmt::format("has {} channels, expected 1 to {}", info.channels, kMostChannels));
  // The length that a header states is a claim; what is read counts.
  Recording recording{static_cast<std::uint32_t>(info.samplerate), info.channels, {}};
  constexpr sf_count_t kBlock = 65536;
  for (sf_count_t frames = 0;;) {
    const auto filled = static_cast<std::size_t>(frames * info.channels);
    recording.interleaved.resize(filled + static_cast<std::size_t>(kBlock * info.channels));
    const sf_count_t got = sf_readf_float(sound.get(), recording.interleaved.data() + filled, kBlock);
    frames += std::max<sf_count_t>(got, 0);
    recording.interleaved.resize(static_cast<std::size_t>(frames * info.channels));
    if (got <= 0) break;
    if (frames * info.channels > kMostSamples) return tl::unexpected(fmt::format("has more than {} samples", kMostSamples));
  }
  if (sf_error(sound.get()) != SF_ERR_NO_ERROR)
    return tl::unexpected(fmt::format("is damaged after {} frames ({})", recording.frames(), sf_strerror(sound.get())));
  if (recording.interleaved.empty()) return tl::unexpected(std::string("is empty"));
  const auto finite = [](float x) { return std::isfinite(x); };
  if (!std::all_of(recording.interleaved.begin(), recording.interleaved.end(), finite))
    return tl::unexpected(std::string("has samples that are not finite"));
  return recording;
}

std::vector<float> channel_of(const Recording& recording, int channel) {
  assert(channel >= 0 && channel <= recording.channels);
  const auto channels = static_cast<std::size_t>(recording.channels);
  std::vector<float> mono(recording.frames());
  for (std::size_t n = 0; n < mono.size(); ++n) {
    const float* frame = recording.interleaved.data() + n * channels;
    if (channel > 0) {
      mono[n] = frame[channel - 1];
      continue;
    }
    double sum = 0;
    for (std::size_t c = 0; c < channels; ++c) sum += frame[c];
    mono[n] = static_cast<float>(sum / static_cast<double>(channels));
  }
  return mono;
}

bool is_recording(const std::filesystem::path& file) {
  constexpr std::array<std::string_view, 7> kEndings = {".wav", ".flac", ".ogg", ".oga", ".mp3", ".aif", ".aiff"};
  std::string ending = file.extension().string();
  for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(kEndings.begin(), kEndings.end(), ending) != kEndings.end();
}

}  // namespace rustle::build
