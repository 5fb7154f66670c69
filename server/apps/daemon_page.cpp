#include "server/apps/daemon_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "client_sdk/cpp/certificate.h"

namespace rustle::apps {
namespace {

std::string sentence_of(const wire::Error& error) {
  return error.remedy.empty() ? error.message : error.message + " " + error.remedy;
}

tl::unexpected<std::string> no_session(const std::string& id) {
  return tl::unexpected(fmt::format("There is no session \"{}\".", id));
}

}  // namespace

void Daemon::show_on(page::Page& page, page::Host& host) {
  page_ = &page;
  page_host_ = &host;
}

void Daemon::serve_page() {
  if (page_ != nullptr) page_->serve(*page_host_);
}

void Daemon::show(Guest& heard, const session::AudioBlock& block) {
  if (page_ == nullptr || !page_->is_looked_at()) return;
  for (const float sample : block.interleaved) {
    heard.level.peak = std::max(heard.level.peak, std::abs(sample));
    heard.level.squares += static_cast<double>(sample) * sample;
  }
  heard.level.samples += block.interleaved.size();
  page_->hear(heard.session->id(), heard.session->options().rate_hz, block);
}

std::optional<wire::Error> Daemon::move_listener(Guest& asked, const sheet::Vec3d& position_m) {
  const engine::ListenerMove move{position_m};
  if (auto wrong = hand_over(asked, move)) return wrong;
  asked.listener = move;
  return std::nullopt;
}

page::SessionFigures DaemonPage::figures_of(Daemon::Guest& guest) const {
  const auto counters = guest.session->counters();
  const auto& options = guest.session->options();
  page::SessionFigures out;
  out.id = guest.session->id();
  out.name = guest.name;
  out.live = options.clock == session::Clock::kLive;
  out.ended = guest.finished;
  out.rate_hz = options.rate_hz;
  out.channels = session::channel_count(options.channels);
  out.sheets = guest.decoder.sheet_count();
  out.voices = counters.render.voices;
  out.frames_received = counters.frames_received;
  out.frames_analysed = counters.frames_analysed;
  out.frames_dropped = counters.frames_dropped;
  out.playout_delay_s = counters.playout_delay_s;
  out.level = std::exchange(guest.level, {});
  out.gains = guest.gains;
  return out;
}

page::Figures DaemonPage::figures(const std::vector<std::string>& users) {
  page::Figures out;
  out.up_s = std::chrono::duration<double>(daemon_.clock_->now() - daemon_.began_).count();
  out.load_level = daemon_.ladder_.level();
  out.pcm_gaps = daemon_.departed_.statistics.pcm_gaps;
  for (auto& [id, guest] : daemon_.guests_) {
    out.pcm_gaps += guest->pcm.gaps();
    out.sound += guest->session->stage_times().sound.counts();
    out.sessions.push_back(figures_of(*guest));
    for (const auto& user : users) out.rights[user].push_back(rights(user, *guest));
  }
  for (const auto& user : users) out.rights[user];  // also where there is no session
  return out;
}

page::Rights DaemonPage::rights(const std::string& user) {
  if (!daemon_.options_.gate) return {true, true};
  const auto key = daemon_.key_of(user);
  if (!key) return {};
  return {key->permissions.may_listen() || key->permissions.publish, key->permissions.may_publish()};
}

page::Rights DaemonPage::rights(const std::string& user, const Daemon::Guest& guest) const {
  if (!daemon_.options_.gate) return {true, true};
  const auto key = daemon_.key_of(user);
  if (!key) return {};
  return {daemon_.may_see(user, guest), key->permissions.admin || guest.owner == user};
}

tl::expected<std::string, std::string> DaemonPage::user_of(const std::string& secret) {
  if (!daemon_.options_.gate) return tl::unexpected(std::string("This daemon asks nobody for a key."));
  auto user = client::public_key_of(secret);
  if (!user) return tl::unexpected(std::move(user.error().message));
  if (!daemon_.key_of(*user))
    return tl::unexpected(
        std::string("This key is not allowed here; have the operator take it in with `rustle keys allow`."));
  return std::move(*user);
}

page::Host::Done DaemonPage::watch(const std::string& session, std::shared_ptr<session::Watch> watch) {
  Daemon::Guest* guest = daemon_.guest(session);
  if (guest == nullptr) return no_session(session);
  guest->session->watch(std::move(watch));
  daemon_.scheduler_->wake_analysis(guest->session);
  return {};
}

page::Host::Done DaemonPage::may_listen(const std::string& user, const std::string& session) {
  const Daemon::Guest* guest = daemon_.guest(session);
  if (guest == nullptr) return no_session(session);
  if (rights(user, *guest).listen) return {};
  return tl::unexpected(
      std::string("Listening needs a key with the permission listen, or one that the session belongs to."));
}

page::Host::Done DaemonPage::ask(const std::string& user, const wire::ControlRequest& request) {
  const Daemon::Guest* guest = daemon_.guest(request.session_id);
  if (guest == nullptr) return no_session(request.session_id);
  if (!rights(user, *guest).change)
    return tl::unexpected(
        std::string("Changing a session needs the key that it belongs to, or one with the permission admin."));
  const auto reply = daemon_.answer_if_it_fits(request, user);
  if (const auto* error = std::get_if<wire::Error>(&reply)) return tl::unexpected(sentence_of(*error));
  return {};
}

page::Host::Done DaemonPage::set_gain(const std::string& user, const std::string& session, const synthesis::Gain& gain) {
  return ask(user, {0, session, wire::SetGainsRequest{{gain}}});
}

page::Host::Done DaemonPage::move_listener(const std::string& user, const std::string& session,
                                           const sheet::Vec3d& position_m) {
  // Whoever may change gains may move the listener: asked with no gain to change.
  if (auto allowed = ask(user, {0, session, wire::SetGainsRequest{}}); !allowed) return allowed;
  if (const auto wrong = daemon_.move_listener(*daemon_.guest(session), position_m))
    return tl::unexpected(sentence_of(*wrong));
  return {};
}

}  // namespace rustle::apps
