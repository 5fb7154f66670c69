#pragma once

#include <span>
#include <string_view>
#include <vector>

namespace rustle::generate {

/// What a kind of paper's sound depends on.
struct Paper {
  std::string_view name;  ///< the pack's material
  double grammage_kg_per_m2;
  double thickness_m;
  double bending_stiffness_Nm;  ///< D
  double loss_factor;           ///< η: T60 = 2.2 / (η f)
  double brightness;            ///< multiplies the corner frequencies
};

/// printer-paper, tracing-paper, banknote.
std::span<const Paper> papers();
/// Null when there is none of that name.
const Paper* find_paper(std::string_view name);

/// Frequencies below `below_hz`, rising, of the modes of an l_r x edge strip bent to a cylinder, free along the rulings,
/// held along its straight edges, the air it moves included:
///   m' ω² = D (kx² + ky²)² + (E h / R²) kx⁴ / (kx² + ky²)²,   m' = m + 2 ρ / k,   E h = 12 (1 - ν²) D / h²
/// kx along the rulings: 0, (n + ½) π / l_r; ky: n π / edge; R from the compression of the edge.
std::vector<double> strip_modes_hz(const Paper& paper, double ruling_length_m, double edge_m, double compression,
                                   double below_hz);

}  // namespace rustle::generate
