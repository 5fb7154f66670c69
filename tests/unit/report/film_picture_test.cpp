#include "server/report/film_picture.h"

#include <algorithm>
#include <set>

#include <catch2/catch.hpp>

#include "server/report/sheet_drawing.h"
#include "tests/unit/report/synthetic_input.h"

namespace rustle::report::film_picture_test {
namespace {

SheetView sheet_at(double time_s, float x_m) {
  SheetView view = rolled_sheet(16, 12);
  view.time_s = time_s;
  for (auto& p : view.positions_m) p.x() += x_m;
  return view;
}

Film film_of(std::size_t frames, float step_m = 0) {
  Film film;
  film.title = "a sheet";
  for (std::size_t k = 0; k < frames; ++k) {
    film.frames.push_back(sheet_at(0.1 * static_cast<double>(k), step_m * static_cast<float>(k)));
  }
  film.to_s = film.frames.back().time_s;
  return film;
}

/// Of the pixels of the sheet's colours: left, right, top and bottom, within a rectangle of the picture.
struct Extent {
  int left = 1 << 30, right = -1, top = 1 << 30, bottom = -1;
  bool operator==(const Extent&) const = default;
};
Extent extent_within(const Image& image, const Rect& rect) {
  const std::uint32_t panel = pixel_of(light_theme()[static_cast<std::size_t>(Ink::kPanel)]);
  Extent extent;
  const int x0 = static_cast<int>(rect.x), y0 = static_cast<int>(rect.y);
  for (int y = 24; y < static_cast<int>(rect.height) - 2; ++y) {
    for (int x = 2; x < static_cast<int>(rect.width) - 2; ++x) {
      if (image.pixels[static_cast<std::size_t>((y + y0) * image.width + x + x0)] == panel) continue;
      extent.left = std::min(extent.left, x);
      extent.right = std::max(extent.right, x);
      extent.top = std::min(extent.top, y);
      extent.bottom = std::max(extent.bottom, y);
    }
  }
  return extent;
}

/// \pre a layout of cells no higher than the picture's
Rect cell_of(const FilmLayout& layout, std::size_t frame) {
  Rect cell = layout.cell(frame);
  cell.x += 16;
  cell.y += 44;
  return cell;
}

}  // namespace

TEST_CASE("any number of frames in any number of columns is laid out side by side within bounds") {
  for (std::size_t frames = 1; frames <= kMostFilmFrames; ++frames) {
    for (int columns = 0; columns <= kMostFilmColumns; ++columns) {
      for (const double aspect : {0.01, 0.7, 1.0, 50.0}) {
        const FilmLayout layout = film_layout(frames, columns, aspect);
        if (columns > 0) REQUIRE(layout.columns == std::min(columns, static_cast<int>(frames)));
        REQUIRE(layout.columns * layout.rows >= static_cast<int>(frames));
        REQUIRE(layout.columns * (layout.rows - 1) < static_cast<int>(frames));
        REQUIRE(layout.width <= 3400);
        REQUIRE(layout.grid_height <= 12000);
        REQUIRE(layout.cell_width >= 56);
        const Rect first = layout.cell(0), last = layout.cell(frames - 1);
        REQUIRE(first.x == 0);
        REQUIRE(first.y == 0);
        REQUIRE(last.right() <= layout.width);
        REQUIRE(last.bottom() <= layout.grid_height + 1e-9);
        if (frames > 1) {
          const Rect second = layout.cell(1);
          REQUIRE((second.x >= first.right() || second.y >= first.bottom()));
        }
      }
    }
  }
}

TEST_CASE("chosen columns leave little empty and make a picture wider than high") {
  CHECK(film_layout(1, 0, 1).columns == 1);
  const FilmLayout twelve = film_layout(12, 0, 1);
  CHECK(twelve.columns * twelve.rows == 12);
  CHECK(twelve.width > twelve.grid_height);
}

TEST_CASE("one camera and scale: a sheet that stands still looks the same in every frame, one that moves moves") {
  const FilmLayout layout = film_layout(3, 3, 0.4);
  Film still = film_of(3);
  still.columns = 3;
  const Image image = film_picture(still);
  CHECK(image.width == layout.width);
  // The first cell has the scale bar and axes too.
  const Extent second = extent_within(image, cell_of(layout, 1)), third = extent_within(image, cell_of(layout, 2));
  CHECK(second.right > second.left);
  CHECK(second == third);

  Film moving = film_of(3, 0.05f);
  moving.columns = 3;
  const Image moved = film_picture(moving);
  const Extent before = extent_within(moved, cell_of(layout, 1)), after = extent_within(moved, cell_of(layout, 2));
  CHECK(before.left != after.left);
  CHECK(std::abs((before.right - before.left) - (after.right - after.left)) <= 2);
}

TEST_CASE("the camera follows a sheet that leaves, at the same scale") {
  Film away = film_of(3, 4.0f);
  away.columns = 3;
  const Image image = film_picture(away);
  const FilmLayout layout = film_layout(3, 3, 0.4);
  const Extent second = extent_within(image, cell_of(layout, 1)), third = extent_within(image, cell_of(layout, 2));
  CHECK(second.right - second.left > 0.4 * layout.cell_width);
  CHECK(std::abs(second.left - third.left) <= 2);
  CHECK(std::abs(second.right - third.right) <= 2);
}

TEST_CASE("the legend tells of what occurs in any frame, once") {
  Film film = film_of(3);
  const auto texts = [&] {
    std::vector<std::string> all;
    for (const LegendEntry& entry : sheet_legend(film.frames, "")) all.push_back(entry.text);
    return all;
  };
  const auto has = [&](const std::string& text) {
    const auto all = texts();
    return std::count_if(all.begin(), all.end(), [&](const auto& one) { return one.starts_with(text); });
  };
  CHECK(has("sliding contact") == 0);
  CHECK(has("crumpling") == 0);
  CHECK(has("ridge") == 0);
  film.frames[1].contacts = {{{0, 0, 0}, std::nullopt, true}};
  film.frames[2].events = {crumple(1, 0.15, 0.1)};
  film.frames[2].ridge_triangles.assign(film.frames[2].triangles.size(), true);
  film.frames[0].region_curved = {true, false};
  CHECK(has("sliding contact") == 1);
  CHECK(has("resting contact") == 0);
  CHECK(has("crumpling") == 1);
  CHECK(has("ridge") == 1);
  CHECK(has("flat region") == 1);
  const auto all = texts();
  CHECK(std::set<std::string>(all.begin(), all.end()).size() == all.size());
}

TEST_CASE("a legend takes the rows that it needs") {
  std::vector<LegendEntry> entries(7, {"an entry of a legend", Ink::kText, LegendEntry::Shape::kBox});
  CHECK(legend_rows(legend_width(entries), entries) == 1);
  CHECK(legend_rows(legend_width(std::span(entries).first(3)), entries) == 3);
  CHECK(legend_rows(1, entries) == 7);
  CHECK(legend_rows(100, {}) == 0);
}

TEST_CASE("events and contacts show in the film, and empty frames come through") {
  Film film = film_of(2);
  const Image plain = film_picture(film);
  CHECK(plain.pixels == film_picture(film).pixels);
  film.frames[1].events = {crumple(1, 0.05, 0.1)};
  film.frames[1].events[0].position_m = {0.05, 0.1, 0.02};
  CHECK(film_picture(film).pixels != plain.pixels);
  film = film_of(2);
  film.frames[1].contacts = {{{0.05, 0.1, 0.02}, std::nullopt, true}};
  CHECK(film_picture(film).pixels != plain.pixels);
  film.frames[0] = {};
  CHECK(film_picture(film).width > 0);
  Film nothing;
  nothing.frames.resize(1);
  CHECK(film_picture(nothing).width > 0);
}

}  // namespace rustle::report::film_picture_test
