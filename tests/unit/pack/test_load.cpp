#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "sound_db/dsp/level.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/pack/audio_file.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/npy.h"
#include "sound_db/pack/spectra.h"
#include "sound_db/pack/write.h"
#include "tests/unit/pack/example_pack.h"

namespace test_load {

using namespace rustle;
using namespace rustle::pack;
using Catch::Matchers::Contains;
using nlohmann::json;

namespace {

/// A written example whose manifest a test can change.
struct Written {
  TemporaryFolder folder;
  std::filesystem::path path = folder.path() / "pack";
  explicit Written(const SoundPack& pack = example_pack()) { REQUIRE(write(pack, path)); }
  json manifest() const { return json::parse(read_bytes(path / "pack.json")); }
  void manifest(const json& changed) const { write_bytes(path / "pack.json", changed.dump()); }
  std::string reason() const {
    const auto pack = load(path, 48000);
    return pack ? std::string() : pack.error().text();
  }
};

bool has(const Findings& findings, Severity severity, const std::string& part) {
  for (const Finding& f : findings) {
    if (f.severity == severity && f.what.text().find(part) != std::string::npos) return true;
  }
  return false;
}

}  // namespace

TEST_CASE("a pack comes back as it was written") {
  for (const std::string extension : {".wav", ".flac"}) {
    const SoundPack original = example_pack(extension);
    const Written written(original);
    const auto loaded = load(written.path, 48000);
    REQUIRE(loaded);
    const SoundPack& pack = **loaded;
    CHECK(pack.name == original.name);
    CHECK(pack.material == "vellum");
    CHECK(pack.touched_surface == "slate");
    CHECK(pack.licence == "CC0-1.0");
    CHECK(pack.rate_hz == 48000);
    CHECK(pack.notices.empty());
    REQUIRE(pack.crumpling);
    REQUIRE(pack.friction);
    CHECK(pack.friction->speed_exponent == 0.75);
    CHECK(pack.friction->geometry.elevation_deg == 30);
    CHECK(pack.friction->geometry.plane);
    REQUIRE(pack.crumpling->units.size() == 6);
    REQUIRE(pack.friction->spectra.size() == 3);
    for (std::size_t i = 0; i < 6; ++i) {
      const auto& a = pack.crumpling->units[i].samples;
      const auto& b = original.crumpling->units[i].samples;
      CHECK(pack.crumpling->units[i].point == original.crumpling->units[i].point);
      REQUIRE(a.size() == b.size());
      for (std::size_t n = 0; n < a.size(); ++n) REQUIRE(a[n] == Approx(b[n]).margin(extension == ".wav" ? 1e-7 : 3e-6));
    }
    for (std::size_t i = 0; i < 3; ++i)
      CHECK(pack.friction->spectra[i].magnitudes == original.friction->spectra[i].magnitudes);
  }
}

TEST_CASE("writing twice gives the same bytes") {
  const SoundPack original = example_pack(".flac");
  const Written a(original), b(original);
  REQUIRE(write(original, a.path));
  int files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(a.path)) {
    if (!entry.is_regular_file()) continue;
    CHECK(read_bytes(entry.path()) == read_bytes(b.path / entry.path().lexically_relative(a.path)));
    ++files;
  }
  CHECK(files == 10);
}

TEST_CASE("a folder with something else in it is not replaced") {
  const TemporaryFolder folder;
  write_bytes(folder.path() / "thesis.txt", "years of work");
  const auto done = write(example_pack(), folder.path());
  REQUIRE_FALSE(done);
  CHECK_THAT(done.error().text(), Contains("not a sound pack"));
  CHECK(read_bytes(folder.path() / "thesis.txt") == "years of work");
}

TEST_CASE("the same sound below 20 kHz at 44.1, 48 and 96 kHz") {
  const Written written;
  const auto reference = *load(written.path, 48000);
  for (const std::uint32_t rate : {44100u, 96000u}) {
    const auto loaded = load(written.path, rate);
    REQUIRE(loaded);
    const SoundPack& pack = **loaded;
    CHECK(pack.rate_hz == rate);
    CHECK(pack.stored_rate_hz == 48000);
    CHECK(pack.friction->rate_hz == rate);
    for (std::size_t i = 0; i < 6; ++i) {
      const auto& a = pack.crumpling->units[i].samples;
      CHECK(a.size() == std::lround(480.0 * rate / 48000));
      const auto &here = a, &there = reference->crumpling->units[i].samples;
      CHECK(dsp::rms_dbfs(here) == Approx(dsp::rms_dbfs(there)).margin(0.1));
    }
    for (std::size_t i = 0; i < 3; ++i) {
      // Power density M²/rate, interpolated at the same frequencies.
      const auto& here = pack.friction->spectra[i].magnitudes;
      const auto& there = reference->friction->spectra[i].magnitudes;
      for (double f = 200; f < 20000; f += 100) {
        const auto density_db = [f](const std::vector<float>& m, double r) {
          const double at = f / (r / 1024);
          const auto k = static_cast<std::size_t>(at);
          const double value = m[k] + (at - static_cast<double>(k)) * (m[k + 1] - m[k]);
          return 10 * std::log10(value * value / r);
        };
        REQUIRE(density_db(here, rate) == Approx(density_db(there, 48000)).margin(0.1));
      }
    }
  }
}

TEST_CASE("resampled spectra keep power: in any band, at any FFT size; nothing above the old Nyquist frequency") {
  std::vector<float> magnitudes;
  for (int k = 0; k <= 512; ++k) magnitudes.push_back(static_cast<float>(1 + 0.5 * std::sin(k * 0.15)));
  const double rms = noise_rms(magnitudes);
  CHECK(noise_rms(std::vector<float>(513, 1.0f)) == Approx(1));
  for (const int bins : {33, 65, 257, 1025, 4097}) {
    CHECK(noise_rms(resampled_spectrum(magnitudes, 48000, bins, 48000)) == Approx(rms).epsilon(0.01));
  }
  CHECK(resampled_spectrum(magnitudes, 48000, 513, 48000) == magnitudes);
  const auto wide = resampled_spectrum(magnitudes, 48000, 1025, 96000);
  CHECK(noise_rms(wide) == Approx(rms).epsilon(0.01));
  for (std::size_t k = 515; k < wide.size(); ++k) CHECK(wide[k] == 0);
}

TEST_CASE("emission over the reference transfer is what was heard; flat sheets by their direct path") {
  const SoundPack pack = example_pack();
  const FrictionSection& friction = *pack.friction;
  for (const Spectrum& spectrum : friction.spectra) {
    const auto emission = emission_spectrum(friction, spectrum, 513, 48000);
    std::vector<double> frequencies;
    for (int k = 0; k <= 512; ++k) frequencies.push_back(46.875 * k);
    const auto h = reference_transfer(friction.geometry, spectrum.point, frequencies);
    for (std::size_t k = 0; k < 513; ++k) REQUIRE(emission[k] * h[k] == Approx(spectrum.magnitudes[k]).epsilon(1e-5));
    if (spectrum.point.constrained()) CHECK(h[100] == Approx(0.5));
  }
}

TEST_CASE("the transfer of a dipole over a plane has its limits") {
  // No plane to speak of: both paths incoherent, √(g₀² + g₁²) with g ≈ sin 30° each.
  const DipoleOverPlane blurred{0.05, 0.03, 1.0, 30.0};
  CHECK(transfer_magnitude(blurred, 20000) == Approx(std::sqrt(0.5)).epsilon(0.02));
  // Touching the plane the two sides cancel.
  const DipoleOverPlane low{0.002, 0, 1.0, 30.0};
  CHECK(dsp::gain_to_db(transfer_magnitude(low, 500) / 0.5) < -30);
  // First maximum where the paths differ by half a wave: 2 h sin 30° = λ/2.
  const DipoleOverPlane point{0.05, 0, 1.0, 30.0};
  CHECK(transfer_magnitude(point, 343.0 / (2 * 0.05)) == Approx(1.0).epsilon(0.03));
}

TEST_CASE("the reference amplitude of the 10 x 10 cm sheet is about 0.16 m") {
  const CrumplingSection section;
  CHECK(section.reference_amplitude_m({0.10, 0.20}) == Approx(0.16).margin(0.005));
  CHECK(section.reference_amplitude_m({}) == section.constrained_reference_amplitude_m);
  CHECK(section.reference_amplitude_m({0.2, 0.2}) == Approx(2 * section.reference_amplitude_m({0.1, 0.2})));
}

TEST_CASE("every prefix of pack.json is an error") {
  const Written written;
  const std::string whole = read_bytes(written.path / "pack.json");
  const std::size_t end = whole.rfind('}');
  for (std::size_t length = 0; length <= end; ++length) {
    write_bytes(written.path / "pack.json", whole.substr(0, length));
    const auto pack = load(written.path, 48000);
    REQUIRE_FALSE(pack);
    REQUIRE_THAT(pack.error().text(), Contains("pack.json"));
  }
}

TEST_CASE("every prefix of a unit is an error that names the file") {
  for (const std::string extension : {".wav", ".flac"}) {
    const Written written(example_pack(extension));
    const auto file = written.path / ("units/3" + extension);
    const std::string whole = read_bytes(file);
    for (std::size_t length = 0; length < whole.size(); ++length) {
      write_bytes(file, whole.substr(0, length));
      REQUIRE_FALSE(read_clip(file));
      if (length % 97 == 0) REQUIRE_THAT(written.reason(), Contains("units/3"));
    }
  }
}

TEST_CASE("any changed byte of a unit, a spectrum or the manifest loads or fails, but does neither with a NaN nor a crash") {
  dsp::Random random(9);
  for (const std::string name : {"units/2.wav", "units/2.flac", "spectra/4.npy", "pack.json"}) {
    const Written written(example_pack(name == "units/2.flac" ? ".flac" : ".wav"));
    const std::string whole = read_bytes(written.path / name);
    for (int i = 0; i < 300; ++i) {
      std::string changed = whole;
      const auto reach = static_cast<std::uint32_t>(i % 2 ? whole.size() : std::min<std::size_t>(whole.size(), 90));
      changed[random.index(reach)] = static_cast<char>(random.index(256));
      write_bytes(written.path / name, changed);
      const auto pack = load(written.path, 48000);
      if (!pack) {
        CHECK_FALSE(pack.error().message.empty());
        continue;
      }
      for (const Unit& unit : (*pack)->crumpling ? (*pack)->crumpling->units : std::vector<Unit>{}) {
        for (const float x : unit.samples) REQUIRE(std::isfinite(x));
      }
    }
  }
}

TEST_CASE("a manifest with a wrong type or value says which field") {
  const Written written;
  const json good = written.manifest();
  const auto reason = [&](const std::string& pointer, const json& value) {
    json changed = good;
    changed[json::json_pointer(pointer)] = value;
    written.manifest(changed);
    return written.reason();
  };
  CHECK_THAT(reason("/format", "zip"), Contains("format"));
  CHECK_THAT(reason("/format_version", 2), Contains("update Rustle"));
  CHECK_THAT(reason("/material", 3), Contains("material: is 3"));
  CHECK_THAT(reason("/rate_hz", -48000), Contains("rate_hz"));
  CHECK_THAT(reason("/rate_hz", "48000"), Contains("rate_hz"));
  CHECK_THAT(reason("/crumpling", json::array()), Contains("crumpling"));
  CHECK_THAT(reason("/crumpling/units", "all"), Contains("crumpling.units"));
  CHECK_THAT(reason("/crumpling/units/1", 7), Contains("crumpling.units[1]"));
  CHECK_THAT(reason("/crumpling/units/1/l_r_m", nullptr), Contains("crumpling.units[1].l_r_m"));
  CHECK_THAT(reason("/crumpling/units/1/l_r_m", -0.1), Contains("crumpling.units[1].l_r_m"));
  CHECK_THAT(reason("/crumpling/units/1/l_r_m", 0.1), Contains("crumpling.units[1].l_r_m"));
  CHECK_THAT(reason("/crumpling/units/1/file", "../../etc/passwd"), Contains("out of the pack"));
  CHECK_THAT(reason("/crumpling/units/1/file", "/etc/passwd"), Contains("out of the pack"));
  CHECK_THAT(reason("/crumpling/units/1/file", "units"), Contains("not a file"));
  CHECK_THAT(reason("/crumpling/units/1/file", "units/none.wav"), Contains("units/none.wav"));
  CHECK_THAT(reason("/crumpling/units/1/file", "pack.json"), Contains("pack.json"));
  CHECK_THAT(reason("/friction/fft_size", 1e9), Contains("friction.fft_size"));
  CHECK_THAT(reason("/friction/fft_size", 512), Contains("expected 257"));
  CHECK_THAT(reason("/friction/geometry/elevation_deg", 0), Contains("friction.geometry.elevation_deg"));
  CHECK_THAT(reason("/friction/spectra/0/row", 0), Contains("expected rows of"));
  CHECK_THAT(reason("/friction/gain_db", 500), Contains("friction.gain_db"));
  write_bytes(written.path / "pack.json", "[1, 2]");
  CHECK_THAT(written.reason(), Contains("not a JSON object"));
  write_bytes(written.path / "pack.json", R"({"format": "rustle-pack", "format_version": 1e999})");
  CHECK_FALSE(written.reason().empty());
  write_bytes(written.path / "pack.json", std::string(200000, '['));
  CHECK_FALSE(written.reason().empty());
  CHECK_FALSE(load(written.folder.path() / "nowhere", 48000));
  CHECK_FALSE(load(written.path, 0));
}

TEST_CASE("a link out of the pack, a NaN in a unit and a negative magnitude are refused") {
  const Written written;
  const auto unit = written.path / "units/1.wav";
  REQUIRE(write_clip(unit, std::vector<float>(100, std::numeric_limits<float>::quiet_NaN()), 48000));
  CHECK_THAT(written.reason(), Contains("finite"));
  std::filesystem::remove(unit);
  REQUIRE(write_clip(written.folder.path() / "outside.wav", std::vector<float>(100, 0.1f), 48000));
  std::filesystem::create_symlink(written.folder.path() / "outside.wav", unit);
  CHECK_THAT(written.reason(), Contains("link"));
  const Written negative;
  std::vector<float> magnitudes(513, 0.1f);
  magnitudes[7] = -0.1f;
  REQUIRE(write_npy(negative.path / "spectra/4.npy", magnitudes));
  CHECK_THAT(negative.reason(), Contains("below 0"));
}

TEST_CASE("unknown sections and later versions are left alone with a notice") {
  const Written written;
  json changed = written.manifest();
  changed["tearing"] = {{"version", 1}};
  changed["friction"]["version"] = 2;
  written.manifest(changed);
  const auto pack = load(written.path, 48000);
  REQUIRE(pack);
  CHECK_FALSE((*pack)->friction);
  CHECK((*pack)->crumpling);
  REQUIRE((*pack)->notices.size() == 2);
  CHECK_THAT((*pack)->notices[0], Contains("friction has version 2"));
  CHECK_THAT((*pack)->notices[1], Contains("tearing"));
}

TEST_CASE("rows of a two-dimensional array serve as spectra, and gain_db is applied") {
  const Written written;
  const auto before = *load(written.path, 48000);
  std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 513), }";
  std::string bytes = "\x93NUMPY";
  bytes += {'\x01', '\0', static_cast<char>(header.size()), '\0'};
  std::vector<float> both(513, 0.25f);
  both.resize(1026, 0.5f);
  bytes += header;
  bytes.append(std::string_view(reinterpret_cast<const char*>(both.data()), both.size() * 4));
  write_bytes(written.path / "spectra/all.npy", bytes);
  json changed = written.manifest();
  changed["friction"]["spectra"][1]["file"] = "spectra/all.npy";
  changed["friction"]["spectra"][1]["row"] = 1;
  changed["friction"]["gain_db"] = -6.0206;
  changed["crumpling"]["gain_db"] = changed["crumpling"]["gain_db"].get<double>() + 20;
  written.manifest(changed);
  const auto after = load(written.path, 48000);
  REQUIRE(after);
  for (const float m : (*after)->friction->spectra[1].magnitudes) REQUIRE(m == Approx(0.25f).epsilon(1e-4));
  CHECK(dsp::peak((*after)->crumpling->units[0].samples) ==
        Approx(10 * dsp::peak(before->crumpling->units[0].samples)).epsilon(1e-4));
}

TEST_CASE("a check finds what will not sound as meant, and every error at once") {
  const Written written;
  CHECK_FALSE(has(check(written.path), Severity::kError, ""));
  json changed = written.manifest();
  changed["crumpling"]["units"].erase(0);
  changed["crumpling"]["units"].erase(0);
  changed["crumpling"]["units"].erase(0);
  changed["friction"]["spectra"][1] = changed["friction"]["spectra"][2];
  changed["crumpling"]["gain_dB"] = 3;
  changed["crumpling"]["gain_db"] = 40;
  written.manifest(changed);
  const auto findings = check(written.path);
  CHECK(has(findings, Severity::kWarning, "constrained events are silent"));
  CHECK(has(findings, Severity::kWarning, "one unit at l_r 5 cm"));
  CHECK(has(findings, Severity::kWarning, "second spectrum"));
  CHECK(has(findings, Severity::kWarning, "gain_dB"));
  CHECK(has(findings, Severity::kWarning, "the reference flap peaks"));
  CHECK(has(findings, Severity::kWarning, "not named in pack.json"));
  CHECK_FALSE(has(findings, Severity::kError, ""));
  write_bytes(written.path / "units/4.wav", "RIFF");
  write_bytes(written.path / "spectra/2.npy", "");
  const auto errors = check(written.path);
  CHECK(has(errors, Severity::kError, "units/4.wav"));
  CHECK(has(errors, Severity::kError, "spectra/2.npy"));
}

}  // namespace test_load
