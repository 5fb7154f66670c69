#pragma once

#include <span>
#include <string_view>
#include <vector>

namespace rustle::generate {

/// What a kind of paper's sound depends on. Grammage, thickness and D are measured values of such papers; η and crackle are
/// estimates for printer paper's η 0.04.
struct Paper {
  std::string_view name;  ///< the pack's material
  double grammage_kg_per_m2;
  double thickness_m;
  double bending_stiffness_Nm;  ///< D
  double loss_factor;           ///< η: T60 = 2.2 / (η f)
  double crackle;               ///< how many facets a reversal snaps, relative to printer paper
};

/// printer-paper 80 g/m², 104 µm, D 4e-4 N m, η 0.04.
/// tracing-paper 90 g/m², 75 µm, D 2.5e-4 N m: pulp beaten until the sheet is dense and clear. No loose fibres rub in it, so
/// η is 0.03; thin and stiff for its weight it folds in narrower ridges, more of them: crackle 1.6.
/// banknote 97 g/m², 110 µm, D 6e-4 N m: long cotton fibres, limp from handling, which bend rather than break: η 0.055,
/// crackle 0.6.
std::span<const Paper> papers();
/// Null when there is none of that name.
const Paper* find_paper(std::string_view name);

/// What corner frequencies are multiplied by, 1 for printer paper (p):
///   b = (h_p / h)^(1/3) [ √(D/m) / η² : √(D_p/m_p) / η_p² ]^0.365
/// A ridge of length X is h^(1/3) X^(2/3) wide (Lobkovsky et al. 1995), and a narrow one snaps faster. A bending wave that
/// goes a distance d keeps the frequencies up to ω ∝ √(D/m) / (η d)²; corners are found to fall as d^-0.73 rather than d^-2
/// (P6), hence the exponent. Tracing paper 1.24, banknote 0.81. Scalings, not measurements.
double brightness(const Paper& paper);

/// A frequency f that a power law of size gives, held down where the law is carried on to smaller sizes than it was found
/// at: from about `from_hz` = f₀ on it rises with 0.4 of its power,
///   f' = f [1 + (f / f₀)⁵]^-0.12
double levelled_off(double frequency_hz, double from_hz);

/// T60 at a frequency, 2.2 / (η f).
double decay_s(const Paper& paper, double frequency_hz);

/// Frequencies below `below_hz`, rising, of the modes of an l_r x edge strip bent to a cylinder, free along the rulings,
/// held along its straight edges, the air it moves included:
///   m' ω² = D (kx² + ky²)² + (E h / R²) kx⁴ / (kx² + ky²)²,   m' = m + 2 ρ / k,   E h = 12 (1 - ν²) D / h²
/// kx along the rulings: 0, (n + ½) π / l_r; ky: n π / edge; R from the compression of the edge.
std::vector<double> strip_modes_hz(const Paper& paper, double ruling_length_m, double edge_m, double compression,
                                   double below_hz);

}  // namespace rustle::generate
