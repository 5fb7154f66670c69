#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "server/apps/daemon.h"
#include "server/apps/wording.h"
#include "server/page/page.h"

/// Who may do what: permissions and quotas of keys. Without a gate everybody may do everything.
namespace rustle::apps {
namespace {

constexpr std::uint64_t kMostVoices = 512;

wire::Error denied(std::string field, std::string message, std::string permission) {
  std::string remedy = permission == "owner" ? "Use a session of this key's own, or a key with the permission admin."
                                             : fmt::format("Have the operator give the key the permission {}.", permission);
  if (permission == "owner") permission = "admin";
  return {wire::ErrorCode::kPermissionDenied,
          std::move(field),
          std::move(message),
          std::move(remedy),
          0,
          std::nullopt,
          std::move(permission)};
}

wire::Error quota_exceeded(const char* quota, std::string field, std::uint64_t limit, double asked, std::string what) {
  return {wire::ErrorCode::kQuotaExceeded,
          std::move(field),
          fmt::format("This key may have {} {}.", limit, what),
          "Send less, or have the operator raise the key's quota.",
          0,
          wire::Quota{quota, static_cast<double>(limit), asked},
          {}};
}

}  // namespace

std::optional<access::AllowedKey> Daemon::key_of(const std::string& user) const {
  return options_.gate ? options_.gate->find(user) : std::nullopt;
}

std::string Daemon::name_of(const std::string& user) const {
  const auto key = key_of(user);
  return key ? key->name : "a key that is not allowed";
}

bool Daemon::may_see(const std::string& user, const Guest& guest) const {
  if (!options_.gate || guest.owner == user) return true;
  const auto key = key_of(user);
  return key && key->permissions.may_listen();
}

bool Daemon::may_hear(const std::string& user, std::string_view topic) const {
  const auto key = key_of(user);
  if (!key) return false;
  if (key->permissions.may_listen()) return true;
  // Its own sessions, or one that is not there: when that comes and is another's, the listener is cut off.
  const std::string_view session = wire::session_of_topic(topic);
  if (session.empty() || session.size() == topic.size()) return false;  // a prefix of many sessions' topics
  const auto heard = guests_.find(std::string(session));
  return heard == guests_.end() || heard->second->owner == user;
}

std::optional<wire::Error> Daemon::check_permission(const wire::ControlRequest& request, const std::string& user) const {
  if (!options_.gate) return std::nullopt;
  const auto key = key_of(user);
  const access::Permissions may = key ? key->permissions : access::Permissions{};
  const auto asks = [&request]<class Request>() { return std::holds_alternative<Request>(request.body); };
  if (may.admin || asks.operator()<wire::HelloRequest>() || asks.operator()<wire::ListPacksRequest>() ||
      asks.operator()<wire::ListSessionsRequest>())
    return std::nullopt;
  if (asks.operator()<wire::AttachRequest>())
    return may.publish ? std::nullopt : std::optional(denied("attach", "This key may not publish.", "publish"));
  if (asks.operator()<wire::ReloadPackRequest>())
    return denied("reload_pack", "This key may not have packs read anew.", "admin");
  const bool reads = asks.operator()<wire::GetStatisticsRequest>();
  if (reads && may.listen) return std::nullopt;
  if (reads && request.session_id.empty())
    return denied("get_statistics", "This key may not see the daemon's own figures.", "listen");
  const auto asked = guests_.find(request.session_id);
  if (asked != guests_.end() ? asked->second->owner == user : reads) return std::nullopt;
  return denied("session_id", fmt::format("The session \"{}\" is not this key's.", request.session_id), "owner");
}

std::optional<wire::Error> Daemon::check_sender(const std::string& session_id, const std::string& user) const {
  if (!options_.gate) return std::nullopt;
  const auto key = key_of(user);
  if (!key || !key->permissions.may_publish())
    return denied("stream", fmt::format("{} may not publish.", name_of(user)), "publish");
  const auto owned = guests_.find(session_id);
  if (owned == guests_.end() || owned->second->owner == user) return std::nullopt;
  return denied("session_id", fmt::format("The session \"{}\" is not {}'s.", session_id, key->name), "owner");
}

std::optional<wire::Error> Daemon::check_session_quota(const std::string& user) const {
  const auto key = key_of(user);
  if (!key || key->quotas.sessions == 0) return std::nullopt;
  const auto held = static_cast<std::uint64_t>(
      std::count_if(guests_.begin(), guests_.end(), [&](const auto& entry) { return entry.second->owner == user; }));
  if (held < key->quotas.sessions) return std::nullopt;
  return quota_exceeded("sessions", "sessions", key->quotas.sessions, static_cast<double>(held + 1), "sessions at a time");
}

void Daemon::apply_quotas(session::SessionOptions& options, const std::string& user) const {
  const auto key = key_of(user);
  if (!key || key->quotas.voices == 0 || key->quotas.voices >= kMostVoices) return;
  const auto most = static_cast<std::uint32_t>(key->quotas.voices);
  options.most_voices = options.most_voices == 0 ? most : std::min(options.most_voices, most);
}

bool Daemon::within_quotas(Guest& sender, const wire::StreamEnvelope& envelope, std::size_t bytes) {
  const auto key = key_of(sender.owner);
  if (!key) return true;
  const access::Quotas& quotas = key->quotas;
  const bool is_frame = envelope.body() == wire::StreamEnvelope::Body::kFrame;
  if (quotas.triangles != 0 && is_frame) {
    std::size_t used = sender.decoder.triangles_in_use_with(envelope);
    for (const auto& [id, other] : guests_)
      if (other->owner == sender.owner && other.get() != &sender) used += other->decoder.triangles_in_use();
    if (used > quotas.triangles) {
      notify(sender, quota_exceeded("triangles", "frame.topology_id", quotas.triangles, static_cast<double>(used),
                                    "triangles in use, of all its sessions"));
      return false;
    }
  }
  if (quotas.bytes_per_s == 0 && quotas.frames_per_s == 0) return true;
  constexpr double kNoLimit = 1e15;
  const auto per_s = [](std::uint64_t quota) { return quota == 0 ? kNoLimit : static_cast<double>(quota); };
  auto& spent = spending_
                    .try_emplace(sender.owner, Spending{session::Allowance(per_s(quotas.bytes_per_s)),
                                                        session::Allowance(per_s(quotas.frames_per_s))})
                    .first->second;
  const auto now = clock_->now();
  const bool bytes_left = spent.bytes.left(now), frames_left = spent.frames.left(now);
  const bool waits = sender.session->options().clock == session::Clock::kSimulation;
  if (waits || (bytes_left && (frames_left || !is_frame))) {
    spent.bytes.use(static_cast<double>(bytes));
    if (is_frame) spent.frames.use(1);
    return true;
  }
  notify(sender,
         bytes_left
             ? quota_exceeded("frames_per_s", "stream", quotas.frames_per_s, 0, "frames a second; others are dropped")
             : quota_exceeded("bytes_per_s", "stream", quotas.bytes_per_s, 0, "bytes a second; what is more is dropped"));
  return false;
}

bool Daemon::rate_left(const Guest& sender) {
  const auto spent = spending_.find(sender.owner);
  if (spent == spending_.end()) return true;
  const auto now = clock_->now();
  // Both are asked: what comes back does so by the time since it was asked last.
  const bool bytes = spent->second.bytes.left(now), frames = spent->second.frames.left(now);
  return bytes && frames;
}

tl::expected<void, std::string> Daemon::reload_keys() {
  if (!options_.gate) return {};
  if (auto read = options_.gate->reload(); !read) return read;
  spending_.clear();
  for (auto& [id, guest] : guests_) {
    const auto key = key_of(guest->owner);
    if (guest->detached || (key && key->permissions.may_publish())) continue;
    notify(*guest, denied("session_id", fmt::format("The session \"{}\" has ended: its key may not publish any more.", id),
                          "publish"));
    end_at_once(*guest);
  }
  sockets_->cut_listeners();
  if (page_ != nullptr) page_->check_rights(*page_host_);
  return {};
}

}  // namespace rustle::apps
