#include "server/page/page.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/ip/host_name.hpp>
#include <set>
#include <utility>

namespace rustle::page {
namespace {

constexpr std::chrono::milliseconds kFiguresEvery{250};
constexpr std::size_t kSoundFrames = 1024;  // of a message

std::string machine_name() {
  boost::system::error_code none;
  return boost::asio::ip::host_name(none);
}

}  // namespace

/// A viewer's connection. [HTTP thread]
class Page::Viewer : public monitor::WebSocketEnd {
 public:
  Viewer(Page& page, ViewerId id) : page_(page), id_(id) { page_.viewers_there_.fetch_add(1, std::memory_order_relaxed); }
  ~Viewer() override { page_.viewers_there_.fetch_sub(1, std::memory_order_relaxed); }

  void opened(Line line) override {
    outlet_->connect(std::move(line));
    page_.ask({id_, Came{outlet_}});
    came_ = true;
  }

  std::optional<monitor::WebSocketMessage> next() override { return outlet_->box.next(); }

  void heard(std::string_view text, bool binary) override {
    auto request = binary ? tl::unexpected(std::string("Messages to the daemon are texts.")) : parse_request(text);
    if (!request) return outlet_->say(notice_text(request.error(), NoticeLevel::kError));
    if (outlet_->asked.load(std::memory_order_relaxed) >= kMostAsked)
      return outlet_->say(notice_text("Too much is asked at once; this was left out.", NoticeLevel::kError));
    outlet_->asked.fetch_add(1, std::memory_order_relaxed);
    page_.ask({id_, std::move(*request)});
  }

  void left() override {
    outlet_->connect({});
    const auto lost = outlet_->box.lost();
    page_.messages_lost_.fetch_add(lost.pictures + lost.events + lost.pcm, std::memory_order_relaxed);
    if (came_) page_.ask({id_, Gone{}});
  }

 private:
  Page& page_;
  const ViewerId id_;
  const std::shared_ptr<Outlet> outlet_ = std::make_shared<Outlet>();
  bool came_ = false;
};

Page::Page(Options options, std::function<void()> wake)
    : options_(std::move(options)), wake_(std::move(wake)), machine_(machine_name()), files_(options_.folder) {}

Page::~Page() = default;

void Page::add_to(monitor::HttpServer::Paths& paths) {
  paths.sockets["/live"] = {kSubprotocol, kRequestBytes, [this] { return admit(); }};
  paths.files = [this](const monitor::HttpRequest& request) { return files_.answer(request); };
}

tl::expected<std::shared_ptr<monitor::WebSocketEnd>, monitor::HttpResponse> Page::admit() {
  if (viewers_there_.load(std::memory_order_relaxed) < options_.viewers)
    return std::make_shared<Viewer>(*this, next_viewer_++);
  viewers_refused_.fetch_add(1, std::memory_order_relaxed);
  return tl::unexpected(monitor::HttpResponse{
      503, "text/plain; charset=utf-8",
      fmt::format("{} look at this daemon's page already, as many as may; close one, or raise --max-viewers.\n",
                  options_.viewers)});
}

void Page::ask(Asked asked) {
  {
    const std::lock_guard lock(asked_mutex_);
    asks_.push_back(std::move(asked));
  }
  asked_.store(true, std::memory_order_release);
  wake_();
}

// ----------------------------------------------------------------------------------------------------- network thread

void Page::serve(Host& host) {
  if (asked_.load(std::memory_order_relaxed) && asked_.exchange(false, std::memory_order_acquire)) {
    std::vector<Asked> asks;
    {
      const std::lock_guard lock(asked_mutex_);
      asks.swap(asks_);
    }
    for (auto& asked : asks) answer(host, asked);
  }
  if (!known_.empty()) tell_figures(host);
}

void Page::answer(Host& host, Asked& asked) {
  if (auto* came = std::get_if<Came>(&asked.what)) {
    Known& known = known_[asked.viewer];
    known.outlet = came->outlet;
    painter_.post(Painter::Came{asked.viewer, std::move(came->outlet)});
    say_hello(host, known);
    figures_due_ = {};
    return;
  }
  const auto found = known_.find(asked.viewer);
  if (found == known_.end()) return;
  Known& known = found->second;
  if (std::holds_alternative<Gone>(asked.what)) {
    Known left = std::move(known);
    known_.erase(found);
    stop_watching(host, left);
    stop_listening(left);
    painter_.post(Painter::Gone{asked.viewer});
    return;
  }
  known.outlet->asked.fetch_sub(1, std::memory_order_relaxed);
  const auto done = std::visit([&](const auto& request) { return carry_out(host, asked.viewer, known, request); },
                               std::get<Request>(asked.what));
  if (!done) known.outlet->say(notice_text(done.error(), NoticeLevel::kError));
}

Host::Done Page::carry_out(Host& host, ViewerId id, Known& known, const WatchRequest& request) {
  const std::string wanted = request.session.value_or("");
  if (wanted != known.watched) stop_watching(host, known);
  if (wanted.empty()) {
    painter_.post(Painter::Watches{id, {}, nullptr});
    return {};
  }
  auto& watch = watched_[wanted];
  if (!watch) {
    auto made = std::make_shared<session::Watch>();
    if (auto done = host.watch(wanted, made); !done) {
      watched_.erase(wanted);
      painter_.post(Painter::Watches{id, {}, nullptr});
      return done;
    }
    watch = std::move(made);
  }
  known.watched = wanted;
  painter_.post(Painter::Watches{id, wanted, watch, request.frames_per_second});
  return {};
}

Host::Done Page::carry_out(Host& host, ViewerId id, Known& known, const ListenRequest& request) {
  const std::string wanted = request.session.value_or("");
  if (!wanted.empty()) {
    if (auto allowed = host.may_listen(known.user, wanted); !allowed) return allowed;
  }
  if (wanted != known.heard) stop_listening(known);
  known.heard = wanted;
  if (!wanted.empty()) heard_.try_emplace(wanted);
  painter_.post(Painter::Listens{id, wanted});
  return {};
}

Host::Done Page::carry_out(Host& host, ViewerId, Known& known, const GainRequest& request) {
  figures_due_ = {};
  return host.set_gain(known.user, request.session, request.gain);
}

Host::Done Page::carry_out(Host& host, ViewerId, Known& known, const ListenerRequest& request) {
  return host.move_listener(known.user, request.session, request.position_m);
}

Host::Done Page::carry_out(Host& host, ViewerId id, Known& known, const KeyRequest& request) {
  auto user = host.user_of(request.secret);
  if (!user) return tl::unexpected(std::move(user.error()));
  known.user = std::move(*user);
  if (!known.heard.empty() && !host.may_listen(known.user, known.heard)) {
    stop_listening(known);
    painter_.post(Painter::Listens{id, {}});
  }
  say_hello(host, known);
  figures_due_ = {};
  return {};
}

void Page::say_hello(Host& host, const Known& known) const {
  const Rights rights = host.rights(known.user);
  const bool needs_key = host.asks_for_keys() && !(rights.listen && rights.change);
  known.outlet->say(hello_text({options_.daemon, machine_, options_.rate_hz, options_.channels, rights, needs_key}));
}

void Page::stop_watching(Host& host, Known& known) {
  const std::string session = std::exchange(known.watched, {});
  if (session.empty()) return;
  const bool others =
      std::any_of(known_.begin(), known_.end(), [&](const auto& entry) { return entry.second.watched == session; });
  if (others) return;
  static_cast<void>(host.watch(session, nullptr));  // it may have gone
  const auto over = watched_.extract(session);
  if (!over.empty()) frames_taken_ += over.mapped()->frames_taken();
}

void Page::stop_listening(Known& known) {
  const std::string session = std::exchange(known.heard, {});
  const bool others =
      std::any_of(known_.begin(), known_.end(), [&](const auto& entry) { return entry.second.heard == session; });
  if (!others) heard_.erase(session);
}

void Page::hear(const std::string& session, std::uint32_t rate_hz, const session::AudioBlock& block) {
  const auto found = heard_.find(session);
  if (found == heard_.end()) return;
  Heard& heard = found->second;
  if (heard.waiting.empty()) heard.first_sample = block.first_sample;
  heard.waiting.insert(heard.waiting.end(), block.interleaved.begin(), block.interleaved.end());
  const auto channels = static_cast<std::size_t>(block.channels);
  if (heard.waiting.empty() || (heard.waiting.size() < kSoundFrames * channels && !block.last)) return;
  painter_.post(Painter::Sound{session, heard.first_sample, rate_hz, block.channels, std::exchange(heard.waiting, {})});
}

void Page::session_left(const std::string& session) {
  const auto over = watched_.extract(session);
  if (!over.empty()) frames_taken_ += over.mapped()->frames_taken();
  heard_.erase(session);
  for (auto& [id, known] : known_) {
    if (known.watched != session && known.heard != session) continue;
    if (known.watched == session) painter_.post(Painter::Watches{id, {}, nullptr});
    if (known.heard == session) painter_.post(Painter::Listens{id, {}});
    if (known.watched == session) known.watched.clear();
    if (known.heard == session) known.heard.clear();
    known.outlet->say(notice_text(fmt::format("The session \"{}\" has ended.", session), NoticeLevel::kInfo));
  }
}

void Page::check_rights(Host& host) {
  for (auto& [id, known] : known_) {
    if (!known.heard.empty() && !host.may_listen(known.user, known.heard)) {
      stop_listening(known);
      painter_.post(Painter::Listens{id, {}});
    }
    say_hello(host, known);
  }
}

void Page::tell_figures(Host& host) {
  const auto now = std::chrono::steady_clock::now();
  if (now < figures_due_) return;
  figures_due_ = now + kFiguresEvery;
  std::set<std::string> users;
  Painter::Told told;
  for (const auto& [id, known] : known_) {
    users.insert(known.user);
    told.users[id] = known.user;
  }
  told.figures = std::make_shared<const Figures>(host.figures({users.begin(), users.end()}));
  painter_.post(std::move(told));
}

monitor::PageFigures Page::figures() const {
  monitor::PageFigures out{viewers_there_.load(std::memory_order_relaxed), viewers_refused_.load(std::memory_order_relaxed),
                           frames_taken_, messages_lost_.load(std::memory_order_relaxed)};
  for (const auto& [session, watch] : watched_) out.frames_taken += watch->frames_taken();
  return out;
}

}  // namespace rustle::page
