#pragma once

#include <span>

#include "server/report/canvas.h"
#include "server/report/sound_event.h"

/// What the events are like. Pure drawing.
namespace rustle::report {

/// A place in a sound pack's grid (P6).
struct PackGridPoint {
  double ruling_length_m = 0;
  double free_border_length_m = 0;
};

/// Counts of crumpling events by amplitude: four bars a decade, both axes logarithmic. Amplitudes that are not positive and
/// finite are left out.
void draw_amplitude_histogram(Canvas& canvas, const Rect& rect, std::span<const EventMark> events);

/// Every resonator of every event at (l_r, l_c), coloured by the event's kind, over the pack's grid points as crosses;
/// constrained ones, which have no l_c, in a strip below. Points on the same pixel are drawn once.
void draw_resonators(Canvas& canvas, const Rect& rect, std::span<const EventMark> events,
                     std::span<const PackGridPoint> grid);

}  // namespace rustle::report
