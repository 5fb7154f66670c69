#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "server/apps/command_pack.h"
#include "server/apps/wording.h"
#include "server/sinks/wav.h"
#include "sound_db/dsp/level.h"
#include "sound_db/pack/calibration.h"

namespace rustle::apps {
namespace {

constexpr double kGap_s = 0.35, kFade_s = 0.1, kExcerpt_s = 10;
constexpr int kSpeeds = 5, kPops = 12;

struct Heard {
  double from_s = 0, to_s = 0;
  const char* what = "";
  std::string detail;
  double level_dbfs = 0;  // peak of crumpling, RMS of the others
  nlohmann::ordered_json about;
};

/// Sounds one after another with pauses between.
class Tour {
 public:
  explicit Tour(std::uint32_t rate_hz) : rate_hz_(rate_hz) { pause(); }

  void add(const char* what, std::string detail, nlohmann::ordered_json about, std::span<const float> sound, bool peak) {
    const double from_s = now_s();
    samples_.insert(samples_.end(), sound.begin(), sound.end());
    heard_.push_back(
        {from_s, now_s(), what, std::move(detail), peak ? dsp::peak_dbfs(sound) : dsp::rms_dbfs(sound), std::move(about)});
    pause();
  }
  std::vector<float>& samples() { return samples_; }
  const std::vector<Heard>& heard() const { return heard_; }

 private:
  double now_s() const { return static_cast<double>(samples_.size()) / rate_hz_; }
  void pause() { samples_.resize(samples_.size() + static_cast<std::size_t>(kGap_s * rate_hz_), 0.0F); }

  std::uint32_t rate_hz_;
  std::vector<float> samples_;
  std::vector<Heard> heard_;
};

void add_slides(const pack::ClothCorpus& corpus, const ClothTour& arguments, Tour& tour) {
  std::vector<double> speeds;
  const auto& measured = corpus.friction.speeds_m_per_s;
  if (arguments.speed_m_per_s) speeds = {*arguments.speed_m_per_s};
  for (int i = 0; i < kSpeeds && !arguments.speed_m_per_s; ++i) {
    speeds.push_back(measured.front() * std::pow(measured.back() / measured.front(), i / (kSpeeds - 1.0)));
  }
  for (const double speed : speeds) {
    const auto speed_at = [&](double t) {
      return speed * std::clamp(std::min(t, arguments.seconds - t) / kFade_s, 0.0, 1.0);
    };
    tour.add("friction", fmt::format("{:.2f} m/s", speed), {{"speed_m_per_s", speed}},
             pack::plain_target(corpus, arguments.seconds, speed_at, {}, 1), false);
  }
}

void add_pops(const pack::ClothCorpus& corpus, Tour& tour) {
  const auto& units = corpus.crumpling->units;
  const std::size_t count = std::min<std::size_t>(units.size(), kPops);
  for (std::size_t i = 0; i < count; ++i) {
    const auto& unit = units[count == 1 ? 0 : i * (units.size() - 1) / (count - 1)];
    tour.add("crumpling", fmt::format("energy {:.2g} s", unit.energy_s), {{"energy_s", unit.energy_s}, {"file", unit.file}},
             unit.samples, true);
  }
}

void add_excerpt(const pack::ClothCorpus& corpus, Tour& tour) {
  double left_s = kExcerpt_s;
  for (const auto& recording : corpus.recordings) {
    if (left_s < 0.1) break;
    const auto& samples = recording.channels.front();
    const auto count = std::min(samples.size(), static_cast<std::size_t>(left_s * corpus.rate_hz));
    tour.add("corpus", recording.file, {{"file", recording.file}}, std::span(samples).first(count), false);
    left_s -= static_cast<double>(count) / corpus.rate_hz;
  }
}

}  // namespace

int play_cloth(const pack::SoundPack& pack, const ClothTour& arguments) {
  const pack::ClothCorpus& corpus = *pack.cloth;
  Tour tour(pack.rate_hz);
  if (arguments.kind.empty() || arguments.kind == "friction") add_slides(corpus, arguments, tour);
  if (corpus.crumpling && (arguments.kind.empty() || arguments.kind == "crumpling")) add_pops(corpus, tour);
  if (arguments.kind.empty() || arguments.kind == "corpus") add_excerpt(corpus, tour);
  if (tour.heard().empty())
    return complain(fmt::format("{}: has no {} to play; `rustle pack show` draws what it has", pack.name, arguments.kind),
                    kFailed);
  const double peak = dsp::peak(tour.samples());
  const double gain = dsp::db_to_gain(corpus.gain_db) / std::max(1.0, peak * dsp::db_to_gain(corpus.gain_db));
  for (float& x : tour.samples()) x = static_cast<float>(x * gain);
  auto writer = sinks::WavWriter::create(arguments.output, static_cast<int>(pack.rate_hz), 1, sinks::WavFormat::kInt24);
  if (!writer) return complain(writer.error(), kFailed);
  if (auto written = writer->write(tour.samples()); !written) return complain(written.error(), kFailed);
  if (auto closed = writer->close(); !closed) return complain(closed.error(), kFailed);

  auto list = nlohmann::ordered_json::array();
  for (const Heard& one : tour.heard()) {
    const bool is_peak = one.what == std::string_view("crumpling");
    const double level = one.level_dbfs + dsp::gain_to_db(gain);
    if (!arguments.json) {
      fmt::print("{:8.2f} s  {:<10} {:<28} {} {:.1f} dBFS\n", one.from_s, one.what, one.detail, is_peak ? "peak" : "RMS",
                 level);
    }
    nlohmann::ordered_json entry{{"from_s", one.from_s}, {"to_s", one.to_s}, {"class", one.what}};
    entry.update(one.about);
    entry[is_peak ? "peak_dbfs" : "rms_dbfs"] = level;
    list.push_back(std::move(entry));
  }
  if (arguments.json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"output", arguments.output},
                                              {"pack", pack.name},
                                              {"rate_hz", pack.rate_hz},
                                              {"gain_db", dsp::gain_to_db(gain)},
                                              {"sounds", list}}
                           .dump());
  } else {
    fmt::print("{}: {} of {}, as recorded\n", arguments.output, counted(tour.heard().size(), "sound"), pack.name);
  }
  return kDone;
}

}  // namespace rustle::apps
