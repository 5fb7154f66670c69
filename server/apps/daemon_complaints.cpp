#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <chrono>

#include "server/apps/daemon.h"

namespace rustle::apps {
namespace {

// Of what belongs to no session: anyone can send it, and logs are finite.
constexpr std::chrono::milliseconds kComplaintInterval{1000};

}  // namespace

void Daemon::complain(std::string_view what, const wire::Error& error) {
  ++complaints_.unsent;
  const auto now = clock_->now();
  if (complaints_.last_sent && now - *complaints_.last_sent < kComplaintInterval) return;
  spdlog::warn("{} refused: {}{}", what, wire::to_string(error),
               complaints_.unsent > 1 ? fmt::format(" ({} since the last such line)", complaints_.unsent) : "");
  complaints_ = {now, 0};
}

void Daemon::tell_of_sockets() {
  const auto counters = sockets_->counters();
  const auto tell = [this](std::uint64_t count, std::uint64_t& told, const char* what, const char* remedy) {
    if (count == told) return;
    told = count;
    complain("transport",
             {wire::ErrorCode::kMalformed, "", fmt::format("{} so far: {}.", what, count), remedy, 0, std::nullopt, {}});
  };
  tell(counters.malformed_messages, told_.malformed_messages, "Messages with too many or too few parts",
       "Send [topic, StreamMessage] on the stream, one ControlRequest at a time on the control socket.");
  tell(counters.refused_connections, told_.refused_connections, "Connections whose key is not admitted",
       "Take the key in with `rustle keys allow`, then reload rustled (SIGHUP).");
  tell(counters.revoked_messages, told_.revoked_messages, "Messages of connections whose key was revoked",
       "End the client that still has it.");
  tell(counters.refused_subscriptions, told_.refused_subscriptions, "Subscriptions to what the key may not hear",
       "Give the key the permission to listen, or have it listen to its own sessions.");
  tell(counters.unsent_replies, told_.unsent_replies, "Replies whose asker was gone or did not read",
       "Keep the control socket open until its answer has come.");
}

}  // namespace rustle::apps
