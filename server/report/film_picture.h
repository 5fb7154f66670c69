#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "server/report/image_canvas.h"
#include "server/report/sheet_view.h"

namespace rustle::report {

/// A sheet at several times.
struct Film {
  std::string title;
  std::vector<SheetView> frames;  ///< in order of time; of each the events since the frame before
  double from_s = 0, to_s = 0;    ///< the time range that the frames are spread over
  int columns = 0;                ///< 0: as many as make a picture a little wider than high
};

inline constexpr std::size_t kMostFilmFrames = 100;
inline constexpr int kMostFilmColumns = 20;

/// Where the frames of a film go, in pixels.
struct FilmLayout {
  int columns = 1, rows = 1;
  double cell_width = 0, cell_height = 0;  ///< each with a line of text above the sheet
  int width = 0;                           ///< of the whole picture
  double grid_height = 0;                  ///< of all rows
  Rect cell(std::size_t frame) const;      ///< in a grid whose corner is the origin
};

/// `aspect`: height / width of what a cell shows. Row by row; the picture stays below 3400 pixels in width and the grid
/// below 12000 in height. Pure. \pre 1 <= frames <= kMostFilmFrames, 0 <= columns <= kMostFilmColumns
FilmLayout film_layout(std::size_t frames, int columns, double aspect);

/// Gives every view's regions numbers that stay from view to view (continued_categories), so that a colour means the same
/// region for as long as it lasts.
void share_colours(std::vector<SheetView>& frames);

/// A contact sheet: the frames as small pictures with their times, numbers of events and contacts, the largest events
/// ringed; a time line with every event and the frames' places; one legend. One camera and one scale throughout, which
/// stands still unless the sheet moves away by more than twice its own size: then it follows and says so.
/// \pre 1 <= film.frames.size() <= kMostFilmFrames
Image film_picture(Film film);

/// Error: the path and what to do about it.
[[nodiscard]] tl::expected<void, std::string> write_film_png(const std::filesystem::path& path, Film film);

}  // namespace rustle::report
