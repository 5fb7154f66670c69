#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "sound_db/pack/friction_sweep.h"

namespace rustle::cloth {

/// Power spectra of a patch of the measured area by sliding speed, A(f, s)² (eqs. 1-3; C1), made ready to be added up over
/// thousands of vertices: rows at speeds that rise geometrically, straight lines between them. Immutable; any thread.
class FrictionPowers {
 public:
  /// Allocates; O(rows x bins). \pre the sweep has a speed
  explicit FrictionPowers(const pack::FrictionSweep& sweep);

  std::size_t rows() const noexcept { return speeds_m_per_s_.size(); }
  std::size_t bins() const noexcept { return bins_; }

  /// Adds a vertex that slides at this speed, which the sweep's compression applies to, to the weights of the rows: `weight`
  /// is the square of its gain √(A_v/A_patch).
  /// Nothing at 0 and below. \pre row_weights.size() == rows()
  void weigh(double speed_m_per_s, double weight, std::span<double> row_weights) const noexcept;

  /// power[k] = Σ_rows weight · A(f_k, s_row)². O(weighted rows x bins), allocates nothing. \pre power.size() == bins()
  void sum(std::span<const double> row_weights, std::span<float> power) const noexcept;

 private:
  static constexpr std::size_t kRows = 192;

  std::size_t bins_;
  pack::SpeedCompression compression_;
  std::vector<double> speeds_m_per_s_;  ///< the first 0, then geometrically
  double slowest_, octave_rows_;        ///< of those after it, and how many of them double the speed
  std::vector<float> powers_;           ///< [rows][bins]
};

}  // namespace rustle::cloth
