#include "server/report/spectrogram_picture.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "server/report/axis.h"
#include "server/report/image_canvas.h"
#include "server/report/levels.h"
#include "server/report/timeline.h"

namespace rustle::report {
namespace {

constexpr double kEventStrip = 36, kSpanStrip = 9, kStripGap = 4;
constexpr double kPictureLeft = 66, kPictureRight = 78, kPictureBottom = 44;
constexpr int kHeatSteps = 256;
constexpr int kSpanSteps = 16;

std::vector<Tick> frequency_ticks(const SpectrogramGrid& grid) {
  if (grid.scale == FrequencyScale::kLogarithmic) return logarithmic_ticks(grid.lowest_hz, grid.highest_hz);
  std::vector<Tick> ticks = linear_ticks(grid.lowest_hz / 1000, grid.highest_hz / 1000, 8);
  for (Tick& tick : ticks) {
    if (tick.value != 0) tick.label += "k";
    tick.value *= 1000;
  }
  return ticks;
}

void draw_colour_bar(Canvas& canvas, const Rect& bar, const LevelRange& range) {
  Image gradient{1, kHeatSteps, {}};
  for (int i = 0; i < kHeatSteps; ++i) gradient.pixels.push_back(pixel_of(heat_colour(1 - (i + 0.5) / kHeatSteps)));
  canvas.image(bar, gradient);
  canvas.frame(bar, {Ink::kFrame, 1});
  const Axis axis = {range.floor_db, range.top_db, bar.bottom(), bar.y};
  for (const Tick& tick : linear_ticks(range.floor_db, range.top_db, std::max(2, static_cast<int>(bar.height / 28)))) {
    const double y = axis.pixel(tick.value);
    canvas.line({bar.right(), y}, {bar.right() + 3, y}, {Ink::kFrame, 1});
    canvas.text({bar.right() + 7, y + 0.36 * kLabelSize}, tick.label, {.size = kLabelSize, .paint = Ink::kMuted});
  }
  canvas.text({bar.x + bar.width / 2, bar.y - 8}, "dBFS",
              {.size = kLabelSize, .paint = Ink::kMuted, .align = Align::kCentre});
}

void draw_spans(Canvas& canvas, const Rect& strip, const Axis& time, std::span<const EventMark> events, EventKind kind) {
  const std::vector<double> speeds = speed_columns(time, events, kind, {});
  const double fastest = speeds.empty() ? 0 : *std::max_element(speeds.begin(), speeds.end());
  const auto strength = [&](double speed) {
    return speed < 0 ? 0 : 1 + static_cast<int>(std::lround(fastest > 0 ? kSpanSteps * std::sqrt(speed / fastest) : 0));
  };
  canvas.rectangle(strip, Ink::kPanel);
  for (std::size_t from = 0; from < speeds.size();) {
    const int step = strength(speeds[from]);
    std::size_t to = from + 1;
    while (to < speeds.size() && strength(speeds[to]) == step) ++to;
    if (step > 0) {
      canvas.rectangle({strip.x + static_cast<double>(from), strip.y, static_cast<double>(to - from), strip.height},
                       {ink_of(kind), 0.2 + 0.8 * (step - 1) / kSpanSteps});
    }
    from = to;
  }
}

bool has(std::span<const EventMark> events, EventKind kind) {
  return std::any_of(events.begin(), events.end(), [kind](const EventMark& event) { return event.kind == kind; });
}

}  // namespace

LevelRange level_range(const SpectrogramGrid& grid, const SpectrogramOptions& options) {
  const double range_db = std::max(10.0, options.range_db);
  if (options.top_db) return {*options.top_db - range_db, *options.top_db};
  const double loudest = grid.level_db.empty() ? kSilenceDb : *std::max_element(grid.level_db.begin(), grid.level_db.end());
  const double top = loudest <= kSilenceDb ? 0 : std::ceil((loudest - 0.5) / 10) * 10;
  return {top - range_db, top};
}

Image heat_image(const SpectrogramGrid& grid, const LevelRange& range) {
  std::array<std::uint32_t, kHeatSteps> colours{};
  for (int i = 0; i < kHeatSteps; ++i) {
    colours[static_cast<std::size_t>(i)] = pixel_of(heat_colour(i / (kHeatSteps - 1.0)));
  }
  Image image{grid.columns, grid.rows, {}};
  image.pixels.reserve(grid.level_db.size());
  for (const float level_db : grid.level_db) {
    const double t = std::clamp((level_db - range.floor_db) / (range.top_db - range.floor_db), 0.0, 1.0);
    image.pixels.push_back(colours[static_cast<std::size_t>(std::lround(t * (kHeatSteps - 1)))]);
  }
  return image;
}

void draw_spectrogram(Canvas& canvas, const Rect& rect, const Sound& sound, std::span<const EventMark> events,
                      const SpectrogramOptions& options) {
  const bool narrow = rect.width < 600;
  const std::vector<LegendEntry> legend = kind_legend(events);
  const double wanted = legend_width(legend);
  double top = rect.y + 10;
  if (!options.title.empty() || !legend.empty()) {
    const bool stacked =
        !options.title.empty() && !legend.empty() && text_width(options.title, 15, true) + wanted + 40 > rect.width - 26;
    const double room = stacked || legend.empty() ? rect.width - 26 : rect.width - 60 - wanted;
    if (!options.title.empty()) {
      canvas.text({rect.x + 14, rect.y + 24}, fitted(options.title, room, 15, true), {.size = 15, .bold = true});
    }
    const double legend_y = rect.y + (stacked ? 44 : 23);
    const double legend_x = stacked ? rect.x + 14 : std::max(rect.x + 14, rect.right() - 16 - wanted);
    draw_legend(canvas, {legend_x, legend_y}, legend);
    top = rect.y + (stacked ? 56 : 36);
  }
  const bool ticks = has(events, EventKind::kCrumpling);
  const bool friction = has(events, EventKind::kFriction), tearing = has(events, EventKind::kTearing);
  const double strips = (friction ? kSpanStrip + kStripGap : 0) + (tearing ? kSpanStrip + kStripGap : 0);
  const double left = narrow ? 56 : kPictureLeft, right = narrow ? 64 : kPictureRight;
  const double above = std::max(ticks ? kEventStrip + kStripGap : 0.0, 20.0);
  const Rect plot = {rect.x + left, top + above, std::max(8.0, std::floor(rect.width - left - right)),
                     std::max(8.0, std::floor(rect.bottom() - kPictureBottom - strips - top - above))};

  const double cells = std::clamp(options.cell_scale, 0.25, 4.0);
  const SpectrogramGrid grid =
      spectrogram_grid(sound, std::max(1, static_cast<int>(plot.width * cells)),
                       std::max(1, static_cast<int>(plot.height * cells)), options.scale, options.lowest_hz);
  const LevelRange range = level_range(grid, options);
  canvas.image(plot, heat_image(grid, range));
  if (sound.frames() == 0) {
    canvas.text({plot.x + plot.width / 2, plot.y + plot.height / 2}, "no sound",
                {.size = 14, .paint = Colour{0.8, 0.8, 0.8}, .align = Align::kCentre});
  }

  const double end_s = grid.end_s > grid.start_s ? grid.end_s : grid.start_s + 1;
  const Axis time = {grid.start_s, end_s, plot.x, plot.right()};
  const Axis frequency = {grid.lowest_hz, grid.highest_hz, plot.bottom(), plot.y,
                          grid.scale == FrequencyScale::kLogarithmic};
  const Paint lines = {Colour{1, 1, 1}, 0.22};
  const Rect stacked = {plot.x, plot.y, plot.width, plot.height + strips};
  draw_vertical_axis(canvas, plot, frequency, frequency_ticks(grid), "frequency (Hz)", lines);
  draw_horizontal_axis(canvas, stacked, time,
                       linear_ticks(grid.start_s, end_s, std::max(2, static_cast<int>(plot.width / 75))),
                       "simulation time (s)", {Ink::kGrid, 0});
  canvas.frame(plot, {Ink::kFrame, 1});

  if (ticks) {
    const Rect strip = {plot.x, plot.y - kStripGap - kEventStrip, plot.width, kEventStrip};
    canvas.rectangle(strip, Ink::kPanel);
    draw_crumpling_ticks(canvas, strip, time, events, {});
  }
  double y = plot.bottom() + kStripGap;
  for (const EventKind kind : {EventKind::kFriction, EventKind::kTearing}) {
    if (!has(events, kind)) continue;
    draw_spans(canvas, {plot.x, y, plot.width, kSpanStrip}, time, events, kind);
    y += kSpanStrip + kStripGap;
  }
  draw_colour_bar(canvas, {plot.right() + (narrow ? 12.0 : 18.0), plot.y, narrow ? 10.0 : 14.0, plot.height}, range);
}

Image spectrogram_picture(const Sound& sound, std::span<const EventMark> events, const SpectrogramOptions& options,
                          const PictureSize& size) {
  ImageCanvas canvas(size.width, size.height, size.dark ? dark_theme() : light_theme(), size.scale);
  SpectrogramOptions fine = options;
  fine.cell_scale = size.scale;
  draw_spectrogram(canvas, {0, 0, canvas.width(), canvas.height()}, sound, events, fine);
  return canvas.pixels();
}

tl::expected<void, std::string> write_spectrogram_png(const std::filesystem::path& path, const Sound& sound,
                                                      std::span<const EventMark> events, const SpectrogramOptions& options,
                                                      const PictureSize& size) {
  return write_png(path, spectrogram_picture(sound, events, options, size));
}

}  // namespace rustle::report
