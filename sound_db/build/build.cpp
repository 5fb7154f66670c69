#include "sound_db/build/build.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "sound_db/build/cloth_build.h"
#include "sound_db/build/friction_average.h"
#include "sound_db/build/unit_search.h"
#include "sound_db/dsp/level.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/levels.h"
#include "sound_db/pack/spectra.h"

namespace rustle::build {

namespace {

constexpr double kQuiet_db = 20, kQuietEqualised_db = 30;  // below the loudest unit of the same sheet and session

using PointKey = std::pair<double, double>;

PointKey key_of(const pack::GridPoint& point) {
  return {point.ruling_length_m, point.free_border_length_m};
}
pack::GridPoint point_of(const PointKey& key) {
  return {key.first, key.second};
}

std::string point_name(const pack::GridPoint& point) {
  return fmt::format("r{:03.0f}_c{:03.0f}", 1000 * point.ruling_length_m, 1000 * point.free_border_length_m);
}

double energy(const std::vector<float>& clip) {
  double sum = 0;
  for (const float x : clip) sum += static_cast<double>(x) * x;
  return sum;
}

void scale(std::vector<float>& values, double gain) {
  for (float& x : values) x = static_cast<float>(x * gain);
}

/// A unit on its way into the pack, and its line in the report.
struct Candidate {
  pack::GridPoint point;
  std::string session;
  std::vector<float> clip;
  double above_noise_db = 0;
  bool equalised = false;
  std::size_t source = 0, segment = 0;
};

/// One slide, and its line in the report.
struct Slide {
  pack::GridPoint point;
  std::string session;
  FrictionSum sum;
  std::size_t source = 0;
};

class Builder {
 public:
  Builder(const BuildManifest& manifest, const std::filesystem::path& folder, pack::Findings& findings)
      : manifest_(manifest), folder_(folder), findings_(findings) {
    result_.pack = manifest.pack;
  }

  std::optional<BuiltPack> run(const Progress& progress) {
    const std::size_t before = findings_.size();
    const std::vector<TakeFile> files = files_of(manifest_, folder_, findings_);
    for (std::size_t i = 0; i < files.size(); ++i) {
      const Take& take = manifest_.takes[files[i].take];
      if (take.measures_pack()) read(take, files[i].file);
      if (progress) progress(static_cast<double>(i + 1) / static_cast<double>(files.size()));
    }
    if (findings_.size() > before) return std::nullopt;
    add_crumpling();
    add_friction();
    if (!result_.pack.crumpling && !result_.pack.friction) {
      error(manifest_.file.string(), "", fmt::format("none of {} sounds could be used: {}", left_out(), first_reason()),
            "`rustle pack build --json` lists every sound with its reason; check classes, times and threshold_db");
      return std::nullopt;
    }
    note_missing();
    result_.report.left_out = left_out();
    return std::move(result_);
  }

 private:
  void error(std::string file, std::string field, std::string message, std::string remedy) {
    findings_.push_back(
        {pack::Severity::kError, {std::move(file), std::move(field), std::move(message), std::move(remedy)}});
  }

  void read(const Take& take, const std::string& file) {
    const std::string path = (folder_ / file).string();
    const auto point = take.point ? take.point : point_in_name(file);
    if (!point || (take.sound_class == SoundClass::kFlap && point->constrained())) {
      return error(path, take.place, "has no place in the grid",
                   "say l_r and l_c (or constrained = true), or name the file after it: r100_c200 in mm");
    }
    const auto prepared = prepare(path, take, result_.pack.rate_hz, manifest_.highpass_hz);
    if (!prepared) return error(path, take.place, prepared.error(), "replace it, or take it out of the manifest");
    SourceReport source;
    source.file = file;
    source.sound_class = take.sound_class;
    source.point = *point;
    source.rate_hz = prepared->recorded_rate_hz;
    source.channels = prepared->channels;
    source.duration_s = prepared->duration_s;
    if (take.sound_class == SoundClass::kSlide) {
      read_slide(take, *prepared, source);
    } else {
      read_units(take, *prepared, source);
    }
    result_.report.sources.push_back(std::move(source));
  }

  void read_units(const Take& take, const PreparedTake& prepared, SourceReport& source) {
    UnitSearch search = find_units(prepared, take);
    source.threshold_dbfs = search.threshold_dbfs;
    const double to_geometry = pack::emission_gain(take.geometry) / pack::emission_gain(result_.pack.crumpling->geometry);
    for (FoundUnit& unit : search.units) {
      const double from_s = prepared.from_s + static_cast<double>(unit.segment.begin) / prepared.rate_hz;
      const double lasts_s = static_cast<double>(unit.segment.length()) / prepared.rate_hz;
      source.segments.push_back({from_s, from_s + lasts_s, lasts_s, unit.peak_dbfs, "", unit.reason});
      if (!unit.reason.empty()) continue;
      scale(unit.clip, to_geometry);
      candidates_.push_back({source.point, take.session, std::move(unit.clip), unit.above_noise_db, !take.keep_levels,
                             result_.report.sources.size(), source.segments.size() - 1});
    }
    if (search.units.empty()) source.segments.push_back({0, source.duration_s, 0, dsp::kSilenceDb, "", "silent"});
  }

  void read_slide(const Take& take, const PreparedTake& prepared, SourceReport& source) {
    SpeedTrack speed = constant_speed(take.speed_m_per_s.value_or(0));
    if (!take.speed_track.empty()) {
      const auto path = folder_ / take.speed_track;
      auto track = read_speed_track(path);
      if (!track) return error(path.string(), take.place, track.error(), "a speed track has lines \"time,speed\"");
      speed = std::move(*track);
    }
    const pack::FrictionSection& friction = *result_.pack.friction;
    FrictionBlocks blocks = average_friction(prepared, take, speed, static_cast<int>(friction.fft_size),
                                             friction.reference_speed_m_per_s, friction.speed_exponent);
    source.threshold_dbfs = blocks.threshold_dbfs;
    const double end_s = prepared.from_s + static_cast<double>(prepared.samples.size()) / prepared.rate_hz;
    const auto left = [&](double seconds, const char* reason) {
      if (seconds > 0) source.segments.push_back({prepared.from_s, end_s, seconds, dsp::kSilenceDb, "", reason});
    };
    if (blocks.sum.blocks >= kLeastBlocks) {
      source.segments.push_back({blocks.from_s, blocks.to_s, blocks.kept_s, blocks.level_dbfs, "kept", ""});
      to_section_geometry(take.geometry, source.point, blocks.sum);
      slides_.push_back({source.point, take.session, std::move(blocks.sum), result_.report.sources.size()});
    } else {
      left(end_s - prepared.from_s, "too short: two blocks of fft_size samples are needed");
    }
    left(blocks.quiet_s, "too quiet");
    left(blocks.slow_s, "too slow");
    left(blocks.clipped_s, "clipped: record it lower");
  }

  void to_section_geometry(const pack::RecordingGeometry& recorded, const pack::GridPoint& point, FrictionSum& sum) const {
    std::vector<double> frequencies_hz(sum.power.size());
    for (std::size_t k = 0; k < frequencies_hz.size(); ++k)
      frequencies_hz[k] =
          result_.pack.rate_hz / 2.0 * static_cast<double>(k) / static_cast<double>(frequencies_hz.size() - 1);
    const auto from = pack::reference_transfer(recorded, point, frequencies_hz);
    const auto to = pack::reference_transfer(result_.pack.friction->geometry, point, frequencies_hz);
    for (std::size_t k = 0; k < sum.power.size(); ++k) sum.power[k] *= std::pow(to[k] / from[k], 2);
  }

  SegmentReport& line_of(const Candidate& c) { return result_.report.sources[c.source].segments[c.segment]; }

  /// Clacs of unknown size: equally much energy, the median of their session's.
  void equalise() {
    std::map<std::string, std::vector<Candidate*>> sessions;
    for (Candidate& c : candidates_) {
      if (c.equalised) sessions[c.session].push_back(&c);
    }
    for (auto& [session, members] : sessions) {
      std::vector<double> energies;
      for (const Candidate* c : members) energies.push_back(energy(c->clip));
      const auto middle = energies.begin() + static_cast<std::ptrdiff_t>(energies.size() / 2);
      std::nth_element(energies.begin(), middle, energies.end());
      for (Candidate* c : members) scale(c->clip, std::sqrt(*middle / energy(c->clip)));
    }
  }

  void leave_out_quiet() {
    std::map<std::pair<std::string, PointKey>, double> loudest;
    for (const Candidate& c : candidates_) {
      double& level = loudest.try_emplace({c.session, key_of(c.point)}, dsp::kSilenceDb).first->second;
      level = std::max(level, dsp::peak_dbfs(c.clip));
    }
    std::vector<Candidate> kept;
    for (Candidate& c : candidates_) {
      const double below_db = loudest.at({c.session, key_of(c.point)}) - dsp::peak_dbfs(c.clip);
      if (below_db > (c.equalised ? kQuietEqualised_db : kQuiet_db)) {
        line_of(c).reason = fmt::format("too quiet: {:.0f} dB below the loudest of its session", below_db);
      } else {
        kept.push_back(std::move(c));
      }
    }
    candidates_ = std::move(kept);
  }

  void limit_variants() {
    std::map<PointKey, std::vector<std::size_t>> points;
    for (std::size_t i = 0; i < candidates_.size(); ++i) points[key_of(candidates_[i].point)].push_back(i);
    std::set<std::size_t> surplus;
    const auto most = static_cast<std::size_t>(manifest_.units_per_point);
    for (auto& [point, members] : points) {
      std::stable_sort(members.begin(), members.end(), [&](std::size_t a, std::size_t b) {
        return candidates_[a].above_noise_db > candidates_[b].above_noise_db;
      });
      for (std::size_t i = most; i < members.size(); ++i) surplus.insert(members[i]);
    }
    std::vector<Candidate> kept;
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      if (surplus.contains(i)) {
        line_of(candidates_[i]).reason = fmt::format("surplus: {} others stand out of the noise more", most);
      } else {
        kept.push_back(std::move(candidates_[i]));
      }
    }
    candidates_ = std::move(kept);
  }

  double crumpling_gain_db(const std::string* session) const {
    pack::CrumplingSection section = *manifest_.pack.crumpling;
    double clac_peaks_db = 0;
    int clacs = 0;
    for (const Candidate& c : candidates_) {
      if (session && c.session != *session) continue;
      section.units.push_back({c.point, "", c.clip, c.point.disc_radius_m()});
      if (!c.point.constrained()) continue;
      clac_peaks_db += dsp::peak_dbfs(c.clip);
      ++clacs;
    }
    if (const auto level = pack::reference_flap_peak_dbfs(section)) return pack::kReferenceFlapPeak_dbfs - *level;
    return kReferenceClacPeak_dbfs - clac_peaks_db / clacs - dsp::gain_to_db(pack::emission_gain(section.geometry));
  }

  void add_crumpling() {
    pack::CrumplingSection& section = *result_.pack.crumpling;
    leave_out_quiet();
    limit_variants();
    equalise();
    if (candidates_.empty()) {
      result_.pack.crumpling.reset();
      return;
    }
    std::set<std::string> sessions;
    for (const Candidate& c : candidates_) sessions.insert(c.session);
    for (const std::string& session : sessions) {
      const double gain_db = crumpling_gain_db(&session);
      for (Candidate& c : candidates_) {
        if (c.session == session) scale(c.clip, dsp::db_to_gain(gain_db));
      }
      result_.report.sessions.push_back({session, false, gain_db});
    }
    const double rest_db = crumpling_gain_db(nullptr);
    for (SessionReport& session : result_.report.sessions) session.gain_db += rest_db;
    std::stable_sort(candidates_.begin(), candidates_.end(),
                     [](const Candidate& a, const Candidate& b) { return key_of(a.point) < key_of(b.point); });
    std::map<PointKey, int> numbers;
    for (Candidate& c : candidates_) {
      scale(c.clip, dsp::db_to_gain(rest_db));
      const int number = ++numbers[key_of(c.point)];
      const std::string file = c.point.constrained() ? fmt::format("crumpling/clac_{}.flac", number)
                                                     : fmt::format("crumpling/flap_{}_{}.flac", point_name(c.point), number);
      line_of(c).kept_as = file;
      section.units.push_back({c.point, file, std::move(c.clip), c.point.disc_radius_m()});
    }
    result_.report.units = static_cast<int>(section.units.size());
  }

  /// The section with the mean spectra of a session, or of all.
  pack::FrictionSection with_spectra(const std::string* session) const {
    std::map<PointKey, FrictionSum> sums;
    for (const Slide& slide : slides_) {
      if (!session || slide.session == *session) sums[key_of(slide.point)] += slide.sum;
    }
    pack::FrictionSection section = *manifest_.pack.friction;
    for (const auto& [key, sum] : sums) {
      const pack::GridPoint point = point_of(key);
      const std::string file = point.constrained() ? "friction/flat.npy" : fmt::format("friction/{}.npy", point_name(point));
      section.spectra.push_back({point, file, mean_spectrum(sum), point.disc_radius_m()});
    }
    return section;
  }

  double friction_gain_db(const std::string* session) const {
    const pack::FrictionSection section = with_spectra(session);
    if (const auto level = pack::reference_friction_dbfs(section)) return pack::kReferenceFriction_dbfs - *level;
    const auto emission = pack::emission_spectrum(section, section.spectra.front(),
                                                  static_cast<int>(section.fft_size / 2 + 1), section.rate_hz);
    const double speed = std::pow(0.1 / section.reference_speed_m_per_s, section.speed_exponent);
    return kReferenceFlatFriction_dbfs - dsp::gain_to_db(pack::noise_rms(emission) * speed);
  }

  void raise(const std::string* session, double gain_db) {
    const double gain = std::pow(10.0, gain_db / 10);
    for (Slide& slide : slides_) {
      if (session && slide.session != *session) continue;
      for (double& p : slide.sum.power) p *= gain;
    }
  }

  void add_friction() {
    if (slides_.empty()) {
      result_.pack.friction.reset();
      return;
    }
    std::set<std::string> sessions;
    for (const Slide& slide : slides_) sessions.insert(slide.session);
    std::vector<SessionReport> reports;
    for (const std::string& session : sessions) {
      const double gain_db = friction_gain_db(&session);
      raise(&session, gain_db);
      reports.push_back({session, true, gain_db});
    }
    const double rest_db = friction_gain_db(nullptr);
    raise(nullptr, rest_db);
    for (SessionReport& session : reports) {
      session.gain_db += rest_db;
      result_.report.sessions.push_back(session);
    }
    result_.pack.friction = with_spectra(nullptr);
    for (const Slide& slide : slides_) {
      for (const pack::Spectrum& spectrum : result_.pack.friction->spectra) {
        if (spectrum.point == slide.point) result_.report.sources[slide.source].segments.front().kept_as = spectrum.file;
      }
    }
    result_.report.spectra = static_cast<int>(result_.pack.friction->spectra.size());
  }

  int left_out() const {
    int count = 0;
    for (const SourceReport& source : result_.report.sources) {
      for (const SegmentReport& segment : source.segments) count += segment.kept_as.empty();
    }
    return count;
  }

  std::string first_reason() const {
    for (const SourceReport& source : result_.report.sources) {
      for (const SegmentReport& segment : source.segments) {
        if (!segment.reason.empty()) return fmt::format("{} is {}", source.file, segment.reason);
      }
    }
    return "the manifest names only tears and cloth";
  }

  void note_missing() {
    constexpr std::size_t kGrid = 81;
    std::vector<std::string>& missing = result_.report.missing;
    std::set<PointKey> flaps, bent;
    bool clac = false, flat = false;
    if (result_.pack.crumpling) {
      for (const pack::Unit& unit : result_.pack.crumpling->units) {
        unit.point.constrained() ? void(clac = true) : void(flaps.insert(key_of(unit.point)));
      }
    }
    if (result_.pack.friction) {
      for (const pack::Spectrum& spectrum : result_.pack.friction->spectra) {
        spectrum.point.constrained() ? void(flat = true) : void(bent.insert(key_of(spectrum.point)));
      }
    }
    if (flaps.empty()) missing.emplace_back("flaps: sheets that swing freely crumple in silence");
    if (!clac) missing.emplace_back("clacs: constrained sheets crumple in silence");
    if (bent.empty()) missing.emplace_back("slides of bent sheets: these slide in silence");
    if (!flat) missing.emplace_back("slides of flat sheets: these slide in silence");
    const auto nearest = [&](const std::set<PointKey>& points, const char* what) {
      if (!points.empty() && points.size() < kGrid) {
        missing.push_back(
            fmt::format("{} of most sheet sizes: {} of the usual {} grid points {} recorded, the nearest sounds", what,
                        points.size(), kGrid, points.size() == 1 ? "is" : "are"));
      }
    };
    nearest(flaps, "flaps");
    nearest(bent, "slides");
  }

  const BuildManifest& manifest_;
  const std::filesystem::path& folder_;
  pack::Findings& findings_;
  BuiltPack result_;
  std::vector<Candidate> candidates_;
  std::vector<Slide> slides_;
};

}  // namespace

std::optional<BuiltPack> build_pack(const BuildManifest& manifest, const std::filesystem::path& folder,
                                    pack::Findings& findings, const Progress& progress) {
  if (manifest.cloth) return build_cloth_pack(manifest, folder, findings, progress);
  return Builder(manifest, folder, findings).run(progress);
}

}  // namespace rustle::build
