#pragma once

#include <string>
#include <string_view>

namespace rustle::apps {

/// From now on what is logged goes to standard error: coloured lines on a terminal, or, as JSON, one object a line:
///   {"time":"2026-01-31T12:00:00.123Z","level":"warning","session":"flag","message":"..."}
/// `level` as the configuration says it: "debug", "info", "warning", "error" or "off".
void log_to_stderr(const std::string& level, bool as_json);

/// As long as it lives, what its thread logs is about this session, which JSON tells in a field of its own. The innermost
/// counts. \pre `session` outlives it
class AboutSession {
 public:
  explicit AboutSession(std::string_view session) noexcept;
  ~AboutSession();
  AboutSession(const AboutSession&) = delete;
  AboutSession& operator=(const AboutSession&) = delete;

 private:
  const std::string_view before_;
};

}  // namespace rustle::apps
