#pragma once

#include <fcntl.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <bit>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// SuperCollider's server as a reference: scsynth (Debian's supercollider-server) renders PlayBuf voices in its
/// non-real-time mode; what it computes is the CPU time of its process.
namespace rustle::bench {

/// Big-endian bytes, as SuperCollider's files have them.
class Bytes {
 public:
  Bytes& i8(int x) { return integer(static_cast<std::uint8_t>(x), 1); }
  Bytes& i16(int x) { return integer(static_cast<std::uint16_t>(x), 2); }
  Bytes& i32(int x) { return integer(static_cast<std::uint32_t>(x), 4); }
  Bytes& i64(std::uint64_t x) { return integer(x, 8); }
  Bytes& f32(float x) { return integer(std::bit_cast<std::uint32_t>(x), 4); }
  Bytes& raw(std::string_view text) {
    data += text;
    return *this;
  }
  /// Its length in a byte, then the text.
  Bytes& pascal(std::string_view text) { return i8(static_cast<int>(text.size())).raw(text); }
  /// Ended by zeros, to a multiple of four (OSC).
  Bytes& padded(std::string_view text) {
    raw(text);
    data.append(4 - text.size() % 4, '\0');
    return *this;
  }

  std::string data;

 private:
  Bytes& integer(std::uint64_t x, int bytes) {
    for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8) data += static_cast<char>(x >> shift & 0xff);
    return *this;
  }
};

/// SynthDef "voice" (SCgf version 2): Out.ar(0, PlayBuf.ar(1, buf, rate: 1.0001, loop: 1)). At that rate no position is a
/// whole sample, so that PlayBuf interpolates: it is cubic, over four samples.
inline std::string playbuf_definition() {
  constexpr int kControlRate = 1;
  constexpr int kAudioRate = 2;
  Bytes b;
  b.raw("SCgf").i32(2).i16(1).pascal("voice");
  b.i32(3).f32(1.0001f).f32(1).f32(0);
  b.i32(1).f32(0).i32(1).pascal("buf").i32(0);
  b.i32(3);
  b.pascal("Control").i8(kControlRate).i32(0).i32(1).i16(0).i8(kControlRate);
  b.pascal("PlayBuf").i8(kAudioRate).i32(6).i32(1).i16(0);
  b.i32(0).i32(0);                                                     // the buffer: output 0 of unit 0
  for (const int constant : {0, 1, 2, 1, 2}) b.i32(-1).i32(constant);  // rate, trigger, start, loop, done action
  b.i8(kAudioRate);
  b.pascal("Out").i8(kAudioRate).i32(2).i32(0).i16(0).i32(-1).i32(2).i32(1).i32(0);
  b.i16(0);
  return b.data;
}

/// A score of `voices` looping PlayBuf voices over the buffers in turn, for a time.
inline std::string playbuf_score(int voices, int buffers, double duration_s, const std::filesystem::path& folder) {
  std::string score;
  const auto bundle = [&](double time_s, const std::vector<std::string>& messages) {
    Bytes b;
    b.padded("#bundle").i64(static_cast<std::uint64_t>(time_s * 4294967296.0));
    for (const std::string& message : messages) b.i32(static_cast<int>(message.size())).raw(message);
    Bytes size;
    size.i32(static_cast<int>(b.data.size()));
    score += size.data + b.data;
  };
  const std::string definition = playbuf_definition();
  Bytes receive;
  receive.padded("/d_recv").padded(",b").i32(static_cast<int>(definition.size())).raw(definition);
  receive.data.append((4 - definition.size() % 4) % 4, '\0');
  bundle(0, {receive.data});
  for (int k = 0; k < buffers; ++k) {
    const std::string file = (folder / (std::to_string(k) + ".wav")).string();
    bundle(0, {Bytes().padded("/b_allocRead").padded(",is").i32(k).padded(file).data});
  }
  for (int k = 0; k < voices; ++k) {
    bundle(0, {Bytes()
                   .padded("/s_new")
                   .padded(",siiisf")
                   .padded("voice")
                   .i32(1000 + k)
                   .i32(1)
                   .i32(0)
                   .padded("buf")
                   .f32(static_cast<float>(k % buffers))
                   .data});
  }
  bundle(duration_s, {Bytes().padded("/n_free").padded(",i").i32(-1).data});
  return score;
}

/// 16-bit mono.
inline void write_wav(const std::filesystem::path& path, std::span<const float> samples, int rate_hz) {
  std::string data;
  const auto little = [&](std::uint32_t x, int bytes) {
    for (int k = 0; k < bytes; ++k) data += static_cast<char>(x >> (8 * k) & 0xff);
  };
  const auto bytes = static_cast<std::uint32_t>(2 * samples.size());
  data += "RIFF";
  little(36 + bytes, 4);
  data += "WAVEfmt ";
  little(16, 4);
  little(1, 2);
  little(1, 2);
  little(static_cast<std::uint32_t>(rate_hz), 4);
  little(static_cast<std::uint32_t>(2 * rate_hz), 4);
  little(2, 2);
  little(16, 2);
  data += "data";
  little(bytes, 4);
  for (const float x : samples) little(static_cast<std::uint16_t>(static_cast<std::int16_t>(32767 * x)), 2);
  std::ofstream(path, std::ios::binary) << data;
}

/// scsynth in a folder of its own, which goes with it.
class Scsynth {
 public:
  /// Units as its buffers.
  Scsynth(const std::vector<std::vector<float>>& units, int rate_hz)
      : buffers_(static_cast<int>(units.size())), rate_hz_(rate_hz) {
    std::string name = (std::filesystem::temp_directory_path() / "rustle-bench-XXXXXX").string();
    if (mkdtemp(name.data())) folder_ = name;
    for (std::size_t k = 0; k < units.size(); ++k) write_wav(folder_ / (std::to_string(k) + ".wav"), units[k], rate_hz);
  }
  ~Scsynth() {
    std::error_code ignored;
    if (!folder_.empty()) std::filesystem::remove_all(folder_, ignored);
  }
  Scsynth(const Scsynth&) = delete;
  Scsynth& operator=(const Scsynth&) = delete;

  static bool installed() { return access(kProgram, X_OK) == 0; }

  /// CPU time of the process that renders so many voices, in seconds; nothing where it failed.
  std::optional<double> run(int voices, double duration_s) const {
    std::ofstream(folder_ / "score", std::ios::binary) << playbuf_score(voices, buffers_, duration_s, folder_);
    const std::string rate = std::to_string(rate_hz_), score = (folder_ / "score").string();
    const std::string out = (folder_ / "out.wav").string();
    const std::vector<std::string> words = {"scsynth", "-N", score, "_",  out,  "48000", "WAV", "float", "-o", "1",
                                            "-i",      "0",  "-z",  "64", "-n", "4096",  "-m",  "65536", "-b", "1024"};
    std::vector<char*> arguments;
    std::vector<std::string> copy = words;
    copy[5] = rate;
    for (std::string& word : copy) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    posix_spawn_file_actions_t quiet;
    posix_spawn_file_actions_init(&quiet);
    posix_spawn_file_actions_addopen(&quiet, 1, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&quiet, 2, "/dev/null", O_WRONLY, 0);
    pid_t child = 0;
    const int failed = posix_spawn(&child, kProgram, &quiet, nullptr, arguments.data(), environ);
    posix_spawn_file_actions_destroy(&quiet);
    rusage used{};
    int status = 0;
    if (failed != 0 || wait4(child, &status, 0, &used) != child || !WIFEXITED(status) || WEXITSTATUS(status) != 0)
      return std::nullopt;
    const auto rendered = std::filesystem::file_size(folder_ / "out.wav");
    if (static_cast<double>(rendered) < 4 * duration_s * rate_hz_) return std::nullopt;
    const auto seconds = [](const timeval& t) {
      return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_usec) * 1e-6;
    };
    return seconds(used.ru_utime) + seconds(used.ru_stime);
  }

 private:
  static constexpr const char* kProgram = "/usr/bin/scsynth";
  int buffers_;
  int rate_hz_;
  std::filesystem::path folder_;
};

}  // namespace rustle::bench
