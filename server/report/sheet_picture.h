#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <tl/expected.hpp>

#include "server/report/image_canvas.h"
#include "server/report/sheet_view.h"

namespace rustle::report {

/// A large oblique view, the far parts first; beside it the sheet laid flat with its curvature, or without material
/// coordinates a second view; the largest resonators (A, B, ... in the views) with l_r, l_c and whether they are coarse, and
/// the largest events (1, 2, ...); a legend, scales, and a caption with the numbers. `direction` absent: best_view.
void draw_sheet(Canvas& canvas, const Rect& rect, const SheetView& view, const std::optional<ViewDirection>& direction = {});

Image sheet_picture(const SheetView& view, const PictureSize& size = {1400, 860, 1, false},
                    const std::optional<ViewDirection>& direction = {});

/// Error: the path and what to do about it.
[[nodiscard]] tl::expected<void, std::string> write_sheet_png(const std::filesystem::path& path, const SheetView& view,
                                                              const PictureSize& size = {1400, 860, 1, false},
                                                              const std::optional<ViewDirection>& direction = {});

}  // namespace rustle::report
