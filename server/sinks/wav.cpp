#include "server/sinks/wav.h"

#include <fmt/format.h>
#include <sndfile.h>

#include <utility>

namespace rustle::sinks {
namespace {

int subtype(WavFormat format) {
  switch (format) {
    case WavFormat::kInt16:
      return SF_FORMAT_PCM_16;
    case WavFormat::kInt24:
      return SF_FORMAT_PCM_24;
    case WavFormat::kFloat32:
      break;
  }
  return SF_FORMAT_FLOAT;
}

}  // namespace

struct WavWriter::File {
  std::filesystem::path path;
  SNDFILE* handle = nullptr;
  int channels = 1;
  ~File() {
    if (handle != nullptr) sf_close(handle);
  }
};

WavWriter::WavWriter(std::unique_ptr<File> opened) : file_(std::move(opened)) {}
WavWriter::WavWriter(WavWriter&&) noexcept = default;
WavWriter& WavWriter::operator=(WavWriter&&) noexcept = default;
WavWriter::~WavWriter() = default;

tl::expected<WavWriter, std::string> WavWriter::create(const std::filesystem::path& path, int rate_hz, int channels,
                                                       WavFormat format) {
  SF_INFO info{};
  info.samplerate = rate_hz;
  info.channels = channels;
  info.format = SF_FORMAT_RF64 | subtype(format);
  auto file = std::make_unique<File>();
  file->path = path;
  file->channels = channels;
  file->handle = sf_open(path.c_str(), SFM_WRITE, &info);
  if (file->handle == nullptr) {
    return tl::unexpected(fmt::format("{}: cannot be written ({}); choose a folder that exists and is yours to write",
                                      path.string(), sf_strerror(nullptr)));
  }
  sf_command(file->handle, SFC_RF64_AUTO_DOWNGRADE, nullptr, SF_TRUE);
  sf_command(file->handle, SFC_SET_ADD_PEAK_CHUNK, nullptr, SF_FALSE);  // it would hold the time of writing
  sf_command(file->handle, SFC_SET_CLIPPING, nullptr, SF_TRUE);
  return WavWriter(std::move(file));
}

tl::expected<void, std::string> WavWriter::write(std::span<const float> interleaved) {
  const auto frames = static_cast<sf_count_t>(interleaved.size()) / file_->channels;
  if (sf_writef_float(file_->handle, interleaved.data(), frames) != frames) {
    return tl::unexpected(
        fmt::format("{}: writing failed ({}); is the disk full?", file_->path.string(), sf_strerror(file_->handle)));
  }
  return {};
}

tl::expected<void, std::string> WavWriter::close() {
  if (!file_ || file_->handle == nullptr) return {};
  const int status = sf_close(std::exchange(file_->handle, nullptr));
  if (status != 0) {
    return tl::unexpected(
        fmt::format("{}: could not be completed ({}); is the disk full?", file_->path.string(), sf_error_number(status)));
  }
  return {};
}

tl::expected<SoundFile, std::string> read_sound_file(const std::filesystem::path& path) {
  SF_INFO info{};
  SNDFILE* handle = sf_open(path.c_str(), SFM_READ, &info);
  if (handle == nullptr) {
    return tl::unexpected(
        fmt::format("{}: cannot be read ({}); give a WAV, FLAC or OGG file", path.string(), sf_strerror(nullptr)));
  }
  SoundFile sound{info.samplerate, info.channels, {}};
  sound.interleaved.resize(static_cast<std::size_t>(info.frames * info.channels));
  const auto read = sf_readf_float(handle, sound.interleaved.data(), info.frames);
  sf_close(handle);
  if (read != info.frames) {
    return tl::unexpected(fmt::format("{}: ends after {} of {} frames; it was cut", path.string(), read, info.frames));
  }
  return sound;
}

}  // namespace rustle::sinks
