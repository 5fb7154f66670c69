#pragma once

#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include <sndfile.h>

#include "sound_db/dsp/random.h"

/// A folder of its own for each test, sound files and sounds with known answers.
namespace rustle::build::test {

class Folder {
 public:
  Folder() {
    static int number = 0;
    path_ = std::filesystem::temp_directory_path() /
            ("rustle_build_" + std::to_string(::getpid()) + "_" + std::to_string(number++));
    std::filesystem::create_directories(path_);
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

  void text(const std::string& name, const std::string& content) const {
    std::filesystem::create_directories((path_ / name).parent_path());
    std::ofstream(path_ / name, std::ios::binary) << content;
  }

  /// Samples of one channel, or of several, interleaved.
  void sound(const std::string& name, std::span<const float> samples, int rate_hz = 48000, int channels = 1,
             int format = SF_FORMAT_WAV | SF_FORMAT_FLOAT) const {
    std::filesystem::create_directories((path_ / name).parent_path());
    SF_INFO info{};
    info.samplerate = rate_hz;
    info.channels = channels;
    info.format = format;
    SNDFILE* file = sf_open((path_ / name).c_str(), SFM_WRITE, &info);
    sf_writef_float(file, samples.data(), static_cast<sf_count_t>(samples.size()) / channels);
    sf_close(file);
  }

 private:
  std::filesystem::path path_;
};

inline constexpr double kRate_hz = 48000;

inline std::vector<float> silence(double seconds) {
  return std::vector<float>(static_cast<std::size_t>(seconds * kRate_hz), 0.0f);
}

inline void add_noise(std::vector<float>& signal, double rms, std::uint64_t seed) {
  dsp::Random random(seed);
  for (float& x : signal) x += static_cast<float>(rms * random.normal());
}

/// Decaying noise from time_s on: full at once, 60 dB down after t60_s.
inline void add_burst(std::vector<float>& signal, double time_s, double amplitude, double t60_s, std::uint64_t seed) {
  dsp::Random random(seed);
  const auto start = static_cast<std::size_t>(time_s * kRate_hz);
  for (std::size_t n = 0; start + n < signal.size() && static_cast<double>(n) < 1.2 * t60_s * kRate_hz; ++n) {
    const double decay = std::pow(10.0, -3.0 * static_cast<double>(n) / kRate_hz / t60_s);
    signal[start + n] += static_cast<float>(amplitude * decay * random.uniform(-1, 1));
  }
}

/// The head of a manifest; entries follow.
inline std::string head(const std::string& more = "") {
  return "[pack]\nmaterial = \"test-paper\"\ntouched_surface = \"table\"\nlicence = \"CC0-1.0\"\norigin = \"a test\"\n" +
         more + "\n";
}

}  // namespace rustle::build::test
