#include "sound_db/generate/cloth_material.h"

#include <algorithm>

namespace rustle::generate {

namespace {

constexpr std::array<ClothMaterial, 4> kMaterials{{
    {.name = "cotton",
     .grammage_kg_per_m2 = 0.15,
     .bands = {{{420, 0.15, 0.90, 0.85}, {2200, 0.15, 0.85, 0.15}}},
     .floor = 0.006,
     .level = 0.030,
     .level_exponent = 0.85,
     .grain_db = 2.6,
     .wander_octaves = 0.55,
     .tilt_db = 4.5,
     .balance_db = 6.0,
     .pops_per_s = 120,
     .pop_low_hz = 300,
     .pop_high_hz = 3000,
     .pop_short_ms = 0.6,
     .pop_long_ms = 5.0,
     .pop_level = 0.20,
     .pop_exponent = 1.35,
     .wale_spacing_m = 0,
     .units_per_s = 240,
     .filter_widths = {20, 50, 10},
     .lambda = 1e2,
     .look_ahead = 5,
     .greatest_distance = 2,
     .speed_threshold_m_per_s = 0.02},
    {.name = "polyester",
     .grammage_kg_per_m2 = 0.08,
     .bands = {{{3400, 0.40, 0.22, 0.70}, {7800, 0.40, 0.25, 0.15}}},
     .floor = 0.15,
     .level = 0.022,
     .level_exponent = 0.80,
     .grain_db = 2.0,
     .wander_octaves = 0.10,
     .tilt_db = 3.0,
     .balance_db = 3.0,
     .pops_per_s = 100,
     .pop_low_hz = 2500,
     .pop_high_hz = 9000,
     .pop_short_ms = 0.3,
     .pop_long_ms = 1.5,
     .pop_level = 0.22,
     .pop_exponent = 1.35,
     .wale_spacing_m = 0,
     .units_per_s = 240,
     .filter_widths = {10, 50, 20},
     .lambda = 1e5,
     .look_ahead = 10,
     .greatest_distance = 2,
     .speed_threshold_m_per_s = 0.02},
    {.name = "windbreaker",
     .grammage_kg_per_m2 = 0.06,
     .bands = {{{1900, 0.33, 0.25, 0.60}, {4800, 0.33, 0.30, 0.25}}},
     .floor = 0.15,
     .level = 0.060,
     .level_exponent = 0.75,
     .grain_db = 2.4,
     .wander_octaves = 0.12,
     .tilt_db = 3.5,
     .balance_db = 4.0,
     .pops_per_s = 240,
     .pop_low_hz = 1200,
     .pop_high_hz = 7000,
     .pop_short_ms = 0.3,
     .pop_long_ms = 3.0,
     .pop_level = 0.40,
     .pop_exponent = 1.30,
     .wale_spacing_m = 0,
     .units_per_s = 240,
     .filter_widths = {20, 30, 10},
     .lambda = 1e5,
     .look_ahead = 5,
     .greatest_distance = 2,
     .speed_threshold_m_per_s = 0},
    {.name = "corduroy",
     .grammage_kg_per_m2 = 0.30,
     .bands = {{{1300, 0.10, 0.75, 0.80}, {4200, 0.10, 0.80, 0.20}}},
     .floor = 0.04,
     .level = 0.050,
     .level_exponent = 0.80,
     .grain_db = 2.0,
     .wander_octaves = 0.30,
     .tilt_db = 3.5,
     .balance_db = 4.0,
     .pops_per_s = 0,
     .pop_low_hz = 500,
     .pop_high_hz = 2000,
     .pop_short_ms = 1,
     .pop_long_ms = 3,
     .pop_level = 0,
     .pop_exponent = 1.5,
     .wale_spacing_m = 0.0014,
     .units_per_s = 60,
     .filter_widths = {20, 30, 10},
     .lambda = 0,
     .look_ahead = 10,
     .greatest_distance = 3,
     .speed_threshold_m_per_s = 0.02},
}};

}  // namespace

std::span<const ClothMaterial> cloth_materials() {
  return kMaterials;
}

const ClothMaterial* find_cloth_material(std::string_view name) {
  const auto at = std::find_if(kMaterials.begin(), kMaterials.end(), [&](const ClothMaterial& m) { return m.name == name; });
  return at == kMaterials.end() ? nullptr : &*at;
}

}  // namespace rustle::generate
