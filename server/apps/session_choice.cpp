#include "server/apps/session_choice.h"

#include <fmt/format.h>

#include <algorithm>

namespace rustle::apps {

tl::expected<std::string, NoSession> choose_session(const client::Connection& connection, const std::string& named) {
  const auto sessions = connection.list_sessions();
  if (!sessions) return tl::unexpected(NoSession{client::to_string(sessions.error()), kFailed});
  std::string names;
  for (const auto& session : *sessions) names += " " + session.session_id;
  const auto refuse = [](std::string message) { return tl::unexpected(NoSession{std::move(message), kWrongUsage}); };
  if (!named.empty()) {
    const bool there = std::any_of(sessions->begin(), sessions->end(), [&](const auto& s) { return s.session_id == named; });
    if (there) return named;
    return refuse(
        fmt::format("there is no session \"{}\"; {}", named, names.empty() ? "none is attached" : "there are:" + names));
  }
  if (sessions->empty()) return refuse("no session is attached; start a simulator, or `rustle replay CAPTURE`");
  if (sessions->size() > 1) return refuse("several sessions are attached, name one:" + names);
  return sessions->front().session_id;
}

}  // namespace rustle::apps
