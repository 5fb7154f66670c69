#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/analysis/sheet_analyzer.h"
#include "server/apps/capture_source.h"
#include "server/report/sheet_view.h"
#include "server/scene/scene_state.h"

namespace rustle::apps {

/// When one sheet of a capture has frames.
struct SheetTimes {
  sheet::SheetId sheet = 0;
  std::vector<double> times_s;          ///< in the order of the capture
  std::vector<sheet::SheetId> present;  ///< all sheets that have any
  /// Why there are none, and what to do.
  std::string nothing() const;
};
/// Reads the source to its end. `wanted` absent: the sheet of the first frame.
SheetTimes sheet_times(CaptureSource& source, std::optional<sheet::SheetId> wanted);

/// One frame of the sheet as the analysis saw it.
struct InspectedMoment {
  sheet::SheetId sheet = 0;
  std::string sheet_name;
  report::SheetView view;  ///< without a title
  std::size_t triangles = 0;
  std::vector<observation::Resonator> regions;
  std::size_t ridge_triangles = 0;
  std::size_t touching_vertices = 0;
  std::size_t sliding_contacts = 0;
  std::size_t coarse_regions() const;
};

/// Analyses the sheets of a capture as the engine does, frame by frame, and pictures one of them when asked.
class InspectedSheet {
 public:
  /// `wanted` absent: the sheet of the first frame. The source outlives it.
  InspectedSheet(CaptureSource& source, std::optional<sheet::SheetId> wanted) : source_(source), shown_(wanted) {}

  /// Goes on to the sheet's next frame; false when there is none up to `until_s`, and from then on.
  bool next(double until_s);
  /// \pre next() was true; as all below
  double time_s() const;
  /// The partition of this frame alone, its contacts holding, and the events kept so far where that part of the sheet is
  /// now.
  InspectedMoment moment() const;
  void forget_events_before(double time_s);
  /// Why next() never was true, and what to do.
  std::string nothing_until(double until_s) const;

 private:
  struct Sheet {
    engine::SheetDescription description;
    std::unique_ptr<analysis::SheetAnalyzer> analyzer;
    std::optional<sheet::MeshFrame> newest, previous;
    observation::Observation observation;
  };
  /// An event and the vertex that it happened at.
  struct Placed {
    observation::CrumplingEvent event;
    std::shared_ptr<const sheet::Topology> topology;
    std::optional<std::uint32_t> vertex;
  };
  void analyse(sheet::MeshFrame frame);
  sheet::Vec3d place_now(const Placed& placed, const sheet::MeshFrame& frame) const;
  void add_contacts(const Sheet& shown, InspectedMoment& moment) const;

  CaptureSource& source_;
  std::optional<sheet::SheetId> shown_;
  std::map<sheet::SheetId, Sheet> sheets_;
  scene::SceneState scene_;
  std::uint64_t next_event_id_ = 1;
  std::vector<Placed> events_;
  bool ended_ = false;
};

}  // namespace rustle::apps
