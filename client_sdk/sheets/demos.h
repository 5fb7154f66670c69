#pragma once

#include <memory>
#include <span>
#include <string_view>

#include "client_sdk/sheets/animated_sheet.h"

namespace rustle::sheets {

/// Demonstrations of an A4 sheet (0.297 m along x) on a table at z = 0:
///   bend   it lies flat; its back edge is held at x = 0 and the front edge slides toward it, so that it bows up
///   slide  an arched sheet is slid to and fro over the table at changing speed
///   snap   the back edge is released and the sheet stands up on its front edge, bending the other way at once; twice
///   shake  it is held in the air along one border and wiggled
///   bend_slide_snap_shake   all of these in one continuous motion, after Figs. 1 and 17 of the paper (Schreck et al. 2016)
[[nodiscard]] std::span<const std::string_view> demo_names();

/// Null: no such name. The mesh is Delaunay; the same arguments give the same bits.
[[nodiscard]] std::unique_ptr<AnimatedSheet> make_demo(std::string_view name, std::size_t triangle_count = 1333,
                                                       std::uint64_t seed = 1);

/// The same motion on a mesh of the rectangle [0, 0.297] x [0, 0.210].
[[nodiscard]] std::unique_ptr<AnimatedSheet> make_demo_on(SheetMesh mesh, std::string_view name);

}  // namespace rustle::sheets
