#include "server/spatial/hrtf.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numbers>
#include <string>
#include <vector>

#include "server/spatial/dipole.h"
#include "server/spatial/hrtf_choice.h"
#include "server/spatial/measured_head.h"
#include "server/spatial/structural_head.h"
#include "sound_db/dsp/random.h"

namespace hrtf_test {

using namespace rustle::spatial;

namespace {

constexpr double kRate_hz = 48000;
constexpr double kTransit_s = kHeadRadius_m / kSpeedOfSound_m_per_s;
constexpr double kPi = std::numbers::pi;

const Hrtf& structural() {
  static const Hrtf head = structural_head(kRate_hz);
  return head;
}

/// KEMAR, or null where it is not installed.
const Hrtf* kemar() {
  static const auto head = load_hrtf(kKemarHrtf, kRate_hz);
  if (!head) WARN("KEMAR is not installed");
  return head ? head->get() : nullptr;
}

Vec3 towards(double azimuth_deg, double elevation_deg) {
  const double a = azimuth_deg * kPi / 180, e = elevation_deg * kPi / 180;
  return {std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e)};
}

std::vector<float> filter_of(const Hrtf& head, const Vec3& from, int ear) {
  std::vector<float> out(static_cast<std::size_t>(head.taps()));
  head.filter(head.place(from), ear, out);
  return out;
}

std::complex<double> response(const std::vector<float>& filter, double frequency_hz, double rate_hz = kRate_hz) {
  std::complex<double> sum = 0;
  for (std::size_t n = 0; n < filter.size(); ++n) {
    sum += static_cast<double>(filter[n]) * std::polar(1.0, -2 * kPi * frequency_hz / rate_hz * static_cast<double>(n));
  }
  return sum;
}

double db(double ratio) {
  return 20 * std::log10(std::max(ratio, 1e-12));
}

/// C7 as it is printed, for the left ear: shadow and pinna at one frequency, without the delay.
std::complex<double> printed(const Vec3& direction, double frequency_hz, double rate_hz) {
  const double theta = std::acos(direction.y);
  const double alpha = 1.05 + 0.95 * std::cos(1.2 * theta), w = 343 / (0.0875 * rate_hz);
  const double b0 = (alpha + w) / (1 + w), b1 = (w - alpha) / (1 + w), a1 = (w - 1) / (1 + w);
  const std::complex<double> z = std::polar(1.0, -2 * kPi * frequency_hz / rate_hz);
  const double azimuth = std::atan2(direction.y, direction.x), elevation = std::asin(direction.z);
  constexpr std::array rho{.5, -1., .5, -.25, .25}, a{1., 5., 5., 5., 5.}, b{2., 4., 7., 11., 13.}, d{1., .5, .5, .5, .5};
  std::complex<double> pinna = 1;
  for (std::size_t k = 0; k < rho.size(); ++k) {
    const double tau = a[k] * std::cos(azimuth / 2) * std::sin(d[k] * (kPi / 2 - elevation)) + b[k];
    pinna += rho[k] * std::polar(1.0, -2 * kPi * frequency_hz * tau / 44100);
  }
  return (b0 + b1 * z) / (1.0 + a1 * z) * pinna;
}

double printed_delay_s(const Vec3& direction) {
  const double theta = std::acos(direction.y);
  return theta < kPi / 2 ? -kTransit_s * std::cos(theta) : kTransit_s * (theta - kPi / 2);
}

/// Mean power over logarithmic frequency, both ears.
double power(const Hrtf& head, const Vec3& from) {
  double sum = 0;
  constexpr int kCount = 60;
  for (int k = 0; k < kCount; ++k) {
    const double f = 150 * std::pow(100.0, (k + 0.5) / kCount);
    for (int ear = 0; ear < 2; ++ear) sum += std::norm(response(filter_of(head, from, ear), f)) / (2 * kCount);
  }
  return sum;
}

}  // namespace

TEST_CASE("The structural model's filters and delays are C7's formulas, at every rate") {
  for (const double rate_hz : {44100.0, 48000.0, 96000.0}) {
    rustle::dsp::Random random(3);
    for (int k = 0; k < 40; ++k) {
      const Vec3 direction = normalized({random.normal(), random.normal(), random.normal()}, {1, 0, 0});
      const auto left = structural_response(direction, 0, rate_hz);
      CHECK(left.delay_s == Approx(printed_delay_s(direction) - kPinnaLead / rate_hz).margin(1e-9));
      for (double f = 100; f < 18000; f *= 1.09) {
        const std::complex<double> wanted = printed(direction, f, rate_hz);
        const auto got = response(left.filter, f, rate_hz) * std::polar(1.0, 2 * kPi * f * kPinnaLead / rate_hz);
        CHECK(std::abs(got - wanted) < 0.03 * (1 + std::abs(wanted)));
        if (std::abs(wanted) > 0.2) CHECK(std::abs(db(std::abs(got) / std::abs(wanted))) < 0.5);
      }
    }
  }
}

TEST_CASE("Between the grid's directions the structural model stays within half a dB and a sample of its formulas") {
  rustle::dsp::Random random(5);
  const double level =
      std::abs(response(filter_of(structural(), {1, 0, 0}, 0), 500)) / std::abs(printed({1, 0, 0}, 500, kRate_hz));
  for (int k = 0; k < 200; ++k) {
    const Vec3 direction = normalized({random.normal(), random.normal(), random.normal()}, {1, 0, 0});
    if (std::abs(direction.z) > 0.9) continue;
    const auto place = structural().place(direction);
    CHECK(std::abs(structural().delay_s(place, 0) + kPinnaLead / kRate_hz - printed_delay_s(direction)) < 1 / kRate_hz);
    const auto filter = filter_of(structural(), direction, 0);
    double sum = 0, worst = 0;
    int count = 0;
    for (double f = 100; f < 10000; f *= 1.15) {
      const double wanted = std::abs(printed(direction, f, kRate_hz));
      if (wanted < 0.4) continue;  // between the pinna's notches
      const double off = db(std::abs(response(filter, f)) / level / wanted);
      sum += std::abs(off);
      worst = std::max(worst, std::abs(off));
      ++count;
    }
    CHECK(worst < 1.0);
    CHECK(sum / std::max(1, count) < 0.25);
  }
}

TEST_CASE("What comes from the left reaches the left ear earlier and louder, by the size of a head") {
  for (const Hrtf* head : {&structural(), kemar()}) {
    if (!head) continue;
    double longest_s = 0;
    for (int azimuth = 6; azimuth < 180; azimuth += 6) {
      const auto place = head->place(towards(azimuth, 0));
      const double itd_s = head->delay_s(place, 1) - head->delay_s(place, 0);
      longest_s = std::max(longest_s, itd_s);
      CHECK(itd_s > 0);
      const auto left = filter_of(*head, towards(azimuth, 0), 0), right = filter_of(*head, towards(azimuth, 0), 1);
      double level = 0;
      for (double f = 1500; f < 8000; f *= 1.05) level += db(std::abs(response(left, f)) / std::abs(response(right, f)));
      if (azimuth >= 20 && azimuth <= 160) CHECK(level > 0);
      if (azimuth == 90) CHECK(level / 35 > 6);
    }
    const double model_s = kTransit_s * (kPi / 2 + 1);
    CHECK(model_s == Approx(0.656e-3).margin(0.001e-3));
    CHECK(longest_s == Approx(model_s).epsilon(head == &structural() ? 0.01 : 0.2));
  }
}

TEST_CASE("A mirrored direction swaps the ears; ahead they are alike") {
  rustle::dsp::Random random(8);
  for (int k = 0; k < 200; ++k) {
    const Vec3 from{random.normal(), random.normal(), random.normal()};
    const Vec3 mirrored{from.x, -from.y, from.z};
    const auto here = structural().place(from), there = structural().place(mirrored);
    for (int ear = 0; ear < 2; ++ear) {
      CHECK(structural().delay_s(here, ear) == structural().delay_s(there, 1 - ear));
      CHECK(filter_of(structural(), from, ear) == filter_of(structural(), mirrored, 1 - ear));
    }
  }
  if (const Hrtf* head = kemar()) {
    const auto ahead = head->place({1, 0, 0});
    CHECK(std::abs(head->delay_s(ahead, 0) - head->delay_s(ahead, 1)) < 0.5 / kRate_hz);
    const auto left = filter_of(*head, {1, 0, 0}, 0), right = filter_of(*head, {1, 0, 0}, 1);
    for (double f = 100; f < 16000; f *= 1.1) {
      CHECK(std::abs(db(std::abs(response(left, f)) / std::abs(response(right, f)))) < 1.0);
    }
  }
}

TEST_CASE("Straight ahead has the mono level, and sound from everywhere about the same power") {
  for (const Hrtf* head : {&structural(), kemar()}) {
    if (!head) continue;
    CHECK(std::abs(10 * std::log10(power(*head, {1, 0, 0}))) < 0.3);
    double sum = 0;
    constexpr int kPoints = 300;
    for (int k = 0; k < kPoints; ++k) {
      const double z = 1 - (2 * k + 1.0) / kPoints, turn = k * kPi * (3 - std::sqrt(5.0)), r = std::sqrt(1 - z * z);
      sum += power(*head, {r * std::cos(turn), r * std::sin(turn), z}) / kPoints;
    }
    CHECK(std::abs(10 * std::log10(sum)) < 3.0);
  }
}

TEST_CASE("A measured head's diffuse field is flat") {
  const Hrtf* head = kemar();
  if (!head) return;
  std::vector<double> mean;
  std::vector<double> frequencies;
  for (double f = 150; f < 15000; f *= 1.19) frequencies.push_back(f);
  mean.resize(frequencies.size());
  for (int k = 0; k < 400; ++k) {
    const double z = 1 - (2 * k + 1.0) / 400, turn = k * kPi * (3 - std::sqrt(5.0)), r = std::sqrt(1 - z * z);
    for (int ear = 0; ear < 2; ++ear) {
      const auto filter = filter_of(*head, {r * std::cos(turn), r * std::sin(turn), z}, ear);
      for (std::size_t n = 0; n < mean.size(); ++n) mean[n] += std::norm(response(filter, frequencies[n]));
    }
  }
  const auto [least, most] = std::minmax_element(mean.begin(), mean.end());
  CHECK(10 * std::log10(*most / *least) < 3.0);
}

TEST_CASE("Elevation changes the spectrum") {
  for (const Hrtf* head : {&structural(), kemar()}) {
    if (!head) continue;
    const auto level = filter_of(*head, towards(0, 0), 0), above = filter_of(*head, towards(0, 60), 0);
    double most_db = 0;
    for (double f = 3000; f < 14000; f *= 1.03) {
      most_db = std::max(most_db, std::abs(db(std::abs(response(level, f)) / std::abs(response(above, f)))));
    }
    CHECK(most_db > 3);
  }
}

TEST_CASE("Filters and delays change little by little as a source moves, over poles, behind and at the seam") {
  for (const Hrtf* head : {&structural(), kemar()}) {
    if (!head) continue;
    for (const auto& [start, axis] : {std::pair(towards(0, 0), Vec3{0, 0, 1}), std::pair(towards(0, 0), Vec3{0, 1, 0}),
                                      std::pair(towards(37, 20), normalized({1, 2, -0.5}, {1, 0, 0}))}) {
      std::vector<float> before;
      double delay_before_s = 0;
      for (int step = 0; step <= 3600; ++step) {
        const double turn = step * kPi / 1800;
        const Vec3 at =
            std::cos(turn) * start + std::sin(turn) * cross(axis, start) + ((1 - std::cos(turn)) * dot(axis, start)) * axis;
        const auto place = head->place(at);
        const auto filter = filter_of(*head, at, 0);
        const double delay_s = head->delay_s(place, 0);
        if (step > 0) {
          float change = 0;
          for (std::size_t n = 0; n < filter.size(); ++n) change = std::max(change, std::abs(filter[n] - before[n]));
          REQUIRE(change < 0.05F);
          REQUIRE(std::abs(delay_s - delay_before_s) < 5e-6);
        }
        before = filter;
        delay_before_s = delay_s;
      }
    }
  }
}

TEST_CASE("Within the head delays shrink to nothing, and its centre is a place") {
  const auto outside = structural().place({0, 0.2, 0}), inside = structural().place({0, kHeadRadius_m / 4, 0});
  CHECK(structural().delay_s(inside, 1) == Approx(structural().delay_s(outside, 1) / 4));
  const auto centre = structural().place({0, 0, 0});
  CHECK(structural().delay_s(centre, 0) == 0);
  CHECK(filter_of(structural(), {0, 0, 0}, 0) == filter_of(structural(), {1, 0, 0}, 0));
}

TEST_CASE("A file that is no measured head is refused in a sentence that names it and the remedy") {
  const auto folder = std::filesystem::temp_directory_path() / "rustle_hrtf_test";
  std::filesystem::create_directories(folder);
  const auto refused = [&](const std::filesystem::path& file) {
    const auto head = measured_head(file, kRate_hz);
    REQUIRE_FALSE(head);
    CHECK(head.error().find(file.string()) != std::string::npos);
    CHECK(head.error().find("structural") != std::string::npos);
  };
  refused(folder / "nothing.sofa");
  const auto text = folder / "text.sofa";
  std::ofstream(text) << "no HDF5 at all, however long it goes on and on\n";
  refused(text);
  if (!kemar_file().empty()) {
    std::ifstream whole(kemar_file(), std::ios::binary);
    const std::vector<char> bytes((std::istreambuf_iterator<char>(whole)), {});
    for (const double share : {0.001, 0.1, 0.5, 0.9}) {
      const auto cut = folder / "cut.sofa";
      std::ofstream(cut, std::ios::binary)
          .write(bytes.data(), static_cast<std::streamsize>(share * static_cast<double>(bytes.size())));
      refused(cut);
    }
  }
  std::filesystem::remove_all(folder);
  const auto unknown = load_hrtf("no-such-head", kRate_hz);
  REQUIRE_FALSE(unknown);
  CHECK(unknown.error().find("no-such-head") != std::string::npos);
}

}  // namespace hrtf_test
