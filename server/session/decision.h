#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>

#include "server/engine/stream_item.h"
#include "server/engine/time_mapping.h"
#include "server/synthesis/cue.h"

/// What a session's sound depends on besides the bytes that arrived: recorded beside them, it makes the sound anew, sample
/// for sample. Plain data.
namespace rustle::session {

/// A stream message was given to the engine, which may have refused what it says.
struct Given {
  std::uint64_t arrival = 0;   ///< the message's number in the session, from 1, in the order of arrival
  std::uint64_t sequence = 0;  ///< its own; 0: unnumbered
  bool operator==(const Given&) const = default;
};
/// The engine could not finish it, such as for want of memory. What it had done by then is not known.
struct Failed {
  std::uint64_t arrival = 0, sequence = 0;
  bool operator==(const Failed&) const = default;
};
/// Frames had stopped coming: contacts ended.
struct FellQuiet {
  bool operator==(const FellQuiet&) const = default;
};
/// The daemon ended the stream, as at a detach.
struct Ended {
  bool operator==(const Ended&) const = default;
};

/// What was asked on the control socket or the page, or settled by the daemon, with all that the engine needs of it. A
/// PackReload needs the packs as they were then, too.
using Asked =
    std::variant<engine::GainChange, engine::PackChange, engine::PackReload, engine::LoadLevel, engine::ListenerMove>;

/// One step of a session's engine: what it was given, and from where on that sounds.
struct Step {
  std::variant<Given, Failed, FellQuiet, Ended, Asked> what;
  std::optional<synthesis::SampleTime> earliest;  ///< what it planned begins here or later; live clock only
  synthesis::SampleTime accepted_at = 0;          ///< first sample that its cues took part in
  bool start_again = false;                       ///< simulation time had stepped back: Ingest::start_again came before it

  bool operator==(const Step&) const = default;
};

/// A message that never reached the engine.
struct Dropped {
  std::uint64_t arrival = 0, sequence = 0;
  std::string cause;  ///< as the session's counters name it
  bool operator==(const Dropped&) const = default;
};

/// Every step accepted before this sample has been told: the sound up to here is settled.
struct RenderedTo {
  synthesis::SampleTime sample = 0;
  bool operator==(const RenderedTo&) const = default;
};

/// The first of a recording.
struct RecordingBegun {
  synthesis::SampleTime first_sample = 0;  ///< 0: the whole session is recorded; else the sound before it is not
  std::uint32_t state_messages = 0;        ///< so many stream messages follow of what held then, before what arrives
  std::uint64_t first_arrival = 1;         ///< of the message after these
  bool operator==(const RecordingBegun&) const = default;
};

/// A mapping is in force from the next step on.
using Decision = std::variant<engine::TimeMapping, Step, Dropped, RenderedTo, RecordingBegun>;

}  // namespace rustle::session
