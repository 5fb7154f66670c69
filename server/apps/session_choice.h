#pragma once

#include <string>

#include <tl/expected.hpp>

#include "client_sdk/cpp/connection.h"
#include "server/apps/command.h"

namespace rustle::apps {

struct NoSession {
  std::string message;
  ExitStatus status;
};

/// The daemon's session of this name; with an empty name the only one there is.
tl::expected<std::string, NoSession> choose_session(const client::Connection& connection, const std::string& named);

}  // namespace rustle::apps
