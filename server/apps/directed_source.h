#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <variant>

#include "server/apps/capture_source.h"
#include "server/session/offline.h"

namespace rustle::apps {

/// The steps that a recorded session took, as render_offline() takes them again: every item where the daemon gave it to the
/// engine, none that it dropped. Samples count from the recording's first. One thread at a time.
class DirectedSource {
 public:
  /// `source` must outlive this. \pre source.begun()
  explicit DirectedSource(CaptureSource& source) : source_(source), first_sample_(source.begun()->first_sample) {}

  /// The next step, or nothing at the recording's end.
  std::optional<session::DirectedItem> next();

  /// Frames that the daemon dropped, by cause.
  const std::map<std::string, std::uint64_t>& frames_dropped() const { return frames_dropped_; }

 private:
  using What = decltype(session::DirectedItem::what);

  std::optional<session::DirectedItem> held_at_the_beginning(CaptureSource::Arrived& arrived);
  std::optional<session::DirectedItem> decided(const session::Decision& decision);
  session::DirectedItem taken_again(const session::Step& step);
  /// What a step at `accepted_at` did. Of a message that came before the recording, or failed, nothing is left.
  What what_of(const session::Given& given, synthesis::SampleTime accepted_at);
  What what_of(const session::Failed& failed, synthesis::SampleTime accepted_at);
  What what_of(const session::FellQuiet& quiet, synthesis::SampleTime) { return quiet; }
  What what_of(const session::Asked& asked, synthesis::SampleTime) {
    return std::visit([](const auto& change) { return engine::StreamItem(change); }, asked);
  }
  What what_of(const session::Ended&, synthesis::SampleTime) { return engine::StreamItem(engine::End{}); }
  synthesis::SampleTime from_first(synthesis::SampleTime sample) const;

  CaptureSource& source_;
  const synthesis::SampleTime first_sample_;
  std::map<std::uint64_t, engine::StreamItem> undecided_;  ///< by arrival
  std::optional<engine::TimeMapping> mapping_;             ///< comes into force with the next step
  std::map<std::string, std::uint64_t> frames_dropped_;
};

}  // namespace rustle::apps
