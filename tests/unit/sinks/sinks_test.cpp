#include <catch2/catch.hpp>

#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "server/sinks/event_log.h"
#include "server/sinks/wav.h"

namespace sinks_test {

namespace {

using namespace rustle;

class Folder {
 public:
  Folder() : path_(std::filesystem::temp_directory_path() / ("rustle-sinks-" + std::to_string(::getpid()))) {
    std::filesystem::create_directories(path_);
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  std::filesystem::path operator/(const char* name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

TEST_CASE("A WAV file gives back what was written") {
  const Folder folder;
  std::vector<float> samples(2 * 3001);
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i] = static_cast<float>(std::sin(0.01 * static_cast<double>(i)));
  samples[7] = 1.5f;  // beyond full scale
  for (const auto& [format, tolerance] :
       {std::pair(sinks::WavFormat::kFloat32, 0.0), std::pair(sinks::WavFormat::kInt24, 2e-7),
        std::pair(sinks::WavFormat::kInt16, 4e-5)}) {
    auto wav = sinks::WavWriter::create(folder / "a.wav", 44100, 2, format);
    REQUIRE(wav);
    REQUIRE(wav->write(std::span(samples).first(2000)));
    REQUIRE(wav->write(std::span(samples).subspan(2000)));
    REQUIRE(wav->close());
    const auto back = sinks::read_sound_file(folder / "a.wav");
    REQUIRE(back);
    CHECK(back->rate_hz == 44100);
    CHECK(back->channels == 2);
    REQUIRE(back->interleaved.size() == samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const double wanted = format == sinks::WavFormat::kFloat32 ? samples[i] : std::min(samples[i], 1.0f);
      REQUIRE(back->interleaved[i] == Approx(wanted).margin(tolerance));
    }
  }
}

TEST_CASE("A WAV file that cannot be made says so") {
  const auto wav = sinks::WavWriter::create("/no/such/folder/a.wav", 48000, 1, sinks::WavFormat::kInt16);
  REQUIRE_FALSE(wav);
  CHECK(wav.error().find("/no/such/folder/a.wav") != std::string::npos);
}

observation::Observation frame(double time_s, double previous_s) {
  observation::Observation observed;
  observed.sheet = 3;
  observed.time_s = time_s;
  observed.previous_time_s = previous_s;
  return observed;
}

observation::FrictionContact contact(std::uint64_t id, double speed, double x) {
  observation::FrictionContact out;
  out.id = id;
  out.speed_m_per_s = speed;
  out.position_m = {x, 0, 0};
  observation::VertexContact touching;
  touching.vertex = static_cast<std::uint32_t>(10 * x);
  out.vertices.push_back(touching);
  return out;
}

TEST_CASE("A contact is one line with the mean of its speed and the place of its loudest moment") {
  sinks::EventLog log;
  const double speeds[] = {0.1, 0.3, 0.2};
  for (int k = 0; k < 3; ++k) {
    auto observed = frame(1.1 + 0.1 * k, 1.0 + 0.1 * k);
    observed.friction.push_back(contact(5, speeds[k], k + 1.0));
    observed.friction.push_back(contact(6, 0.0, 9.0));  // rests
    log.add(observed);
  }
  log.add(frame(1.4, 1.3));
  const auto events = log.finish();
  REQUIRE(events.size() == 1);
  CHECK(events[0].id == 5);
  CHECK(events[0].time_s == Approx(1.0));
  CHECK(events[0].end_s == Approx(1.3));
  CHECK(events[0].amplitude == Approx(0.2));
  CHECK(events[0].speed_m_per_s == Approx(0.3));
  CHECK(events[0].position_m.x() == 2.0);
  CHECK(events[0].speeds.size() == 3);
}

TEST_CASE("Events come in the order of time, as JSON lines with the promised fields") {
  const Folder folder;
  sinks::EventLog log;
  auto observed = frame(1.0, 0.9);
  observation::CrumplingEvent late, early;
  late.id = 1;
  late.time_s = 0.98;
  early.id = 2;
  early.continues = 1;
  early.time_s = 0.93;
  early.amplitude_m = 0.01;
  early.resonators.push_back({});
  observed.crumpling = {late, early};
  log.add(observed);
  const auto events = log.finish();
  REQUIRE(sinks::write_json_lines(folder / "e.jsonl", events));
  std::ifstream in(folder / "e.jsonl");
  std::string line;
  std::vector<nlohmann::json> lines;
  while (std::getline(in, line)) lines.push_back(nlohmann::json::parse(line));
  REQUIRE(lines.size() == 2);
  CHECK(lines[0]["id"] == 2);
  CHECK(lines[0]["continues"] == 1);
  CHECK(lines[1]["continues"].is_null());
  CHECK(lines[0]["kind"] == "crumpling");
  CHECK(lines[0]["amplitude_unit"] == "m");
  for (const auto* key :
       {"time_s", "end_s", "sheet", "area_m2", "position_m", "vertices", "source", "speed_m_per_s", "direction"}) {
    CHECK(lines[0].contains(key));
  }
  for (const auto* key : {"constrained", "coarse", "l_r_m", "l_c_m", "area_m2", "position_m", "normal"}) {
    CHECK(lines[0]["resonators"][0].contains(key));
  }
}

}  // namespace

}  // namespace sinks_test
