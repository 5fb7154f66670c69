#include "server/apps/log.h"

#include <fmt/chrono.h>
#include <spdlog/formatter.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

namespace rustle::apps {
namespace {

thread_local std::string_view about_session;

/// Logging is synchronous: formatting runs on the thread that logs, within its AboutSession.
class JsonLines final : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& out) override {
    using std::chrono::milliseconds;
    const auto since_epoch = std::chrono::duration_cast<milliseconds>(message.time.time_since_epoch());
    const auto level = spdlog::level::to_string_view(message.level);
    nlohmann::ordered_json line;
    line["time"] =
        fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", fmt::gmtime(static_cast<std::time_t>(since_epoch.count() / 1000)),
                    since_epoch.count() % 1000);
    line["level"] = std::string_view(level.data(), level.size());
    if (!about_session.empty()) line["session"] = about_session;
    line["message"] = std::string_view(message.payload.data(), message.payload.size());
    const std::string text = line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
    out.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override { return std::make_unique<JsonLines>(); }
};

}  // namespace

void log_to_stderr(const std::string& level, bool as_json) {
  auto logger = spdlog::stderr_color_mt("rustled");
  if (as_json) logger->set_formatter(std::make_unique<JsonLines>());
  spdlog::set_default_logger(std::move(logger));
  spdlog::set_level(spdlog::level::from_str(level));
}

AboutSession::AboutSession(std::string_view session) noexcept : before_(std::exchange(about_session, session)) {}

AboutSession::~AboutSession() {
  about_session = before_;
}

}  // namespace rustle::apps
