#pragma once

#include <span>
#include <string>
#include <vector>

#include "server/report/axis.h"
#include "server/report/levels.h"
#include "server/report/sound_event.h"

/// What happened when: events in lanes, levels, waveform. Pure drawing; any number of events draws at most a mark per pixel.
namespace rustle::report {

Ink ink_of(EventKind kind);

/// Amplitude as a height in [0, 1]: 1 at `largest`, 0.08 at a thousandth of it and below, linear in its logarithm between.
double amplitude_height(double amplitude, double largest);

/// Which kinds occur.
std::vector<LegendEntry> kind_legend(std::span<const EventMark> events);

struct EventTicks {
  std::uint32_t sheet = 0;
  bool every_sheet = true;  ///< then `sheet` does not matter
  double largest = 0;       ///< amplitude of a full height; 0: of the events drawn
};

/// A vertical line per crumpling event, rising from the rectangle's lower edge by amplitude_height.
/// Of several in one pixel the largest is drawn. Events outside the time axis are left out.
void draw_crumpling_ticks(Canvas& canvas, const Rect& rect, const Axis& time, std::span<const EventMark> events,
                          const EventTicks& which);

/// Speed by pixel column of the axis, the greatest among the episodes of a kind; < 0 where none is in contact.
std::vector<double> speed_columns(const Axis& time, std::span<const EventMark> events, EventKind kind,
                                  const EventTicks& which);

struct TimelineSheet {
  std::uint32_t id = 0;
  std::string name;
};

struct TimelineInput {
  std::span<const EventMark> events;
  std::span<const TimelineSheet>
      sheets;  ///< their order is that of the rows; sheets that occur in events only come after them
  double start_s = 0, end_s = 0;
};

/// Rows beyond this many sheets are drawn together as one.
inline constexpr std::size_t kMostTimelineRows = 8;

/// Height in pixels that draw_timeline needs.
double timeline_height(const TimelineInput& input);

/// Per sheet a lane for each kind that the sheet has: crumpling ticks by amplitude, friction and tearing speed as filled
/// curves whose scale is written at the lane.
void draw_timeline(Canvas& canvas, const Rect& rect, const TimelineInput& input);

/// RMS (filled) and peak per window over time, 0 dBFS and the limiter's threshold as dashed lines; floor at -90 dBFS.
void draw_levels(Canvas& canvas, const Rect& rect, const LevelTrack& track, double end_s, double limit_db);

/// Lowest and highest sample per pixel, all channels over each other.
void draw_waveform(Canvas& canvas, const Rect& rect, const Sound& sound);

}  // namespace rustle::report
