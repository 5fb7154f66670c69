#pragma once

#include <memory>

#include "server/engine/options.h"
#include "server/session/session_options.h"

namespace rustle::session {

/// The options in force: every default filled in, nothing left at 0 or absent but the playout delay of a
/// live session, which then adapts.
SessionOptions settled(SessionOptions options);

/// The options under which a session that was recorded with `recorded` is heard again on the simulation clock, offline or
/// through a daemon: what belonged to the live clock does not count.
SessionOptions replayed(SessionOptions recorded);

/// The same for the engine, with the head that options.hrtf names where the sound is binaural. \pre options are settled
engine::Options engine_options(const SessionOptions& options, std::shared_ptr<const spatial::Hrtf> hrtf = nullptr);

}  // namespace rustle::session
