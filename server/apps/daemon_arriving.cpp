#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <new>
#include <utility>

#include "server/apps/daemon.h"
#include "server/apps/log.h"
#include "server/engine/economy.h"
#include "server/session/settled_options.h"

/// How sessions come to a daemon: attached by their client, or announced by a publisher.
namespace rustle::apps {
namespace {

constexpr int kMostBlocks = 4;          // rendered at once
constexpr std::size_t kNameBytes = 64;  // of a session id that is made from its client's name

/// At most so many bytes of a UTF-8 text, whole characters.
std::string begin_of(const std::string& text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  while (bytes > 0 && (static_cast<unsigned char>(text[bytes]) & 0xc0) == 0x80) --bytes;
  return text.substr(0, bytes);
}

}  // namespace

wire::ControlReply Daemon::attach(const wire::ControlRequest& request, const wire::AttachRequest& body,
                                  const std::string& user) {
  if (draining_) return ending();
  std::string id = request.session_id;
  if (id.empty()) {
    const std::string name = begin_of(body.name, kNameBytes);
    const std::string stem = wire::valid_session_id(name) ? name : "session";
    id = stem;
    while (guests_.contains(id)) id = fmt::format("{}-{}", stem, ++next_name_);
  } else if (guests_.contains(id)) {
    return wire::Error{wire::ErrorCode::kSessionExists,
                       "session_id",
                       fmt::format("There already is a session \"{}\".", id),
                       "Detach it, choose another id, or leave the id empty to be given one.",
                       0,
                       std::nullopt,
                       {}};
  } else if (!wire::valid_session_id(id)) {
    return wire::Error{wire::ErrorCode::kMalformed,
                       "session_id",
                       "This is no session id.",
                       "Use 1 to 128 characters without slashes and control characters.",
                       0,
                       std::nullopt,
                       {}};
  }
  if (guests_.size() >= max_sessions_) return too_many_sessions();
  if (auto beyond = check_session_quota(user)) return *beyond;
  if (ladder_.level() == engine::kMostLoadLevel) return overloaded();
  if (auto wrong = check_material(body.options.default_material, {}, "attach.options.default_material")) return *wrong;
  for (std::size_t k = 0; k < body.sheets.size(); ++k) {
    const auto& sheet = body.sheets[k];
    if (sheet.material.empty()) continue;
    if (auto wrong = check_material(sheet.material, sheet.touched_surface, fmt::format("attach.sheets[{}].material", k)))
      return *wrong;
  }
  session::SessionOptions options = body.options;
  if (options.rate_hz == 0) options.rate_hz = options_.rate_hz;
  if (options.block_size == 0) options.block_size = options_.block_size;
  auto head = heads_.head_for(options);
  if (!head) return head.error();
  if (*head && options.hrtf.empty()) options.hrtf = heads_.default_name();
  options.record |= options_.record_all;
  apply_quotas(options, user);
  Recorder::NewFile file;
  if (options.record) {
    auto made = new_recording(id, {});
    if (!made) return made.error();
    file = std::move(*made);
  }
  try {
    admit(id, body.name, options, *head, true, user);
    return furnish(id, body, std::move(file));
  } catch (const std::bad_alloc&) {
    dismiss(id);
    throw;
  }
}

wire::ControlReply Daemon::furnish(const std::string& id, const wire::AttachRequest& body, Recorder::NewFile file) {
  Guest& admitted = *guest(id);
  const session::SessionOptions& options = admitted.session->options();
  wire::Attached attached{id, options, std::nullopt, file.name};
  if (options.record) recorder_->begin(std::move(file), admitted.session, admitted.name, nullptr, 1);
  for (const auto& sheet : body.sheets) {
    if (auto added = admitted.decoder.add_sheet(sheet); !added) {
      dismiss(id);
      return added.error();
    }
    take_attached(admitted, sheet);
  }
  scheduler_->wake_analysis(admitted.session);
  if (options.clock == session::Clock::kSimulation) attached.credit = wire::FlowCredit{0, kWindowMessages, kWindowBytes};
  return attached;
}

void Daemon::dismiss(const std::string& id) {
  const auto found = guests_.find(id);
  if (found == guests_.end()) return;
  if (recorder_) recorder_->finish(*found->second->session);
  scheduler_->remove(found->second->session);
  guests_.erase(found);
}

wire::Error Daemon::too_many_sessions() const {
  return {wire::ErrorCode::kQuotaExceeded,
          "sessions",
          "The daemon carries as many sessions as it may.",
          "Detach a session, or start rustled with a higher --max-sessions.",
          0,
          wire::Quota{"sessions", static_cast<double>(max_sessions_), static_cast<double>(guests_.size() + 1)},
          {}};
}

std::optional<wire::Error> Daemon::check_material(const std::string& material, const std::string& surface,
                                                  std::string field) const {
  auto found = packs_->find(material.empty() ? "printer-paper" : material, surface);
  if (found) return std::nullopt;
  return wire::Error{
      wire::ErrorCode::kUnknownMaterial, std::move(field), found.error().message, found.error().remedy, 0, std::nullopt, {}};
}

Daemon::Guest& Daemon::admit(const std::string& id, std::string name, session::SessionOptions options,
                             const std::shared_ptr<const spatial::Hrtf>& head, bool attached, const std::string& owner) {
  const AboutSession about(id);
  options = session::settled(std::move(options));
  auto session = std::make_shared<session::Session>(id, options, packs_, *clock_, head);
  // A device takes sound block by block.
  auto made =
      std::make_unique<Guest>(session, std::move(name), attached, options_.budget, *sockets_, playback_ ? 1 : kMostBlocks);
  auto& place = guests_[id] = std::move(made);
  scheduler_->add(std::move(session));
  place->owner = owner;
  place->last_heard = clock_->now();
  sockets_->cut_listeners();  // who heard an earlier session of this name may not hear this one
  apply_load_level(*place);
  if (recorder_) place->standing.emplace();
  for (const auto& topic : sockets_->subscriptions()) {
    wire::SubscriptionChanged known{topic, true};
    handle(known);
  }
  spdlog::info("session {} {}{}: {} clock, {} Hz, {} channels", id, attached ? "attached" : "announced itself",
               owner.empty() ? "" : " by " + name_of(owner), options.clock == session::Clock::kLive ? "live" : "simulation",
               options.rate_hz, session::channel_count(options.channels));
  return *place;
}

}  // namespace rustle::apps
