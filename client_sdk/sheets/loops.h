#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "client_sdk/sheets/rectangle.h"
#include "client_sdk/sheets/sheet_stream.h"

namespace rustle::sheets {

/// One frame of a loop.
struct LoopFrame {
  std::vector<float> xyz_m;  ///< [3V] of its mesh
  std::size_t mesh = 0;      ///< which of the loop's
  bool fresh = false;        ///< another sheet than in the frame before: nothing moved there
  std::vector<SheetTearTip> tear_tips{};
};

/// A motion that goes on for ever: its frames, one after another, again and again. It has no jump but where a sheet is
/// fresh.
struct Loop {
  std::vector<SheetMesh> meshes;  ///< one where the topology stays as it is
  bool on_table = false;          ///< a table, solid below z = 0, belongs to it
  bool cloth = false;             ///< it is of cloth, not of paper
  std::vector<LoopFrame> frames;  ///< at equal steps of time
};

/// Motions that sound all the time, for synthetic clients:
///   crumple  a strip held in the air along one border; a wave runs along it, so that every place reverses 5 times a second
///   slide    an arched sheet slides to and fro over a table, 0.3 m/s at most
///   cloth    cloth is rubbed to and fro over a table, wrinkles running along: make_rubbed_cloth()
///   tear     a sheet is torn across at about 0.15 m/s, its mesh cut at every frame; then comes a fresh one
[[nodiscard]] std::span<const std::string_view> loop_names();

/// Absent: no such name. A4, cloth 0.6 x 0.45 m; Delaunay; the same arguments give the same bits. \pre triangle_count ≥ 50,
/// frames_per_s > 0
[[nodiscard]] std::optional<Loop> make_loop(std::string_view name, std::size_t triangle_count, double frames_per_s,
                                            std::uint64_t seed = 1);

}  // namespace rustle::sheets
