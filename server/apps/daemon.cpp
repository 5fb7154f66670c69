#include "server/apps/daemon.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <new>
#include <utility>

#include "server/apps/log.h"
#include "server/apps/wording.h"
#include "server/engine/economy.h"

namespace rustle::apps {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kAnnouncementGrace{1200};  // publishers announce themselves every second
constexpr milliseconds kNoticeInterval{500};
constexpr milliseconds kCreditInterval{500};  // repeated, for a listener that was away when it was sent
constexpr milliseconds kServeAll{20};         // whoever has nothing new
constexpr int kBlocksAtATime = 256;
constexpr double kRestart_s = 0.5;  // a publisher whose time goes back by more has started again

wire::ErrorCode code_of(engine::Refusal::Cause cause) {
  switch (cause) {
    case engine::Refusal::Cause::kUnknownSheet:
      return wire::ErrorCode::kUnknownSheet;
    case engine::Refusal::Cause::kUnknownMaterial:
      return wire::ErrorCode::kUnknownMaterial;
    case engine::Refusal::Cause::kTimeOrder:
      return wire::ErrorCode::kTimeOrder;
    case engine::Refusal::Cause::kTooMany:
      return wire::ErrorCode::kTooLarge;
    case engine::Refusal::Cause::kFailed:
      return wire::ErrorCode::kOverloaded;
    case engine::Refusal::Cause::kScene:
      break;
  }
  return wire::ErrorCode::kUnknownObstacle;
}

wire::Error unknown_session(const std::string& id) {
  return {wire::ErrorCode::kUnknownSession,
          "session_id",
          fmt::format("There is no session \"{}\".", id),
          "Attach first; a session ends when its client detaches.",
          0,
          std::nullopt,
          {}};
}

wire::Error unidentified(sheet::SheetId sheet) {
  return {wire::ErrorCode::kUnidentified,
          "material_coordinates",
          fmt::format("Sheet {} has a new mesh at every frame and no material coordinates: events that show in the mesh are "
                      "not heard, only what its bending feeds.",
                      sheet),
          "Send material_coordinates with every topology.",
          0,
          std::nullopt,
          {}};
}

wire::Error out_of_memory() {
  return {wire::ErrorCode::kOverloaded,
          "request",
          "The daemon has no memory for that.",
          "Try again later, or with less.",
          0,
          std::nullopt,
          {}};
}

/// Does one thing of many: where memory runs out, that one is left, and the others go on.
template <typename Thing>
void do_if_it_fits(Thing&& thing) {
  try {
    thing();
  } catch (const std::bad_alloc&) {
    spdlog::error("out of memory: something that was asked for has been left undone");
  }
}

wire::Error unsupported(std::string message, std::string remedy) {
  return {wire::ErrorCode::kUnsupported, "request", std::move(message), std::move(remedy), 0, std::nullopt, {}};
}

}  // namespace

Daemon::Daemon(DaemonOptions options, std::shared_ptr<pack::PackLibrary> packs,
               std::shared_ptr<const session::WallClock> clock)
    : options_(std::move(options)),
      max_sessions_(options_.max_sessions),
      packs_(std::move(packs)),
      clock_(std::move(clock)),
      strangers_({.publishers = options_.max_sessions}),
      began_(clock_->now()) {}

Daemon::~Daemon() = default;

tl::expected<std::unique_ptr<Daemon>, std::string> Daemon::open(DaemonOptions options,
                                                                std::shared_ptr<pack::PackLibrary> packs,
                                                                std::shared_ptr<const session::WallClock> clock) {
  std::unique_ptr<Daemon> daemon(new Daemon(std::move(options), std::move(packs), std::move(clock)));
  auto sockets_options = daemon->options_.sockets;
  const auto& gate = daemon->options_.gate;
  if (gate) {
    sockets_options.security = {
        .public_key = gate->own().public_key,
        .secret_key = gate->own().secret_key,
        .admits = [gate](const std::string& user) { return gate->admits(user); },
        .may_hear = [it = daemon.get()](const std::string& user,
                                        std::string_view topic) { return it->may_hear(user, topic); }};
  }
  for (const std::string& named : daemon->options_.connect) {
    const std::size_t mark = gate ? named.find('#') : std::string::npos;
    wire::Publisher publisher{named.substr(0, mark), {}};
    if (mark != std::string::npos) {
      const auto key = gate->named(named.substr(mark + 1));
      if (!key || !key->permissions.may_publish())
        return tl::unexpected(
            fmt::format("--connect {}: no key of this name may publish; `rustle keys allow` takes it in.", named));
      publisher.public_key = key->public_key;
    }
    sockets_options.connect.push_back(std::move(publisher));
  }
  auto sockets = wire::Sockets::open(sockets_options);
  if (!sockets) return tl::unexpected(sockets.error());
  daemon->sockets_ = std::move(*sockets);
  // Loaded before anyone waits for them: the network thread reads no file.
  for (const auto& entry : daemon->packs_->entries()) {
    auto pack = daemon->packs_->load(entry.material, entry.touched_surface, daemon->options_.rate_hz);
    if (pack) daemon->held_packs_.emplace(entry.folder, std::move(*pack));
  }
  auto heads = Heads::open(daemon->options_.hrtfs, daemon->options_.rate_hz);
  if (!heads) return tl::unexpected(heads.error());
  daemon->heads_ = std::move(*heads);
  if (daemon->options_.playback) {
    daemon->playback_ = std::make_unique<sinks::Playback>(*daemon->options_.playback,
                                                          [](const std::string& what) { spdlog::info("{}", what); });
  }
  daemon->reloads_ = std::make_unique<PackReloads>(daemon->packs_, daemon->options_.rate_hz,
                                                   [sockets = daemon->sockets_.get()] { sockets->wake(); });
  const auto& wanted = daemon->options_;
  daemon->scheduler_ = std::make_unique<session::Scheduler>(
      session::Scheduler::Options{wanted.analysis_workers, wanted.render_workers, wanted.analysis_cpus, wanted.render_cpus},
      *daemon->clock_, [sockets = daemon->sockets_.get()] { sockets->wake(); });
  if (!daemon->scheduler_->pinned())
    return tl::unexpected(std::string(
        "sessions.analysis_affinity, sessions.render_affinity: name only processors that this machine has for us; "
        "`nproc` says how many there are."));
  if (wanted.record_all && wanted.recordings.empty())
    return tl::unexpected(std::string("recordings.all: recordings need a folder; name one with --recordings"));
  if (!wanted.recordings.empty()) {
    auto recorder = Recorder::open(
        {.folder = wanted.recordings,
         .changed = [sockets = daemon->sockets_.get()] { sockets->wake(); },
         .settle = [scheduler = daemon->scheduler_.get()](const auto& session) { scheduler->wake_analysis(session); }},
        *daemon->clock_);
    if (!recorder) return tl::unexpected(recorder.error());
    daemon->recorder_ = std::move(*recorder);
  }
  if (daemon->scheduler_->render_priority() != session::Priority::kRealTime) {
    spdlog::info(
        "rendering has no real-time priority, only {}: under load sound may come late; grant it with `ulimit -r 10`, or "
        "AmbientCapabilities=CAP_SYS_NICE in a systemd unit",
        daemon->scheduler_->render_priority() == session::Priority::kNice ? "a nice value before others" : "the usual one");
  }
  return daemon;
}

void Daemon::run(const std::atomic<bool>& stop, const std::function<void()>& between) {
  std::vector<wire::Event> events;
  while (!stop.load()) {
    if (between) between();
    events.clear();
    do_if_it_fits(
        [&] { sockets_->poll(guests_.empty() && strangers_.empty() ? milliseconds(200) : milliseconds(20), events); });
    for (auto& event : events) do_if_it_fits([&] { std::visit([this](auto& e) { handle(e); }, event); });
    do_if_it_fits([&] { serve_guests(); });
    do_if_it_fits([&] { serve_recordings(); });
    do_if_it_fits([&] { serve_page(); });
    do_if_it_fits([&] { watch_load(); });
    do_if_it_fits([&] { finish_reloads(); });
    do_if_it_fits([&] { tell_of_sockets(); });
  }
  drain(between);
  end_recordings();
  scheduler_.reset();
  reloads_.reset();
  if (!playback_) return;
  const auto played = playback_->figures();
  if (played.frames_played > 0) {
    spdlog::info("played {:.1f} s; {} missed by the device, {} in gaps, {} left out, {}, {} lost",
                 static_cast<double>(played.frames_played) / played.rate_hz, counted(played.frames_missed, "sample"),
                 played.mix.samples_in_gaps, played.mix.samples_left_out, counted(played.mix.splices, "splice"),
                 counted(played.devices_lost, "device"));
  }
}

// ------------------------------------------------------------------------------------------------------------ control

void Daemon::handle(wire::ControlRequestReceived& event) {
  const auto request = wire::decode_control(event.bytes.bytes());
  const std::uint64_t id = request ? request->request_id : request.error().request_id;
  if (const auto forbidden = request ? check_permission(*request, event.user) : std::nullopt) {
    complain("control request", *forbidden);
    sockets_->send_control(event.peer, wire::encode_reply(id, *forbidden));
    return;
  }
  if (const auto* reload = request ? std::get_if<wire::ReloadPackRequest>(&request->body) : nullptr) {
    reloads_->ask({event.peer, id, reload->name});
    return;
  }
  if (const auto* leave = request ? std::get_if<wire::DetachRequest>(&request->body) : nullptr) {
    if (Guest* leaving = guest(request->session_id)) {
      leaving->stirred = true;
      leaving->goodbyes.push_back({event.peer, id, leave->last_sequence, leave->discard, clock_->now()});
      return;
    }
  }
  if (request && std::holds_alternative<wire::StopRecordingRequest>(request->body)) {
    if (const auto stopped = stop_recording(event.peer, *request))
      sockets_->send_control(event.peer, wire::encode_reply(id, *stopped));
    return;
  }
  const wire::ControlReply reply =
      request ? answer_if_it_fits(*request, event.user) : wire::ControlReply(request.error().error);
  if (const auto* error = std::get_if<wire::Error>(&reply)) complain("control request", *error);
  sockets_->send_control(event.peer, wire::encode_reply(id, reply));
}

wire::ControlReply Daemon::answer_if_it_fits(const wire::ControlRequest& request, const std::string& user) {
  try {
    return answer(request, user);
  } catch (const std::bad_alloc&) {
    return out_of_memory();
  }
}

wire::ControlReply Daemon::answer(const wire::ControlRequest& request, const std::string& user) {
  if (std::holds_alternative<wire::HelloRequest>(request.body)) {
    return wire::Welcome{"rustled " RUSTLE_VERSION,
                         advertised_.stream.value_or(sockets_->stream_endpoint()),
                         advertised_.out.value_or(sockets_->out_endpoint()),
                         options_.rate_hz,
                         options_.block_size,
                         static_cast<std::uint32_t>(guests_.size()),
                         static_cast<std::uint32_t>(draining_ ? guests_.size() : max_sessions_)};
  }
  if (const auto* body = std::get_if<wire::AttachRequest>(&request.body)) return attach(request, *body, user);
  if (std::holds_alternative<wire::ListPacksRequest>(request.body)) return pack_list();
  if (std::holds_alternative<wire::ListSessionsRequest>(request.body)) {
    wire::SessionList list;
    for (const auto& [id, guest] : guests_) {
      if (!may_see(user, *guest)) continue;
      list.sessions.push_back(
          {id, guest->name, guest->session->options().clock, static_cast<std::uint32_t>(guest->decoder.sheet_count()),
           guest->session->counters().newest_time_s, recorder_ ? recorder_->progress(*guest->session) : std::nullopt});
    }
    return list;
  }
  if (request.session_id.empty() && std::holds_alternative<wire::GetStatisticsRequest>(request.body))
    return server_statistics();
  Guest* asked = guest(request.session_id);
  if (asked == nullptr) return unknown_session(request.session_id);
  if (std::holds_alternative<wire::GetStatisticsRequest>(request.body)) return statistics(*asked);
  if (const auto* body = std::get_if<wire::SetGainsRequest>(&request.body)) return set_gains(*asked, *body);
  if (const auto* body = std::get_if<wire::ChangePackRequest>(&request.body)) return change_pack(*asked, *body);
  if (const auto* start = std::get_if<wire::StartRecordingRequest>(&request.body))
    return start_recording(*asked, start->file_name);
  return unsupported("This daemon does not do that while a session sounds.", "Detach, and attach again with other options.");
}

Daemon::Guest* Daemon::guest(const std::string& id) {
  const auto found = guests_.find(id);
  return found == guests_.end() ? nullptr : found->second.get();
}

// ------------------------------------------------------------------------------------------------------------- stream

void Daemon::handle(wire::StreamReceived& event) {
  if (const auto forbidden = check_sender(event.topic, event.user)) {
    complain("stream message", *forbidden);
    return;
  }
  auto envelope = wire::StreamEnvelope::parse(event.bytes.bytes(), event.topic);
  if (!envelope) {
    if (Guest* sender = guest(event.topic)) {
      ++sender->messages;
      ++sender->refused;
      ++sender->arrivals;
      if (recorder_) recorder_->arrived(*sender->session, nullptr, event.bytes.bytes());
      notify(*sender, envelope.error());
    } else {
      complain("stream message", envelope.error());
    }
    return;
  }
  if (const auto forbidden = check_sender(envelope->session_id(), event.user)) {
    complain("stream message", *forbidden);
    return;
  }
  if (Guest* known = guest(envelope->session_id())) {
    using Body = wire::StreamEnvelope::Body;
    const bool frame = envelope->body() == Body::kFrame && envelope->time_s() && envelope->sheet_id();
    const auto newest = frame ? known->newest_frame_s.find(*envelope->sheet_id()) : known->newest_frame_s.end();
    const bool restarted =
        !known->attached && newest != known->newest_frame_s.end() && *envelope->time_s() < newest->second - kRestart_s;
    const bool again = known->finished && !known->attached && (envelope->body() == Body::kAnnouncement || frame);
    if (!restarted && !again) {
      take(*known, *envelope, event.bytes.bytes());
      return;
    }
    spdlog::info("session {} starts again", envelope->session_id());
    if (recorder_) recorder_->finish(*known->session);
    see_off(*known);
    guests_.erase(envelope->session_id());
  }
  if (Guest* met = meet_publisher(*envelope, event.user)) take(*met, *envelope, event.bytes.bytes());
}

Daemon::Guest* Daemon::meet_publisher(wire::StreamEnvelope& envelope, const std::string& user) {
  using Body = wire::StreamEnvelope::Body;
  const std::string id = envelope.session_id();
  const std::string known_as = user.empty() ? id : user + "/" + id;  // what another user says of it is not its own
  const auto now = clock_->now();
  Stranger* stranger = strangers_.meet(known_as, now);
  if (stranger == nullptr || guests_.size() >= max_sessions_) {
    complain("publisher", too_many_sessions());
    return nullptr;
  }
  if (ladder_.level() == engine::kMostLoadLevel) {
    complain("publisher", overloaded());
    return nullptr;
  }
  std::optional<wire::Announcement> announcement;
  if (envelope.body() == Body::kAnnouncement) {
    auto read = envelope.announcement();
    if (!read) {
      complain(fmt::format("announcement of {}", id), read.error());
      publish_notice(id, wire::notice_of(read.error()), 1);
      return nullptr;
    }
    announcement = std::move(*read);
  } else if (now - stranger->since < kAnnouncementGrace) {
    const bool describes = envelope.body() == Body::kSheet || envelope.body() == Body::kTopology ||
                           envelope.body() == Body::kScene || envelope.body() == Body::kListener;
    if (envelope.body() == Body::kFrame) ++stranger->frames;
    if (describes) strangers_.keep(*stranger, std::move(envelope));
    return nullptr;
  } else if (stranger->said.empty() && envelope.body() != Body::kSheet) {
    if (envelope.body() == Body::kFrame) ++stranger->frames;
    if (!stranger->told || now - *stranger->told >= kNoticeInterval) {
      stranger->told = now;
      publish_notice(id, wire::notice_of(unknown_session(id)), 1);
    }
    return nullptr;
  }
  if (const auto beyond = check_session_quota(user)) {
    complain("publisher", *beyond);
    return nullptr;
  }
  session::SessionOptions options;
  if (announcement) options = announcement->options;
  if (options.rate_hz == 0) options.rate_hz = options_.rate_hz;
  if (options.block_size == 0) options.block_size = options_.block_size;
  auto head = heads_.head_for(options);
  const std::optional<wire::Error> headless = head ? std::nullopt : std::optional(head.error());
  if (headless) options.channels = session::ChannelLayout::kStereo;
  const Stranger known = strangers_.take(known_as);
  options.record |= options_.record_all;
  apply_quotas(options, user);
  auto file = options.record ? new_recording(id, {}) : Recorder::NewFile{};
  options.record &= file.has_value();
  Guest& met = admit(id, announcement ? announcement->name : id, options, head.value_or(nullptr), false, user);
  if (options.record) recorder_->begin(std::move(*file), met.session, met.name, nullptr, 1);
  if (!file) notify(met, file.error());
  if (headless) notify(met, *headless);
  for (const auto& earlier : known.said) {
    const std::string bytes = earlier.serialized();
    take(met, earlier, std::as_bytes(std::span(bytes)));
  }
  met.messages += known.frames + known.left_out;
  met.session->count_drop("unannounced", known.frames);
  if (known.left_out > 0) {
    const auto& limits = strangers_.limits();
    met.refused += known.left_out;
    notify(met, {wire::ErrorCode::kTooLarge,
                 "stream",
                 fmt::format("{} sent before the announcement left out; {} messages and {} MiB are kept.",
                             counted(known.left_out, "message"), limits.messages, limits.bytes >> 20),
                 "Announce the session first, then its sheets and topologies, and repeat them every second.",
                 0,
                 std::nullopt,
                 {}});
  }
  return &met;
}

void Daemon::take(Guest& sender, const wire::StreamEnvelope& envelope, std::span<const std::byte> bytes) {
  const AboutSession about(sender.session->id());
  sender.stirred = true;
  sender.last_heard = clock_->now();
  ++sender.messages;
  const bool within = within_quotas(sender, envelope, bytes.size());
  const bool is_frame = envelope.body() == wire::StreamEnvelope::Body::kFrame;
  if (!within && !is_frame) {
    ++sender.refused;
    sender.session->pass_over(envelope.sequence());
    return;
  }
  const std::uint64_t arrival = ++sender.arrivals;
  if (recorder_) recorder_->arrived(*sender.session, &envelope, bytes);
  const std::uint64_t sequence = envelope.sequence();
  sender.last_sequence = std::max(sender.last_sequence, sequence);
  if (envelope.sent_at_s() != 0)
    sender.drift.add(envelope.sent_at_s(), std::chrono::duration<double>(sender.last_heard).count());
  if (!within) {
    sender.session->drop_frame(arrival, sequence, "quota");
    return;
  }
  if (is_frame && !within_budget(sender, bytes.size())) {
    sender.session->drop_frame(arrival, sequence, "budget");
    return;
  }
  auto decoded = sender.decoder.decode(envelope);
  if (!decoded) {
    ++sender.refused;
    sender.session->pass_over(sequence);
    if (is_frame) sender.session->count_drop(std::string(wire::code_name(decoded.error().code)));
    notify(sender, decoded.error());
    return;
  }
  if (envelope.body() == wire::StreamEnvelope::Body::kListener) sender.listener.reset();
  if (sender.standing) sender.standing->take(envelope.message());
  sender.kept_bytes += envelope.bytes();
  if (!decoded->item) {
    sender.session->pass_over(sequence);
    return;
  }
  if (is_frame && envelope.sheet_id() && envelope.time_s()) sender.newest_frame_s[*envelope.sheet_id()] = *envelope.time_s();
  switch (sender.session->offer(std::move(*decoded->item), sequence, std::exchange(sender.kept_bytes, 0), arrival,
                                sender.last_heard)) {
    case session::Offer::kTaken:
      if (sequence != 0) sender.offered = sequence;
      scheduler_->wake_analysis(sender.session);
      return;
    case session::Offer::kFull:
      ++sender.refused;
      notify(sender, {wire::ErrorCode::kOverloaded,
                      "stream",
                      fmt::format("The session's inbox is full: {} messages or {} MiB wait.", session::Inbox::kMessages,
                                  session::Inbox::kBytes >> 20),
                      "Wait for credit before sending on, as the SDKs do.",
                      sequence,
                      std::nullopt,
                      {}});
      return;
    case session::Offer::kEnded:
      ++sender.refused;
      notify(sender, {wire::ErrorCode::kUnknownSession,
                      "stream",
                      fmt::format("The session \"{}\" has ended.", sender.session->id()),
                      "Attach a new one.",
                      sequence,
                      std::nullopt,
                      {}});
      return;
  }
}

// ---------------------------------------------------------------------------------------------------------------- out

void Daemon::handle(wire::SubscriptionChanged& event) {
  constexpr std::string_view kNotices = "/notices";  // a client listens to them as long as it lives
  if (std::string_view(event.topic).ends_with(kNotices)) {
    Guest* told = guest(event.topic.substr(0, event.topic.size() - kNotices.size()));
    if (told != nullptr) told->client_left = event.on ? std::nullopt : std::optional(clock_->now());
    return;
  }
  const auto topic = wire::parse_pcm_topic(event.topic);
  if (!topic) return;
  Guest* heard = guest(topic->session_id);
  if (heard == nullptr) return;
  if (!event.on) {
    heard->pcm.unsubscribe(event.topic);
  } else if (const auto refused = heard->pcm.subscribe(event.topic, *topic)) {
    publish_notice(topic->session_id, *refused, ++heard->out_sequence[wire::notices_topic(topic->session_id)]);
  }
}

void Daemon::serve_guests() {
  const auto now = clock_->now();
  const bool all = now - served_all_at_ >= kServeAll;
  if (all) served_all_at_ = now;
  bool some_leave = all;
  for (auto& [id, guest] : guests_) {
    const bool news = guest->session->has_news.exchange(false);
    if (news || all || guest->stirred) serve(id, *guest);
    some_leave |= guest->detached && guest->finished && guest->goodbyes.empty();
  }
  if (some_leave) let_go();
}

void Daemon::serve(const std::string& id, Guest& served) {
  const AboutSession about(id);
  served.stirred = false;
  for (auto& outcome : served.session->take_outcomes()) {
    if (auto* observed = std::get_if<observation::Observation>(&outcome)) {
      if (observed->unidentified) notify(served, unidentified(observed->sheet));
      const std::string topic = wire::observations_topic(id);
      if (sockets_->has_listener(topic)) {
        sockets_->publish(topic, wire::encode_observation({id, ++served.out_sequence[topic]}, *observed,
                                                          served.session->options().up_axis));
      }
    } else if (auto* refused = std::get_if<session::Refused>(&outcome)) {
      ++served.refused;
      notify(served, {code_of(refused->why.cause),
                      refused->why.field,
                      refused->why.message,
                      refused->why.remedy,
                      refused->sequence,
                      std::nullopt,
                      {}});
    } else if (auto* analysed = std::get_if<session::Analysed>(&outcome)) {
      served.analysed = std::max(served.analysed, analysed->sequence);
    }
  }
  acknowledge(served);
  int blocks = 0;
  while (blocks < kBlocksAtATime && served.session->take_audio(served.session->options().block_size, block_)) {
    play(served, block_);
    served.pcm.publish(block_);
    show(served, block_);
    note_left(served, block_);
    ++blocks;
  }
  served.pcm.publish_beside();
  if (blocks == kBlocksAtATime) {  // more waits; the others first
    served.stirred = true;
    sockets_->wake();
  }
  if (served.session->finished() && !served.finished) {
    served.finished = true;
    served.finished_at = clock_->now();
    served.pcm.publish_end();
    if (recorder_) recorder_->finish(*served.session);
    const auto figures = statistics(served);
    std::uint64_t dropped = 0;
    for (const auto& [cause, frames] : figures.frames_dropped) dropped += frames;
    spdlog::info("session {} ended: {}, {} dropped, {}, {}, {}; {}", id, counted(figures.frames_analysed, "frame"), dropped,
                 counted(figures.crumpling_events, "crumpling event"),
                 counted(figures.friction_episodes, "friction episode"), counted(figures.tear_events, "tear"),
                 to_string(losses_of(figures)));
  }
  say_goodbye(served);
}

void Daemon::acknowledge(Guest& sender) {
  if (sender.session->options().clock != session::Clock::kSimulation) return;
  const std::uint64_t acknowledged =
      std::max(sender.acknowledged, sender.analysed >= sender.offered ? sender.last_sequence : sender.analysed);
  const auto now = clock_->now();
  if (acknowledged == 0 || (acknowledged == sender.acknowledged && now - sender.credited_at < kCreditInterval)) return;
  if (!rate_left(sender)) return;
  sender.acknowledged = acknowledged;
  sender.credited_at = now;
  const std::string topic = wire::acknowledgements_topic(sender.session->id());
  sockets_->publish(topic, wire::encode_credit({sender.session->id(), ++sender.out_sequence[topic]},
                                               {acknowledged, kWindowMessages, kWindowBytes}));
}

void Daemon::play(Guest& sender, const session::AudioBlock& block) {
  // What follows simulation time comes at any pace: its listeners store it.
  if (!playback_ || sender.session->options().clock != session::Clock::kLive) return;
  if (!sender.played) sender.played = playback_->add(sender.session->options().rate_hz, block.channels);
  playback_->push(*sender.played, block.interleaved);
  if (block.last) playback_->end(*sender.played);
}

void Daemon::notify(Guest& sender, const wire::Error& error) {
  auto& tally = sender.notices[std::string(wire::code_name(error.code))];
  ++tally.unsent;
  const auto now = clock_->now();
  if (tally.last_sent && now - *tally.last_sent < kNoticeInterval) return;
  const std::string& id = sender.session->id();
  spdlog::warn("session {}: {}{}", id, wire::to_string(error),
               tally.unsent > 1 ? fmt::format(" ({} times)", tally.unsent) : "");
  publish_notice(id, wire::notice_of(error, tally.unsent), ++sender.out_sequence[wire::notices_topic(id)]);
  tally = {now, 0};
}

void Daemon::publish_notice(const std::string& session_id, const wire::Notice& notice, std::uint64_t sequence) {
  sockets_->publish(wire::notices_topic(session_id), wire::encode_notice({session_id, sequence}, notice));
}

}  // namespace rustle::apps
