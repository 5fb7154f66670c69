#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <set>

#include <catch2/catch.hpp>

#include "server/report/axis.h"
#include "server/report/charts.h"
#include "server/report/spectrogram_picture.h"
#include "server/report/svg_canvas.h"
#include "server/report/timeline.h"
#include "tests/unit/report/synthetic_input.h"

namespace rustle::report::picture_test {
namespace {

std::uint32_t big_endian(std::string_view bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t k = 0; k < 4; ++k) value = value << 8 | static_cast<unsigned char>(bytes[at + k]);
  return value;
}

/// Distinct rows and columns that hold a pixel of a colour.
std::set<int> columns_with(const Image& image, const Colour& colour) {
  std::set<int> columns;
  for (std::size_t i = 0; i < image.pixels.size(); ++i) {
    if (image.pixels[i] == pixel_of(colour)) columns.insert(static_cast<int>(i) % image.width);
  }
  return columns;
}

const Colour& light(Ink ink) {
  return light_theme()[static_cast<std::size_t>(ink)];
}

}  // namespace

TEST_CASE("the PNG has the size asked for, times the scale") {
  const std::vector<float> samples = tone(440, 0.3, 0.2, 48000);
  const std::vector<EventMark> events = {crumple(1, 0.05, 0.1), rub(2, 0.1, 0.15, 0.2)};
  for (const PictureSize& size : {PictureSize{}, PictureSize{360, 320, 2, false}}) {
    const Image image = spectrogram_picture({samples}, events, {}, size);
    CHECK(image.width == static_cast<int>(size.width * size.scale));
    CHECK(image.height == static_cast<int>(size.height * size.scale));
    const auto png = encode_png(image);
    REQUIRE(png);
    CHECK(png->substr(1, 3) == "PNG");
    CHECK(big_endian(*png, 16) == static_cast<std::uint32_t>(image.width));
    CHECK(big_endian(*png, 20) == static_cast<std::uint32_t>(image.height));
    CHECK(*png == *encode_png(spectrogram_picture({samples}, events, {}, size)));
  }
}

TEST_CASE("an error names the file and the remedy") {
  const auto written = write_spectrogram_png("/nowhere/at/all.png", {}, {}, {});
  REQUIRE_FALSE(written);
  CHECK(written.error().find("/nowhere/at/all.png") != std::string::npos);
  CHECK(written.error().find("folder") != std::string::npos);
  CHECK_FALSE(encode_png(Image{40000, 1, std::vector<std::uint32_t>(40000)}));
}

TEST_CASE("pixels survive the canvas: an image drawn at its own size is there bit by bit") {
  Image checks{4, 3, {}};
  for (std::uint32_t i = 0; i < 12; ++i) checks.pixels.push_back(0x010203u * (i + 1));
  ImageCanvas canvas(10, 10, light_theme());
  canvas.image({2, 5, 4, 3}, checks);
  const Image drawn = canvas.pixels();
  for (int y = 0; y < 3; ++y) {
    for (int x = 0; x < 4; ++x) {
      CHECK(drawn.pixels[static_cast<std::size_t>((y + 5) * 10 + x + 2)] ==
            checks.pixels[static_cast<std::size_t>(y * 4 + x)]);
    }
  }
}

TEST_CASE("the heat map's lightness rises evenly, the diverging map is symmetric") {
  for (int i = 1; i <= 100; ++i) {
    const double step = oklab_lightness(heat_colour(i / 100.0)) - oklab_lightness(heat_colour((i - 1) / 100.0));
    CHECK(step > 0.004);
    CHECK(step < 0.016);
    CHECK(oklab_lightness(diverging_colour(i / 100.0)) ==
          Approx(oklab_lightness(diverging_colour(-i / 100.0))).margin(0.03));
  }
  CHECK(heat_colour(-3) == heat_colour(0));
  CHECK(heat_colour(7) == heat_colour(1));
}

TEST_CASE("text and marks stand out: contrast by WCAG's formula on both themes") {
  const auto luminance = [](const Colour& c) {
    const auto linear = [](double x) { return x <= 0.03928 ? x / 12.92 : std::pow((x + 0.055) / 1.055, 2.4); };
    return 0.2126 * linear(c.red) + 0.7152 * linear(c.green) + 0.0722 * linear(c.blue);
  };
  for (const Theme& theme : {light_theme(), dark_theme()}) {
    const auto contrast = [&](Ink ink, Ink behind) {
      const double a = luminance(theme[static_cast<std::size_t>(ink)]),
                   b = luminance(theme[static_cast<std::size_t>(behind)]);
      return (std::max(a, b) + 0.05) / (std::min(a, b) + 0.05);
    };
    for (const Ink behind : {Ink::kBackground, Ink::kPanel}) {
      CHECK(contrast(Ink::kText, behind) >= 7);
      for (const Ink ink : {Ink::kMuted, Ink::kCrumpling, Ink::kFriction, Ink::kTearing})
        CHECK(contrast(ink, behind) >= 4.3);
    }
  }
}

TEST_CASE("axes: values and pixels are inverse, ticks are round and within") {
  for (const Axis& axis : {Axis{-3, 5, 100, 20}, Axis{50, 24000, 400, 30, true}}) {
    for (const double u : {0.0, 0.3, 1.0}) {
      const double pixel = axis.pixel_from + u * (axis.pixel_to - axis.pixel_from);
      CHECK(axis.pixel(axis.value(pixel)) == Approx(pixel));
    }
    CHECK(axis.clamped_pixel(1e9) == Approx(axis.pixel_to));
  }
  for (const double to : {1e-4, 0.03, 0.7, 1.0, 3.3, 47.0, 9999.0}) {
    for (const int most : {2, 5, 12}) {
      const std::vector<Tick> ticks = linear_ticks(0, to, most);
      CHECK(ticks.size() >= 1);
      CHECK(ticks.size() <= static_cast<std::size_t>(most));
      std::set<std::string> labels;
      for (const Tick& tick : ticks) {
        CHECK(std::stod(tick.label) == Approx(tick.value).margin(1e-12));
        labels.insert(tick.label);
      }
      CHECK(labels.size() == ticks.size());
    }
  }
  std::vector<std::string> labels;
  for (const Tick& tick : logarithmic_ticks(50, 24000)) {
    if (!tick.label.empty()) labels.push_back(tick.label);
  }
  CHECK(labels == std::vector<std::string>{"100", "1k", "10k"});
  CHECK(short_number(0.012345) == "0.0123");
  CHECK(short_number(std::numeric_limits<double>::quiet_NaN()) == "-");
  CHECK(grouped(1234567) == "1,234,567");
  CHECK(grouped(12) == "12");
}

TEST_CASE("text is shortened at characters and broken at spaces") {
  CHECK(fitted("short", 200, 12) == "short");
  const std::string cut = fitted("f\u00fcnf \u00e4pfel f\u00fcr \u00fcbung", 60, 12);
  CHECK(text_width(cut, 12) <= 60);
  CHECK(cut.substr(cut.size() - 2) == "..");
  CHECK((static_cast<unsigned char>(cut[cut.size() - 3]) & 0xc0) != 0xc0);
  for (const std::string& line : wrapped("one two three four five six seven", 80, 12)) CHECK(text_width(line, 12) <= 80);
  CHECK(wrapped("", 80, 12).empty());
}

TEST_CASE("a crumpling tick stands at its time, taller for a larger event") {
  const std::vector<EventMark> events = {crumple(1, 0.25, 0.1), crumple(2, 0.75, 0.001), crumple(3, 9, 1)};
  ImageCanvas canvas(400, 100, light_theme());
  draw_crumpling_ticks(canvas, {0, 0, 400, 100}, {0, 1, 0, 400}, events, {0, true, 0.1});
  const Image image = canvas.pixels();
  const auto height_at = [&](int column) {
    int count = 0;
    for (int y = 0; y < 100; ++y) {
      count += image.pixels[static_cast<std::size_t>(y * 400 + column)] != pixel_of(light(Ink::kBackground));
    }
    return count;
  };
  CHECK(height_at(100) >= 99);
  CHECK(height_at(300) > 20);
  CHECK(height_at(300) < 45);
  for (const int empty : {50, 200, 399}) CHECK(height_at(empty) == 0);
}

TEST_CASE("speeds by column: the fastest of the episodes, interpolated, negative outside") {
  EventMark ramp = rub(1, 0.2, 0.6, 0.5);
  ramp.speeds = {{0.2, 0.0}, {0.6, 1.0}};
  const std::vector<EventMark> events = {ramp, rub(2, 0.3, 0.4, 0.9), crumple(3, 0.9, 1)};
  const std::vector<double> speeds = speed_columns({0, 1, 0, 100}, events, EventKind::kFriction, {});
  REQUIRE(speeds.size() == 100);
  CHECK(speeds[10] < 0);
  CHECK(speeds[25] == Approx(0.1375));
  CHECK(speeds[35] == Approx(0.9));
  CHECK(speeds[55] == Approx(0.8875));
  CHECK(speeds[90] < 0);
}

TEST_CASE("amplitude_height runs from a thousandth to the largest") {
  CHECK(amplitude_height(2, 2) == 1);
  CHECK(amplitude_height(0.002, 2) == Approx(0.08));
  CHECK(amplitude_height(0, 2) == Approx(0.08));
  CHECK(amplitude_height(std::numeric_limits<double>::quiet_NaN(), 2) == Approx(0.08));
  CHECK(amplitude_height(0.2, 2) > amplitude_height(0.02, 2));
}

TEST_CASE("the timeline grows by lanes and joins the sheets beyond its rows") {
  std::vector<EventMark> events = {crumple(1, 0.1, 0.1)};
  std::vector<TimelineSheet> sheets = {{1, "a"}};
  events[0].sheet = 1;
  const double one_lane = timeline_height({events, sheets, 0, 1});
  events.push_back(rub(2, 0.2, 0.3, 0.1));
  events.back().sheet = 1;
  CHECK(timeline_height({events, sheets, 0, 1}) > one_lane);
  events.pop_back();
  for (std::uint32_t id = 2; id <= 300; ++id) sheets.push_back({id, ""});
  CHECK(timeline_height({events, sheets, 0, 1}) < one_lane + 8 * 120);

  SvgCanvas canvas(900, 800, "t", "timeline");
  draw_timeline(canvas, {0, 0, 900, 800}, {events, sheets, 0, 1});
  CHECK(canvas.markup().find("sheet 1: a") != std::string::npos);
  CHECK(canvas.markup().find("293 more sheets") != std::string::npos);
}

TEST_CASE("many events draw no more than a mark per pixel") {
  std::vector<EventMark> events;
  for (std::uint64_t id = 1; id <= 50000; ++id) events.push_back(crumple(id, static_cast<double>(id) / 50000, 1e-3));
  SvgCanvas canvas(900, 120, "t", "timeline");
  draw_timeline(canvas, {0, 0, 900, 120}, {events, {}, 0, 1});
  draw_resonators(canvas, {0, 0, 400, 300}, events, {});
  CHECK(canvas.markup().size() < 60000);
}

TEST_CASE("largest_events compares kinds by their references and breaks ties by id") {
  const std::vector<EventMark> events = {crumple(5, 0, 0.16), rub(4, 0, 1, 0.2), crumple(3, 1, 0.16), crumple(9, 2, 0.001)};
  CHECK(largest_events(events, 3) == std::vector<std::size_t>{1, 2, 0});
  CHECK(largest_events(events, 99).size() == 4);
  CHECK(relative_level_db(events[0]) == Approx(0).margin(1e-9));
  CHECK(relative_level_db(EventMark{}) == -120);
}

TEST_CASE("drawings of nothing and of values that are not finite come through") {
  std::vector<EventMark> odd = {crumple(1, std::numeric_limits<double>::quiet_NaN(), 0.1),
                                crumple(2, 0.1, std::numeric_limits<double>::infinity()), rub(3, 0.5, 0.2, -1)};
  odd[1].resonators[0].ruling_length_m = std::numeric_limits<double>::quiet_NaN();
  for (const std::vector<EventMark>& events : {std::vector<EventMark>{}, odd}) {
    SvgCanvas canvas(400, 300, "t", "anything");
    const Rect all = {0, 0, 400, 300};
    draw_timeline(canvas, all, {events, {}, 0, 0});
    draw_spectrogram(canvas, all, {}, events, {});
    draw_levels(canvas, all, level_track({}), 0, 0);
    draw_waveform(canvas, all, {});
    draw_amplitude_histogram(canvas, all, events);
    draw_resonators(canvas, all, events, {});
    CHECK(canvas.markup().find("nan") == std::string::npos);
    CHECK(canvas.markup().find("inf") == std::string::npos);
  }
}

TEST_CASE("SVG text is escaped, base64 is standard") {
  SvgCanvas canvas(10, 10, "a", "<&\"'>");
  canvas.text({1, 2}, "<script>&", {});
  CHECK(canvas.markup().find("<script") == std::string::npos);
  CHECK(canvas.markup().find("&lt;&amp;&quot;&#39;&gt;") != std::string::npos);
  CHECK(base64("") == "");
  CHECK(base64("f") == "Zg==");
  CHECK(base64("fo") == "Zm8=");
  CHECK(base64("foobar") == "Zm9vYmFy");
  CHECK(base64("\xff\xfe") == "//4=");
}

TEST_CASE("both canvases take the same calls") {
  const std::vector<EventMark> events = {crumple(1, 0.5, 0.1)};
  ImageCanvas pixels(400, 120, light_theme());
  SvgCanvas text(400, 120, "t", "timeline");
  for (Canvas* canvas : {static_cast<Canvas*>(&pixels), static_cast<Canvas*>(&text)}) {
    draw_timeline(*canvas, {0, 0, 400, 120}, {events, {}, 0, 1});
  }
  CHECK(columns_with(pixels.pixels(), light(Ink::kFrame)).size() > 200);
  CHECK(text.markup().find("var(--crumpling)") != std::string::npos);
}

}  // namespace rustle::report::picture_test
