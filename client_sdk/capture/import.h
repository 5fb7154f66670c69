#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/capture/mcap_writer.h"
#include "rustle/v1/session.pb.h"

namespace rustle::capture {

struct ImportOptions {
  double metres_per_unit = 1.0;  ///< of every length in the input; stated in the capture, positions stay as they are
  v1::UpAxis up_axis = v1::UP_AXIS_Z;
  v1::SheetKind sheet_kind = v1::SHEET_KIND_PAPER;
  std::string material;          ///< a pack's, such as "printer-paper"; empty: the session's default
  std::string obstacle_surface;  ///< the obstacles' surface material; empty: the sheet's touched surface
  std::string touched_surface;   ///< of the sheet; empty: "wooden-table"
  double frames_per_s = 0;       ///< 0: the input's own times; needed where it has none
  bool reflecting = true;        ///< flat, fixed obstacles that reach beyond the whole motion become reflecting planes
  bool texture_coordinates_are_material = false;  ///< OBJ: vt are the flat sheet's coordinates, in the input's units
  std::string session_id;                         ///< empty: the stem of the output file
  McapWriterOptions mcap;
};

struct ImportSummary {
  std::uint64_t frames = 0;
  std::uint64_t topologies = 0;
  std::uint64_t obstacles = 0;
  std::uint64_t reflecting_planes = 0;  ///< of the obstacles
  std::uint64_t min_vertices = 0, max_vertices = 0;
  std::uint64_t min_triangles = 0, max_triangles = 0;
  double first_time_s = 0;
  double last_time_s = 0;
  bool material_coordinates = false;
  std::uint64_t messages = 0;
  std::uint64_t bytes = 0;           ///< of the capture
  std::vector<std::string> remarks;  ///< for a person: what was decided or passed over
};

struct ImportError {
  std::string file;
  std::string field;    ///< such as "positions" or "line 12"; may be empty
  std::string message;  ///< what is wrong
  std::string remedy;

  std::string text() const;  ///< all four in one line
};

/// Called now and then with the part done, rising from 0 to 1.
using ImportProgress = std::function<void(double fraction)>;
using ImportResult = tl::expected<ImportSummary, ImportError>;

/// `input` is a `.npz` file, an `.obj` or `.ply` file, a folder of these, or a pattern such as "frames/f_*.obj".
/// `output` appears only when all went well; what had that name before stays until then.
ImportResult import_capture(const std::string& input, const std::filesystem::path& output, const ImportOptions& options,
                            const ImportProgress& progress = {});

/// Checks what is common to all inputs.
tl::expected<void, ImportError> check_options(const ImportOptions& options);

}  // namespace rustle::capture
