#pragma once

#include "server/engine/options.h"
#include "server/session/session_options.h"

namespace rustle::session {

/// The options in force: every default filled in, nothing left at 0 or absent.
SessionOptions settled(SessionOptions options);

/// The same for the engine. \pre options are settled
engine::Options engine_options(const SessionOptions& options);

}  // namespace rustle::session
