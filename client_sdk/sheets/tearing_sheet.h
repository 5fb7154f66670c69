#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/sheets/sheet_stream.h"
#include "client_sdk/sheets/tearing_cone.h"
#include "client_sdk/sheets/tearing_hands.h"
#include "client_sdk/sheets/tearing_mesh.h"
#include "client_sdk/sheets/tearing_path.h"
#include "client_sdk/sheets/torn_fibres.h"

namespace rustle::sheets {

/// How stiffly a paper bends between the thumbs: length of the cone's tangents over half the thumbs' distance. 1 for
/// "printer-paper", less for thinner papers, which bend closer to the thumbs, more for stiffer ones.
[[nodiscard]] double cone_roundness(std::string_view material);

struct TearingOptions {
  RectangleSize size;
  std::size_t triangles = 1333;  ///< before it is torn
  std::uint64_t seed = 1;        ///< of the mesh, the tear's beginning and its details
  std::optional<Grips> grips;    ///< absent: usual_grips()
  std::string material = "printer-paper";
  double torn_m_per_rad = 0.15;   ///< C of eq. 1
  double stress_share = 0.3;      ///< p of eq. 2
  std::optional<double> texel_m;  ///< of the torn edge; absent: a tenth of the mesh's edges, 0.8 to 4 mm
};

/// What became of a step.
struct TearAdvance {
  double share =
      1;  ///< of turning and moving that the sheet could follow: hands can turn only so far before they must grip anew
  double torn_m = 0;  ///< advance of the tip
  bool mesh_changed = false;
  bool separated = false;  ///< in two, since this step or before
};

/// A sheet of paper that two hands tear on a table (paper tearing 2015, sections 3 and 4), step by step as an application
/// tells it.
///
/// Both hands' regions are planar and follow them, turning about the crack tip; between the lines from the tip through the
/// thumbs the sheet is a cone (TearCone). The tip goes where the hands' rotations lead it (rotation_advance()), and beyond
/// the paper where they are moved apart (translation_advance()); the regions meet in the new tip, the hands giving way
/// evenly. The mesh is cut along the detailed path (TearPath, TornMesh) a texel behind the tip at most. When what is left
/// before the border is narrow it gives way at once; then the hands move a piece each, and the cone's rest lies down.
///
/// The same options and steps give the same bits. One thread at a time.
class TearingSheet {
 public:
  /// Errors: a sentence that names the field. Sizes 0.02 to 10 m, 50 to 100,000 triangles, a texel of a tenth of the
  /// shorter side at most, 0 ≤ stress_share ≤ 1, thumbs on the sheet, 2 cm apart at least, each on its hand's side of the
  /// tear and 5 mm at least beyond its beginning.
  [[nodiscard]] static tl::expected<TearingSheet, std::string> make(const TearingOptions& options);

  /// One step of `dt_s`. Errors: "motions" not finite, dt_s not above 0; nothing has happened then.
  [[nodiscard]] tl::expected<TearAdvance, std::string> advance(const HandMotions& motions, double dt_s);

  /// The mesh as it is; another object whenever a vertex or triangle changed.
  const std::shared_ptr<const SheetMesh>& mesh() const { return mesh_; }
  std::span<const TornVertex> vertices() const { return torn_.vertices(); }
  /// x, y, z of every vertex; the middle of the sheet lies at the origin before anything moves, its borders along x and y.
  /// \pre xyz_m.size() == 3 mesh()->material_coordinates.size()
  void positions(std::span<float> xyz_m) const;
  /// 1 where a finger holds the sheet. \pre mask.size() == mesh()->material_coordinates.size()
  void anchored(std::span<std::uint8_t> mask) const;

  /// Absent when the sheet is in two.
  std::optional<SheetTearTip> tip() const;
  std::vector<TornFibre> fibres(const FibreOptions& options = {}) const { return torn_fibres(torn_, options); }
  std::span<const Point2> path_m() const { return path_.points_m(); }

  const TearPose& pose() const { return pose_; }
  const TearCone& cone() const { return cone_; }
  bool separated() const { return separated_; }
  double torn_length_m() const { return torn_m_; }  ///< of the tip's way
  const RectangleSize& size() const { return options_.size; }

 private:
  struct Planned {
    TearPose pose;
    Point2 advance_m;
    bool through = false;  ///< the border is reached
  };

  TearingSheet(const TearingOptions& options, TearPath path, const TearPose& pose);

  Planned plan(const HandMotions& motions, double share) const;
  /// The greatest share of a small motion that hands can do.
  double possible_share(const HandMotions& motions) const;
  /// Takes a plan; the tip's advance.
  double follow(const Planned& planned);
  void move_pieces(const HandMotions& motions, double dt_s);
  std::vector<Point2> left_outline_m() const;
  std::vector<TornSide> sides() const;
  Point3 place(Point2 material_m, TornSide side) const;

  TearingOptions options_;
  TearPose pose_;
  TearPath path_;
  TornMesh torn_;
  std::shared_ptr<const SheetMesh> mesh_;
  TearCone cone_;
  Point2 ahead_;  ///< the tear's direction in the material plane, unit length
  double speed_m_per_s_ = 0;
  double torn_m_ = 0;
  bool separated_ = false;
  std::array<PlanarPose, 2> pieces_, pieces_at_first_;  ///< once separated
  double lying_down_s_ = 0;
};

}  // namespace rustle::sheets
