#include "sound_db/generate/generate.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <string>
#include <thread>

#include <fmt/format.h>

#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"
#include "sound_db/generate/cloth.h"
#include "sound_db/generate/cloth_material.h"
#include "sound_db/generate/crumpling_unit.h"
#include "sound_db/generate/friction_spectrum.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/levels.h"
#include "sound_db/pack/write.h"

namespace rustle::generate {

namespace {

enum PaperStream : std::uint64_t { kFlapStream = 1, kClacStream = 2 };

/// Kurtosis 3 exp(4 σ²) = 5.3 of steady sliding; real slides have 4 to 6, and pushes by hand, from rest to rest, 7.7 and
/// more.
constexpr double kSlidingGainSigma = 0.38;

/// Σ A |ΔH| of a ridge that folds over: ½ angle x length, 0.7 rad on a facet of 11 mm.
constexpr double kClacAmplitude_m = 0.004;

std::string file_name(const pack::GridPoint& point) {
  return fmt::format("r{:03.0f}_c{:03.0f}", 1000 * point.ruling_length_m, 1000 * point.free_border_length_m);
}

/// A flap depends on its place and its number only, whatever else is made.
std::vector<float> numbered_flap(const Paper& paper, const pack::GridPoint& point, int number, const Options& options,
                                 Workspace& workspace) {
  const auto place = static_cast<std::uint64_t>(std::llround(1e4 * point.ruling_length_m)) << 20 |
                     static_cast<std::uint64_t>(std::llround(1e4 * point.free_border_length_m));
  const std::uint64_t stream = dsp::hash(options.seed, kFlapStream, place);
  return flap(paper, point, options.rate_hz, dsp::Random(dsp::hash(stream, static_cast<std::uint64_t>(number))), workspace);
}

void run_jobs(const std::vector<std::function<void(Workspace&)>>& jobs, unsigned threads, const Progress& progress) {
  std::atomic<std::size_t> next{0};
  std::mutex reporting;
  std::size_t done = 0;
  const auto work = [&] {
    Workspace workspace;
    for (std::size_t i = next++; i < jobs.size(); i = next++) {
      jobs[i](workspace);
      const std::lock_guard lock(reporting);
      ++done;
      if (progress) progress(static_cast<double>(done) / static_cast<double>(jobs.size()));
    }
  };
  if (threads == 0) threads = std::clamp(std::thread::hardware_concurrency(), 1u, 8u);
  std::vector<std::jthread> helpers;
  for (unsigned t = 1; t < threads; ++t) helpers.emplace_back(work);
  work();
}

}  // namespace

std::vector<pack::GridPoint> full_grid() {
  constexpr double kEdges_m[] = {0.025, 0.05, 0.075, 0.10, 0.125, 0.15, 0.20, 0.25, 0.30};
  std::vector<pack::GridPoint> grid;
  for (const double ruling_m : kEdges_m) {
    for (const double edge_m : kEdges_m) grid.push_back({ruling_m, 2 * edge_m});
  }
  return grid;
}

pack::SoundPack make_pack(const Paper& paper, const Options& options, const Progress& progress) {
  pack::SoundPack result;
  result.name = fmt::format("{}-on-wooden-table", paper.name);
  result.version = "1.1.0";
  result.material = paper.name;
  result.touched_surface = "wooden-table";
  result.grammage_kg_per_m2 = paper.grammage_kg_per_m2;
  result.licence = "CC0-1.0";
  result.origin = "generated";
  result.rate_hz = result.stored_rate_hz = options.rate_hz;

  pack::CrumplingSection crumpling;
  crumpling.geometry = {1.0, 90.0, false, 0.0};
  crumpling.reference_compression = kFlapCompression;
  crumpling.constrained_reference_amplitude_m = kClacAmplitude_m;
  pack::FrictionSection friction;
  friction.geometry = {1.0, 30.0, true, kFrictionCompression};
  friction.gain_sigma = kSlidingGainSigma;
  friction.rate_hz = options.rate_hz;
  friction.fft_size = options.fft_size;

  const auto bins = static_cast<int>(options.fft_size / 2 + 1);
  for (int i = 0; i < options.clacs; ++i)
    crumpling.units.push_back({{}, fmt::format("crumpling/clac_{}.flac", i + 1), {}, 0});
  friction.spectra.push_back({{}, "friction/flat.npy", {}, 0});
  for (const pack::GridPoint& point : options.grid) {
    for (int i = 0; i < options.flaps; ++i) {
      const std::string file = fmt::format("crumpling/flap_{}_{}.flac", file_name(point), i + 1);
      crumpling.units.push_back({point, file, {}, point.disc_radius_m()});
    }
    friction.spectra.push_back({point, fmt::format("friction/{}.npy", file_name(point)), {}, point.disc_radius_m()});
  }
  pack::CrumplingSection reference_flaps;
  reference_flaps.geometry = crumpling.geometry;
  reference_flaps.units.resize(static_cast<std::size_t>(std::max(1, options.flaps)));
  pack::FrictionSection reference_friction = friction;
  reference_friction.spectra.resize(1);

  std::vector<std::function<void(Workspace&)>> jobs;
  const auto flap_job = [&](pack::Unit& unit, int number) {
    jobs.emplace_back(
        [&, number](Workspace& workspace) { unit.samples = numbered_flap(paper, unit.point, number, options, workspace); });
  };
  const auto spectrum_job = [&](pack::Spectrum& spectrum) {
    jobs.emplace_back(
        [&](Workspace&) { spectrum.magnitudes = friction_heard(paper, spectrum.point, bins, options.rate_hz); });
  };
  for (std::size_t i = 0; i < crumpling.units.size(); ++i) {
    pack::Unit& unit = crumpling.units[i];
    const auto number = static_cast<int>(i);
    if (unit.point.constrained()) {
      jobs.emplace_back([&, number](Workspace& workspace) {
        const std::uint64_t seed = dsp::hash(options.seed, kClacStream, static_cast<std::uint64_t>(number));
        unit.samples = clac(paper, options.rate_hz, dsp::Random(seed), workspace);
      });
    } else {
      flap_job(unit, (number - options.clacs) % options.flaps);
    }
  }
  for (std::size_t i = 0; i < reference_flaps.units.size(); ++i) {
    reference_flaps.units[i].point = pack::kReferencePoint;
    flap_job(reference_flaps.units[i], static_cast<int>(i));
  }
  reference_friction.spectra[0].point = pack::kReferencePoint;
  spectrum_job(reference_friction.spectra[0]);
  for (pack::Spectrum& spectrum : friction.spectra) spectrum_job(spectrum);
  run_jobs(jobs, options.threads, progress);

  const double flap_db = pack::kReferenceFlapPeak_dbfs - pack::reference_flap_peak_dbfs(reference_flaps).value();
  const double friction_db = pack::kReferenceFriction_dbfs - pack::reference_friction_dbfs(reference_friction).value();
  const auto flap_gain = static_cast<float>(dsp::db_to_gain(flap_db));
  const auto friction_gain = static_cast<float>(dsp::db_to_gain(friction_db));
  for (pack::Unit& unit : crumpling.units) {
    for (float& x : unit.samples) x *= flap_gain;
  }
  for (pack::Spectrum& spectrum : friction.spectra) {
    for (float& m : spectrum.magnitudes) m *= friction_gain;
  }
  result.crumpling = std::move(crumpling);
  result.friction = std::move(friction);
  return result;
}

std::vector<std::string> material_names() {
  std::vector<std::string> names;
  for (const Paper& paper : papers()) names.emplace_back(paper.name);
  for (const ClothMaterial& cloth : cloth_materials()) names.emplace_back(cloth.name);
  return names;
}

tl::expected<void, pack::PackError> write_pack(std::string_view material, const std::filesystem::path& folder,
                                               const Progress& progress) {
  if (const Paper* paper = find_paper(material)) return pack::write(make_pack(*paper, {}, progress), folder);
  if (const ClothMaterial* cloth = find_cloth_material(material)) {
    return pack::write(make_cloth_pack(*cloth, {}, progress), folder);
  }
  return tl::unexpected(pack::PackError{folder.string(), "material", fmt::format("\"{}\" cannot be generated", material),
                                        fmt::format("there are: {}", fmt::join(material_names(), ", "))});
}

}  // namespace rustle::generate
