#pragma once

#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "server/engine/stream_item.h"
#include "server/report/plot.h"
#include "sound_db/pack/library.h"
#include "sound_db/pack/sound_pack.h"

/// What a validation is given and what it finds.
namespace rustle::validation {

inline constexpr double kUnbounded = std::numeric_limits<double>::infinity();

/// What a figure may be from and to.
struct Bound {
  std::string text;  ///< "0.05 to 0.15"
  double low = -kUnbounded, high = kUnbounded;
  bool above_low = false;  ///< low itself does not hold

  bool holds(double value) const { return (above_low ? value > low : value >= low) && value <= high; }  // false for NaN
};

Bound at_least(double low, std::string_view unit = {});
Bound at_most(double high, std::string_view unit = {});
Bound between(double low, double high, std::string_view unit = {});
/// (low, high]
Bound above_to(double low, double high, std::string_view unit = {});
/// Told, and nothing asked of it.
Bound shown();
/// value ± margin
Bound around(double value, double margin, std::string_view unit = {});

/// One figure, ours beside the paper's. `name` is "group/what", unique and the same in every run.
struct Check {
  std::string name;
  double ours = std::numeric_limits<double>::quiet_NaN();
  std::optional<double> paper;
  Bound bound;
  std::string unit = {};
  std::string meaning = {};              ///< a sentence for the page
  std::optional<double> published = {};  ///< the same with the papers' formulas as printed
  bool wall_time = false;                ///< differs from run to run

  bool holds() const { return bound.holds(ours); }
};

/// A sound shown as a spectrogram.
struct Picture {
  std::string title;
  std::vector<float> samples;  ///< mono
  double rate_hz = 48000;
  double lowest_hz = 100;
};

/// Spectrograms side by side; with two rows every second one lies below the one before it.
struct Pictures {
  std::vector<Picture> pictures;
  int rows = 1;
};

/// What a page shows of it.
struct Figure {
  std::string title;  ///< "Figure 12: ..."
  std::string caption;
  std::variant<report::Plot, Pictures> content;
};

struct Findings {
  std::vector<Check> checks;
  std::vector<Figure> figures;
  std::vector<std::string> notices = {};  ///< what a reader should know before trusting them
};

/// What every group of checks is given. One thread at a time uses it; groups start up to `workers` threads of their own.
struct Setting {
  std::shared_ptr<pack::PackLibrary> packs;
  std::string material = "printer-paper";
  std::shared_ptr<const pack::SoundPack> pack;  ///< of the material, at kRate_hz
  int workers = 1;
  std::uint64_t seed = 1;
  std::filesystem::path recordings;           ///< empty: none to compare with
  std::filesystem::path recordings_manifest;  ///< says what each is; empty: their folder's, else their names do
  /// Motions of cloth that were captured, by name, beside those that the groups have of their own.
  std::vector<std::pair<std::string, std::vector<engine::StreamItem>>> captures = {};
  std::function<void(double)> progress = [](double) {};  ///< part of the group done, from any of its threads
};

inline constexpr int kRate_hz = 48000;

/// Runs job(0) .. job(count - 1) on the setting's workers, each once; tells progress. The first exception is thrown again.
void run_all(const Setting& setting, std::size_t count, const std::function<void(std::size_t)>& job);

}  // namespace rustle::validation
