#include "sound_db/build/unit_search.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "sound_db/dsp/level.h"

namespace rustle::build {

namespace {

constexpr double kFadeOut_s = 0.005, kFadeIn_s = 0.0005;
constexpr double kBorder_s = 0.001;
constexpr double kCut_db = -20;  // a border this loud, relative to the sound's loudest millisecond, cuts it

/// How long a sound of a class may last, from where it reaches the threshold to where it leaves it for good; and how near
/// its parts are to each other.
struct Durations {
  double least_s, most_s, join_s;
};

Durations durations_of(SoundClass sound_class) {
  return sound_class == SoundClass::kFlap ? Durations{0.020, 2.0, 0.080} : Durations{0.002, 0.120, 0.001};
}

double to_power(double db) {
  return std::pow(10.0, db / 10);
}

/// Where the sound reaches the threshold for the last time.
std::size_t last_loud(std::span<const float> signal, const Segment& segment, double threshold) {
  std::size_t n = segment.end;
  const double loud = std::sqrt(threshold);
  while (n > segment.begin + 1 && std::abs(signal[n - 1]) < loud) --n;
  return n;
}

class Search {
 public:
  Search(const PreparedTake& prepared, const Take& take)
      : prepared_(prepared),
        take_(take),
        durations_(durations_of(take.sound_class)),
        window_(std::max<std::size_t>(1, samples(take.window_s))),
        power_(windowed_power(prepared.samples, window_)),
        loudest_(*std::max_element(power_.begin(), power_.end())),
        noise_(noise_power(power_, window_)) {}

  UnitSearch run() const {
    UnitSearch result;
    if (!(loudest_ > 0)) return result;
    const double threshold = chosen_threshold();
    result.threshold_dbfs = 10 * std::log10(threshold);
    result.noise_dbfs = noise_ > 0 ? 10 * std::log10(noise_) : dsp::kSilenceDb;
    std::vector<Segment> segments = at(threshold);
    if (take_.whole && !segments.empty()) segments = {{segments.front().begin, segments.back().end}};
    for (const Segment& segment : segments) result.units.push_back(judged(segment, threshold));
    return result;
  }

 private:
  std::size_t samples(double time_s) const { return static_cast<std::size_t>(std::lround(time_s * prepared_.rate_hz)); }
  double seconds(std::size_t count) const { return static_cast<double>(count) / prepared_.rate_hz; }
  bool has_pauses() const { return noise_ < loudest_ * to_power(-20); }

  std::vector<Segment> at(double threshold) const {
    return find_segments(prepared_.samples, power_, threshold, samples(durations_.join_s), samples(kFadeIn_s));
  }

  double sounding_s(const Segment& segment, double threshold) const {
    return seconds(last_loud(prepared_.samples, segment, threshold) - segment.begin);
  }

  double chosen_threshold() const {
    if (take_.threshold_db) return loudest_ * to_power(*take_.threshold_db);
    const double above_noise = has_pauses() ? noise_ * to_power(6) : 0.0;
    if (take_.sound_class != SoundClass::kCrumple)
      return std::min(loudest_ * to_power(-10), std::max(loudest_ * to_power(-30), above_noise));
    double best = loudest_ * to_power(-6);
    std::size_t most = 0;
    for (int db = -6; db >= -40; --db) {
      const double threshold = loudest_ * to_power(db);
      if (threshold < above_noise) break;
      std::size_t fitting = 0;
      for (const Segment& segment : at(threshold)) {
        const double lasts_s = sounding_s(segment, threshold);
        fitting += lasts_s >= durations_.least_s && lasts_s <= durations_.most_s;
      }
      if (fitting < most) continue;  // of equals the lowest: it keeps more of each sound
      most = fitting;
      best = threshold;
    }
    return best;
  }

  double loudest_millisecond(const Segment& segment) const {
    const std::size_t ms = samples(kBorder_s);
    double most = 0;
    for (std::size_t n = segment.begin; n + ms <= segment.end; n += ms) most = std::max(most, mean_square(n, n + ms));
    return most;
  }

  double mean_square(std::size_t begin, std::size_t end) const {
    const double level = dsp::rms(std::span(prepared_.samples).subspan(begin, end - begin));
    return level * level;
  }

  /// Without what comes more than the take's lead before the loudest sample.
  Segment without_long_lead(Segment segment) const {
    if (take_.whole || take_.sound_class != SoundClass::kFlap) return segment;
    const auto sound = std::span(prepared_.samples).subspan(segment.begin, segment.length());
    const auto loudest =
        std::max_element(sound.begin(), sound.end(), [](float a, float b) { return std::abs(a) < std::abs(b); });
    const auto before = static_cast<std::size_t>(loudest - sound.begin()), lead = samples(take_.lead_s);
    if (before > lead) segment.begin += before - lead;
    return segment;
  }

  FoundUnit judged(const Segment& found, double threshold) const {
    FoundUnit unit;
    const Segment segment = unit.segment = without_long_lead(found);
    const auto sound = std::span(prepared_.samples).subspan(segment.begin, segment.length());
    unit.clip.assign(sound.begin(), sound.end());
    const std::size_t in = samples(segment == found ? kFadeIn_s : kFadeOut_s), out = samples(kFadeOut_s);
    const auto rise = [](std::size_t n, std::size_t length) {
      const double gain = std::sin(std::numbers::pi / 2 * static_cast<double>(n) / static_cast<double>(length));
      return static_cast<float>(gain * gain);
    };
    const std::size_t most = unit.clip.size() / 4;
    for (std::size_t n = 0; n < std::min(in, most); ++n) unit.clip[n] *= rise(n, std::min(in, most));
    for (std::size_t n = 0; n < std::min(out, most); ++n)
      unit.clip[unit.clip.size() - 1 - n] *= rise(n, std::min(out, most));
    unit.peak_dbfs = dsp::peak_dbfs(unit.clip);
    const double power = *std::max_element(power_.begin() + static_cast<std::ptrdiff_t>(segment.begin),
                                           power_.begin() + static_cast<std::ptrdiff_t>(segment.end));
    unit.above_noise_db = noise_ > 0 ? 10 * std::log10(power / noise_) : -dsp::kSilenceDb;
    unit.reason = reason_against(found, threshold, unit.above_noise_db);
    return unit;
  }

  std::string reason_against(const Segment& segment, double threshold, double above_noise_db) const {
    const double lasts_s = sounding_s(segment, threshold);
    if (is_clipped(prepared_, segment.begin, segment.end)) return "clipped: record it lower";
    const std::size_t border = samples(kBorder_s), count = prepared_.samples.size();
    const double least = loudest_millisecond(segment) * to_power(kCut_db);
    if (count < 2 * border) return "too short: less than 2 ms";
    if (segment.begin < border && mean_square(0, border) > least) return "cut at the start";
    if (segment.end + border > count && mean_square(count - border, count) > least) return "cut at the end";
    if (!take_.whole && lasts_s < durations_.least_s) return fmt::format("too short: {:.1f} ms", 1000 * lasts_s);
    if (!take_.whole && lasts_s > durations_.most_s) {
      return fmt::format("overlapping: {:.0f} ms without a pause, a {} lasts {:.0f} at most", 1000 * lasts_s,
                         take_.sound_class == SoundClass::kFlap ? "flap" : "clac", 1000 * durations_.most_s);
    }
    if (has_pauses() && above_noise_db < 10) return fmt::format("too quiet: {:.1f} dB above the pauses", above_noise_db);
    return {};
  }

  const PreparedTake& prepared_;
  const Take& take_;
  Durations durations_;
  std::size_t window_;
  std::vector<double> power_;
  double loudest_, noise_;
};

}  // namespace

UnitSearch find_units(const PreparedTake& prepared, const Take& take) {
  return Search(prepared, take).run();
}

}  // namespace rustle::build
