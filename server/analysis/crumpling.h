#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "server/analysis/curvature.h"
#include "server/analysis/parameters.h"
#include "server/observation/observation.h"
#include "server/sheet/transfer.h"

/// Crumpling events (P2): connected vertices whose mean curvature changes sign the same way, with hysteresis, dated inside
/// the frame interval; and their history across a change of topology (P14).
namespace rustle::analysis {

/// What is remembered per vertex between frames.
struct CrumplingState {
  bool primed = false;                    ///< a frame has been seen
  double time_s = 0;                      ///< of that frame
  std::vector<float> curvature_per_m;     ///< H then
  std::vector<std::int8_t> sign;          ///< of the last confirmed side, 0: none yet
  std::vector<double> crossed_s;          ///< when H last passed zero
  std::vector<double> flipped_s;          ///< when the vertex last took part in a flip
  std::vector<std::int8_t> flipped_to;    ///< and to which side
  std::vector<std::uint64_t> flipped_in;  ///< and in which event, 0: in one too small to sound
  struct Past {
    double time_s;
    std::vector<float> curvature_per_m;
  };
  std::vector<Past> past;  ///< H over the amplitude window, oldest first

  // Scratch, kept so that a warm frame allocates nothing.
  Curvature now;
  std::vector<std::uint32_t> seeds;
  std::vector<std::vector<float>> spare_per_m;
};

struct CrumplingInputs {
  const CurvatureStencils& stencils;
  std::span<const float> angles_rad;                   ///< [E]
  std::span<const sheet::Vec3f> positions_m;           ///< [V] in space
  std::span<const sheet::Vec3f> velocities_m_per_s;    ///< [V] or empty: differenced from the following
  std::span<const sheet::Vec3f> previous_positions_m;  ///< [V] of the frame before at the same material points, or empty
  double time_s;
  /// Set on the first frame of a new topology, after carry(): vertices without a counterpart before.
  const std::vector<bool>* remade = nullptr;
  bool remade_are_silent = false;  ///< no event may start at a remade vertex (identity only inferred in space)
};

/// Takes one frame. Ids are drawn from `next_event_id`, in order. Quiet frames cost O(stencils).
[[nodiscard]] std::vector<observation::CrumplingEvent> find_crumpling(const CrumplingInputs& inputs,
                                                                      const Parameters& parameters, CrumplingState& state,
                                                                      std::uint64_t& next_event_id);

/// Moves the state onto the vertices of a new topology: what is continuous is interpolated, what is discrete is taken from
/// the vertex that weighs most; but the sign of a remade vertex never contradicts the H that it is given.
void carry(const sheet::Transfer& transfer, const Parameters& parameters, CrumplingState& state);

}  // namespace rustle::analysis
