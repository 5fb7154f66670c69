#pragma once

#include <cstddef>

namespace rustle::analysis {

/// The values that settle the geometric analysis (P1-P5, P14). Defaults as tuned for paper and cloth at hand scale.
struct Parameters {
  // Mean curvature for sign events (P2): kernel radius, and at least so many local edge lengths.
  double event_radius_m = 0.010;
  double event_radius_edges = 1.4;   ///< with the reach of a node's own hinges as much as 1.5 from hinge to vertex
  double event_band_per_m = 0.3;     ///< absolute dead band on H
  double event_band_relative = 0.5;  ///< plus this share of the local bending
  double event_growth_per_m = 0.05;  ///< a seeded flip takes along connected vertices of the new sign beyond this
  double event_min_area_m2 = 1e-4;
  double event_merge_s = 0.05;         ///< a flip that touches an event younger than this continues it
  double event_window_s = 1.0 / 30.0;  ///< amplitude: change of H over this time
  double flip_memory_s = 0.5;          ///< how far back a flip looks for the shape that it came from

  // Bending tensor for regions and rulings (P3).
  double curvature_radius_m = 0.015;
  double curvature_radius_edges = 2.1;  ///< likewise 2.5 from hinge to triangle
  double ridge_width_m = 0.004;         ///< bending is summed over this width to find ridges
  double ridge_width_edges = 1.0;
  double ridge_angle_rad = 0.5;     ///< a_max
  double ridge_low_rad = 0.3;       ///< a ridge goes on, two layers at most, through faces above this
  double ridge_skirt_rad = 0.15;    ///< a face beside a ridge above this belongs to the fold
  double flat_bending_per_m = 2.0;  ///< ε_a: flat below
  double flat_enter_per_m = 1.5;    ///< curved faces become flat below this,
  double flat_leave_per_m = 2.5;    ///< flat ones curved above that
  double flat_memory_s = 0.1;       ///< hysteresis forgets older partitions
  double ruling_agree_rad = 0.44;   ///< neighbours join while rulings differ less than this over ruling_agree_m
  double ruling_agree_m = 0.015;
  double min_region_width_m = 0.006;        ///< regions thinner (2 area / perimeter) join a neighbour
  std::size_t proxy_triangles = 1333;       ///< meshes half as fine again are partitioned on a proxy of this size
  std::size_t ruling_samples = 48;          ///< rulings traced on a whole sheet, of a region its share,
  std::size_t least_ruling_samples = 16;    ///< but no fewer
  double partition_growth = 0.2;            ///< a partition serves until bending somewhere grows or shrinks by this share,
  double partition_change_relative = 0.05;  ///< or changes otherwise by this share of itself
  double partition_change_per_m = 0.2;      ///< plus so much,
  double partition_age_s = 0.1;             ///< or for so long
  double free_border_min_m = 0.002;         ///< a resonator with less free curved border is constrained

  // Friction.
  double contact_radius_m = 0.003;
  double sliding_m_per_s = 0.001;  ///< slower contacts rest: no resonators are sought for them

  double tear_memory_s = 0.25;  ///< a tear tip absent for longer is a new one

  bool operator==(const Parameters&) const = default;
};

}  // namespace rustle::analysis
