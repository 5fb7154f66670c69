#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include <tl/expected.hpp>

#include "server/report/image_canvas.h"
#include "server/report/sound_event.h"
#include "server/report/spectrogram.h"

namespace rustle::report {

struct SpectrogramOptions {
  std::string title;  ///< empty: no title
  FrequencyScale scale = FrequencyScale::kLogarithmic;
  double lowest_hz = 50;         ///< of the logarithmic scale
  double range_db = 80;          ///< from the brightest colour down to the darkest
  std::optional<double> top_db;  ///< the brightest colour; absent: the loudest cell, rounded up to 10 dB
  double cell_scale = 1;         ///< cells per unit of the drawing
};

struct LevelRange {
  double floor_db = 0, top_db = 0;
};

/// What the darkest and the brightest colour stand for.
LevelRange level_range(const SpectrogramGrid& grid, const SpectrogramOptions& options);

/// One pixel per cell through heat_colour.
Image heat_image(const SpectrogramGrid& grid, const LevelRange& range);

/// The spectrogram with its axes and colour bar; above it a tick per crumpling event, as long as its amplitude says; below
/// it the times in contact (friction) and of tearing, as strong as their speed.
void draw_spectrogram(Canvas& canvas, const Rect& rect, const Sound& sound, std::span<const EventMark> events,
                      const SpectrogramOptions& options);

Image spectrogram_picture(const Sound& sound, std::span<const EventMark> events, const SpectrogramOptions& options,
                          const PictureSize& size = {});

/// Error: the path and what to do about it.
[[nodiscard]] tl::expected<void, std::string> write_spectrogram_png(const std::filesystem::path& path, const Sound& sound,
                                                                    std::span<const EventMark> events,
                                                                    const SpectrogramOptions& options,
                                                                    const PictureSize& size = {});

}  // namespace rustle::report
