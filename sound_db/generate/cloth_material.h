#pragma once

#include <array>
#include <span>
#include <string_view>

#include "sound_db/pack/cloth_corpus.h"

namespace rustle::generate {

/// A band of friction noise, Gaussian over log2 of frequency.
struct ClothBand {
  double centre_hz;       ///< at 0.5 m/s
  double speed_exponent;  ///< centre ∝ speed^exponent
  double width_octaves;   ///< one σ
  double share;           ///< of the power
};

/// What a kind of cloth sounds like. Bands, grain and pops were set by ear and eye beside recordings of clothes: cotton
/// and corduroy dark and wide, polyester high and narrow, a nylon windbreaker crackling.
struct ClothMaterial {
  std::string_view name;  ///< the pack's material
  double grammage_kg_per_m2;
  std::array<ClothBand, 2> bands;
  double floor;           ///< share of the power that is a wide, soft noise around 1.8 kHz
  double level;           ///< RMS at 0.5 m/s, full scale 1
  double level_exponent;  ///< RMS ∝ speed^exponent
  double grain_db;        ///< irregular loudness, standard deviation over 3 ms
  double wander_octaves;  ///< of the bands, over 60 ms
  double tilt_db;         ///< of 8 kHz against 1 kHz, over 40 ms
  double balance_db;      ///< of the second band against the first, over 50 ms
  double pops_per_s;      ///< at full crumpling; 0: none
  double pop_low_hz, pop_high_hz;
  double pop_short_ms, pop_long_ms;  ///< decay of the softest and of the loudest
  double pop_level;                  ///< peak of the loudest
  double pop_exponent;               ///< of the energies' power law, over four decades
  double wale_spacing_m;             ///< of ribs that click one by one; 0: none
  // Table 3 and section 4.
  double units_per_s;
  std::array<int, 3> filter_widths;
  double lambda;
  int look_ahead;
  double greatest_distance;
  double speed_threshold_m_per_s;
};

/// cotton, polyester, windbreaker (nylon), corduroy (C8).
std::span<const ClothMaterial> cloth_materials();
/// Null when there is none of that name.
const ClothMaterial* find_cloth_material(std::string_view name);

}  // namespace rustle::generate
