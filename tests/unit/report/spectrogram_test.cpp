#include "server/report/spectrogram.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <catch2/catch.hpp>

#include "server/report/levels.h"
#include "server/report/spectrogram_picture.h"
#include "tests/unit/report/synthetic_input.h"

namespace rustle::report::spectrogram_test {
namespace {

int brightest_row(const SpectrogramGrid& grid, int column) {
  int best = 0;
  for (int row = 1; row < grid.rows; ++row) {
    if (grid.at(row, column) > grid.at(best, column)) best = row;
  }
  return best;
}

double sum(std::uint32_t pixel) {
  return (pixel & 0xff) + ((pixel >> 8) & 0xff) + ((pixel >> 16) & 0xff);
}

}  // namespace

TEST_CASE("a tone is brightest at its frequency, at its level, at every rate and on both scales") {
  for (const double rate_hz : {44100.0, 48000.0, 96000.0}) {
    for (const FrequencyScale scale : {FrequencyScale::kLogarithmic, FrequencyScale::kLinear}) {
      const std::vector<float> samples = tone(1000, 0.1, 1, rate_hz, 2);
      const SpectrogramGrid grid = spectrogram_grid({samples, 2, rate_hz, 0}, 200, 300, scale);
      for (const int column : {10, 100, 190}) {
        const int row = brightest_row(grid, column);
        const double tolerance_hz = 25;
        CHECK(grid.row_hz(row) >= 1000 - tolerance_hz);
        CHECK(grid.row_hz(row + 1) <= 1000 + tolerance_hz);
        CHECK(grid.at(row, column) == Approx(-20).margin(1.5));
      }
    }
  }
}

TEST_CASE("in the picture's pixels too") {
  const std::vector<float> samples = tone(1000, 0.5, 1, 48000);
  const SpectrogramGrid grid = spectrogram_grid({samples, 1, 48000, 0}, 64, 200);
  const Image image = heat_image(grid, level_range(grid, {}));
  REQUIRE(image.width == 64);
  REQUIRE(image.height == 200);
  int best = 0;
  for (int row = 0; row < 200; ++row) {
    if (sum(image.pixels[static_cast<std::size_t>(row * 64 + 32)]) >
        sum(image.pixels[static_cast<std::size_t>(best * 64 + 32)])) {
      best = row;
    }
  }
  CHECK(grid.row_hz(best + 0.5) == Approx(1000).epsilon(0.03));
}

TEST_CASE("a click shows in its column only, however long the sound") {
  for (const double seconds : {0.4, 30.0}) {
    std::vector<float> samples(static_cast<std::size_t>(seconds * 48000), 0.0f);
    samples[samples.size() / 4] = 1;
    const SpectrogramGrid grid = spectrogram_grid({samples, 1, 48000, 0}, 400, 20);
    int loudest = 0;
    for (int column = 0; column < 400; ++column) {
      if (grid.at(10, column) > grid.at(10, loudest)) loudest = column;
      const double away_s = std::abs((column + 0.5) / 400 - 0.25) * seconds;
      if (away_s > 0.05 + seconds / 400) CHECK(grid.at(10, column) == kSilenceDb);
    }
    CHECK(std::abs(loudest - 100) <= 1);
  }
}

TEST_CASE("silence, no samples, values that are not finite and one lone sample give finite levels") {
  const std::vector<float> silence(4800, 0.0f), bad(4800, std::numeric_limits<float>::quiet_NaN()), lone = {0.5f};
  for (const Sound& sound : {Sound{}, Sound{silence}, Sound{bad}, Sound{lone}}) {
    const SpectrogramGrid grid = spectrogram_grid(sound, 30, 20);
    REQUIRE(grid.level_db.size() == 600);
    CHECK(std::all_of(grid.level_db.begin(), grid.level_db.end(),
                      [](float x) { return std::isfinite(x) && x >= kSilenceDb; }));
    const LevelRange range = level_range(grid, {});
    CHECK(range.top_db > range.floor_db);
  }
  const SpectrogramGrid grid = spectrogram_grid(Sound{silence}, 3, 3);
  CHECK(*std::max_element(grid.level_db.begin(), grid.level_db.end()) == kSilenceDb);
}

TEST_CASE("levels: a sine has its peak and an RMS 3 dB below, a window at a time") {
  std::vector<float> samples = tone(1000, 0.5, 1, 48000, 2);
  const LevelTrack track = level_track({samples, 2, 48000, 0});
  REQUIRE(track.rms_db.size() == 50);
  CHECK(track.total_peak_db == Approx(-6.02).margin(0.05));
  CHECK(track.total_rms_db == Approx(-9.03).margin(0.01));
  CHECK(track.rms_db[20] == Approx(-9.03).margin(0.01));
  CHECK(track.full_scale_samples == 0);

  samples[100] = 1.0f;
  samples[200] = -1.5f;
  samples[300] = std::numeric_limits<float>::infinity();
  const LevelTrack clipped = level_track({samples, 2, 48000, 0});
  CHECK(clipped.full_scale_samples == 2);
  CHECK(clipped.non_finite_samples == 1);
  CHECK(clipped.total_peak_db == Approx(3.52).margin(0.01));
  CHECK(std::isfinite(clipped.total_rms_db));
}

TEST_CASE("windows cover a sound whose length is no multiple of theirs, at a rate that is none either") {
  const std::vector<float> samples(44100 + 7, 0.25f);
  const LevelTrack track = level_track({samples, 1, 44100, 0}, 0.0203);
  CHECK(track.rms_db.size() == 50);
  for (const float rms_db : track.rms_db) CHECK(rms_db == Approx(-12.04).margin(0.01));
}

}  // namespace rustle::report::spectrogram_test
