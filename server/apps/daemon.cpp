#include "server/apps/daemon.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "server/apps/wording.h"
#include "server/session/settled_options.h"

namespace rustle::apps {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr std::uint32_t kWindowMessages = 64;
constexpr std::uint64_t kWindowBytes = std::uint64_t{64} << 20;
constexpr milliseconds kAnnouncementGrace{1200};  // publishers announce themselves every second
constexpr milliseconds kNoticeInterval{500};
constexpr milliseconds kComplaintInterval{1000};  // of what belongs to no session: anyone can send it, and logs are finite
constexpr milliseconds kDetachWait{2000};
constexpr milliseconds kCreditInterval{500};  // repeated, for a listener that was away when it was sent
constexpr int kBlocksAtATime = 256;
constexpr std::size_t kNameBytes = 64;  // of a session id that is made from its client's name
constexpr seconds kFinishedKept{30};
constexpr seconds kIdleKept{300};
constexpr seconds kGoneKept{10};    // a live session whose client has gone without a word, and did not come back
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

/// At most so many bytes of a UTF-8 text, whole characters.
std::string begin_of(const std::string& text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  while (bytes > 0 && (static_cast<unsigned char>(text[bytes]) & 0xc0) == 0x80) --bytes;
  return text.substr(0, bytes);
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
      strangers_({.publishers = options_.max_sessions}) {}

Daemon::~Daemon() = default;

tl::expected<std::unique_ptr<Daemon>, std::string> Daemon::open(DaemonOptions options,
                                                                std::shared_ptr<pack::PackLibrary> packs,
                                                                std::shared_ptr<const session::WallClock> clock) {
  std::unique_ptr<Daemon> daemon(new Daemon(std::move(options), std::move(packs), std::move(clock)));
  auto sockets = wire::Sockets::open(daemon->options_.sockets);
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
  const auto& wanted = daemon->options_;
  daemon->scheduler_ = std::make_unique<session::Scheduler>(
      session::Scheduler::Options{wanted.analysis_workers, wanted.render_workers, wanted.analysis_cpus, wanted.render_cpus},
      *daemon->clock_, [sockets = daemon->sockets_.get()] { sockets->wake(); });
  if (!daemon->scheduler_->pinned())
    return tl::unexpected(std::string(
        "sessions.analysis_affinity, sessions.render_affinity: name only processors that this machine has for us; "
        "`nproc` says how many there are."));
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
    sockets_->poll(guests_.empty() && strangers_.empty() ? milliseconds(200) : milliseconds(20), events);
    for (auto& event : events) std::visit([this](auto& e) { handle(e); }, event);
    for (auto& [id, guest] : guests_) serve(id, *guest);
    let_go();
    tell_of_sockets();
  }
  for (auto& [id, guest] : guests_) {
    if (!guest->finished) publish_end(*guest);
  }
  scheduler_.reset();
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
  if (const auto* leave = request ? std::get_if<wire::DetachRequest>(&request->body) : nullptr) {
    if (Guest* leaving = guest(request->session_id)) {
      leaving->goodbyes.push_back({event.peer, id, leave->last_sequence, leave->discard, clock_->now()});
      return;
    }
  }
  const wire::ControlReply reply = request ? answer(*request) : wire::ControlReply(request.error().error);
  if (const auto* error = std::get_if<wire::Error>(&reply)) complain("control request", *error);
  sockets_->send_control(event.peer, wire::encode_reply(id, reply));
}

void Daemon::complain(std::string_view what, const wire::Error& error) {
  ++complaints_.unsent;
  const auto now = clock_->now();
  if (complaints_.last_sent && now - *complaints_.last_sent < kComplaintInterval) return;
  spdlog::warn("{} refused: {}{}", what, wire::to_string(error),
               complaints_.unsent > 1 ? fmt::format(" ({} since the last such line)", complaints_.unsent) : "");
  complaints_ = {now, 0};
}

void Daemon::tell_of_sockets() {
  const auto& counters = sockets_->counters();
  const auto tell = [this](std::uint64_t count, std::uint64_t& told, const char* what, const char* remedy) {
    if (count == told) return;
    told = count;
    complain("transport",
             {wire::ErrorCode::kMalformed, "", fmt::format("{} so far: {}.", what, count), remedy, 0, std::nullopt, {}});
  };
  tell(counters.malformed_messages, told_.malformed_messages, "Messages with too many or too few parts",
       "Send [topic, StreamMessage] on the stream, one ControlRequest at a time on the control socket.");
  tell(counters.unsent_replies, told_.unsent_replies, "Replies whose asker was gone or did not read",
       "Keep the control socket open until its answer has come.");
}

wire::ControlReply Daemon::answer(const wire::ControlRequest& request) {
  if (std::holds_alternative<wire::HelloRequest>(request.body)) {
    return wire::Welcome{"rustled " RUSTLE_VERSION, sockets_->stream_endpoint(), sockets_->out_endpoint(), options_.rate_hz,
                         options_.block_size};
  }
  if (const auto* body = std::get_if<wire::AttachRequest>(&request.body)) return attach(request, *body);
  if (std::holds_alternative<wire::ListPacksRequest>(request.body)) return pack_list();
  if (std::holds_alternative<wire::ListSessionsRequest>(request.body)) {
    wire::SessionList list;
    for (const auto& [id, guest] : guests_) {
      list.sessions.push_back({id, guest->name, guest->session->options().clock,
                               static_cast<std::uint32_t>(guest->decoder.sheet_count()),
                               guest->session->counters().newest_time_s});
    }
    return list;
  }
  Guest* asked = guest(request.session_id);
  if (asked == nullptr) return unknown_session(request.session_id);
  if (std::holds_alternative<wire::GetStatisticsRequest>(request.body)) return statistics(*asked);
  return unsupported("This daemon does not do that while a session sounds.", "Detach, and attach again with other options.");
}

void Daemon::say_goodbye(Guest& leaving) {
  const auto now = clock_->now();
  std::erase_if(leaving.goodbyes, [&](const Goodbye& goodbye) {
    const bool waited = now - goodbye.since >= kDetachWait;
    if (!leaving.detached) {
      if (!goodbye.discard && leaving.last_sequence < goodbye.last_sequence && !waited) return false;
      if (goodbye.discard) leaving.session->discard();
      leaving.session->end();
      scheduler_->wake_analysis(leaving.session);
      leaving.detached = true;
      if (goodbye.discard && !leaving.finished) {
        leaving.finished = true;
        publish_end(leaving);
      }
    }
    const bool accounted = !leaving.session->waiting() && leaving.finished;
    if (!accounted && !waited) return false;
    sockets_->send_control(goodbye.peer, wire::encode_reply(goodbye.request_id, wire::Detached{statistics(leaving)}));
    return true;
  });
}

wire::ControlReply Daemon::attach(const wire::ControlRequest& request, const wire::AttachRequest& body) {
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
  if (body.options.record) {
    return unsupported("Sessions are not recorded by this version.", "Attach without it, and keep what you send.");
  }
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
  Guest& admitted = admit(id, body.name, options, *head, true);
  for (const auto& sheet : body.sheets) {
    if (auto added = admitted.decoder.add_sheet(sheet); !added) {
      const wire::Error error = added.error();
      scheduler_->remove(admitted.session);
      guests_.erase(id);
      return error;
    }
    static_cast<void>(admitted.session->offer(sheet, 0, 0));
  }
  scheduler_->wake_analysis(admitted.session);
  wire::Attached attached{id, admitted.session->options(), std::nullopt};
  if (options.clock == session::Clock::kSimulation) attached.credit = wire::FlowCredit{0, kWindowMessages, kWindowBytes};
  return attached;
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

wire::ControlReply Daemon::pack_list() const {
  wire::PackList list;
  for (const auto& entry : packs_->entries()) {
    wire::PackInfo info{entry.name, entry.material, entry.touched_surface, entry.version, entry.licence, 0, 0, 0, {}};
    const auto held = held_packs_.find(entry.folder);
    if (held != held_packs_.end()) {
      const pack::SoundPack& pack = *held->second;
      info.rate_hz = pack.stored_rate_hz;
      if (pack.crumpling) {
        info.units = static_cast<std::uint32_t>(pack.crumpling->units.size());
        info.models.push_back("crumpling");
      }
      if (pack.friction) {
        info.spectra = static_cast<std::uint32_t>(pack.friction->spectra.size());
        info.models.push_back("friction");
      }
    }
    list.packs.push_back(std::move(info));
  }
  return list;
}

// ------------------------------------------------------------------------------------------------------------- stream

Daemon::Guest& Daemon::admit(const std::string& id, std::string name, session::SessionOptions options,
                             const std::shared_ptr<const spatial::Hrtf>& head, bool attached) {
  options = session::settled(std::move(options));
  auto session = std::make_shared<session::Session>(id, options, packs_, *clock_, head);
  scheduler_->add(session);
  auto& place = guests_[id];
  place = std::make_unique<Guest>(std::move(session), std::move(name), attached);
  place->last_heard = clock_->now();
  for (const auto& topic : sockets_->subscriptions()) {
    wire::SubscriptionChanged known{topic, true};
    handle(known);
  }
  spdlog::info("session {} {}: {} clock, {} Hz, {} channels", id, attached ? "attached" : "announced itself",
               options.clock == session::Clock::kLive ? "live" : "simulation", options.rate_hz,
               session::channel_count(options.channels));
  return *place;
}

Daemon::Guest* Daemon::guest(const std::string& id) {
  const auto found = guests_.find(id);
  return found == guests_.end() ? nullptr : found->second.get();
}

void Daemon::handle(wire::StreamReceived& event) {
  auto envelope = wire::StreamEnvelope::parse(event.bytes.bytes(), event.topic);
  if (!envelope) {
    if (Guest* sender = guest(event.topic)) {
      ++sender->messages;
      ++sender->refused;
      notify(*sender, envelope.error());
    } else {
      complain("stream message", envelope.error());
    }
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
      take(*known, *envelope);
      return;
    }
    spdlog::info("session {} starts again", envelope->session_id());
    scheduler_->remove(known->session);
    if (playback_ && known->played) playback_->end(*known->played);
    guests_.erase(envelope->session_id());
  }
  if (Guest* met = meet_publisher(*envelope)) take(*met, *envelope);
}

Daemon::Guest* Daemon::meet_publisher(wire::StreamEnvelope& envelope) {
  using Body = wire::StreamEnvelope::Body;
  const std::string id = envelope.session_id();
  const auto now = clock_->now();
  Stranger* stranger = strangers_.meet(id, now);
  if (stranger == nullptr || guests_.size() >= max_sessions_) {
    complain("publisher", too_many_sessions());
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
  session::SessionOptions options;
  if (announcement) options = announcement->options;
  if (options.rate_hz == 0) options.rate_hz = options_.rate_hz;
  if (options.block_size == 0) options.block_size = options_.block_size;
  auto head = heads_.head_for(options);
  const std::optional<wire::Error> headless = head ? std::nullopt : std::optional(head.error());
  if (headless) options.channels = session::ChannelLayout::kStereo;
  const Stranger known = strangers_.take(id);
  Guest& met = admit(id, announcement ? announcement->name : id, options, head.value_or(nullptr), false);
  if (headless) notify(met, *headless);
  for (const auto& earlier : known.said) take(met, earlier);
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

void Daemon::take(Guest& sender, const wire::StreamEnvelope& envelope) {
  sender.last_heard = clock_->now();
  ++sender.messages;
  const std::uint64_t sequence = envelope.sequence();
  sender.last_sequence = std::max(sender.last_sequence, sequence);
  if (envelope.sent_at_s() != 0)
    sender.drift.add(envelope.sent_at_s(), std::chrono::duration<double>(sender.last_heard).count());
  const bool is_frame = envelope.body() == wire::StreamEnvelope::Body::kFrame;
  auto decoded = sender.decoder.decode(envelope);
  if (!decoded) {
    ++sender.refused;
    sender.session->pass_over(sequence);
    if (is_frame) sender.session->count_drop(std::string(wire::code_name(decoded.error().code)));
    notify(sender, decoded.error());
    return;
  }
  sender.kept_bytes += envelope.bytes();
  if (!decoded->item) {
    sender.session->pass_over(sequence);
    return;
  }
  if (is_frame && envelope.sheet_id() && envelope.time_s()) sender.newest_frame_s[*envelope.sheet_id()] = *envelope.time_s();
  switch (sender.session->offer(std::move(*decoded->item), sequence, std::exchange(sender.kept_bytes, 0))) {
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
    heard->pcm.erase(event.topic);
    return;
  }
  if (topic->content != wire::PcmContent::kMix || topic->format == wire::PcmFormat::kOpus) {
    publish_notice(
        topic->session_id,
        {wire::NoticeLevel::kError, "unsupported", "topic",
         fmt::format("\"{}\" is not streamed by this version.", event.topic), "Subscribe to the mix as f32 or s16.", 0, 1},
        ++heard->out_sequence[wire::notices_topic(topic->session_id)]);
    return;
  }
  const auto [out, fresh] = heard->pcm.try_emplace(event.topic, PcmOut{*topic, {}, 0, 0});
  if (fresh && heard->finished) {
    sockets_->publish(event.topic,
                      wire::encode_end({topic->session_id, ++out->second.sequence}, heard->session->samples_rendered()));
  }
}

void Daemon::serve(const std::string& id, Guest& served) {
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
    publish_pcm(served, block_);
    ++blocks;
  }
  if (blocks == kBlocksAtATime) sockets_->wake();  // more waits; the others first
  if (served.session->finished() && !served.finished) {
    served.finished = true;
    served.finished_at = clock_->now();
    publish_end(served);
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

void Daemon::publish_end(Guest& sender) {
  for (auto& [topic, out] : sender.pcm) {
    sockets_->publish(topic, wire::encode_end({sender.session->id(), ++out.sequence}, sender.session->samples_rendered()));
  }
}

void Daemon::acknowledge(Guest& sender) {
  if (sender.session->options().clock != session::Clock::kSimulation) return;
  const std::uint64_t acknowledged =
      std::max(sender.acknowledged, sender.analysed >= sender.offered ? sender.last_sequence : sender.analysed);
  const auto now = clock_->now();
  if (acknowledged == 0 || (acknowledged == sender.acknowledged && now - sender.credited_at < kCreditInterval)) return;
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

void Daemon::publish_pcm(Guest& sender, const session::AudioBlock& block) {
  if (!sender.pcm.empty()) sender.samples_sent += block.interleaved.size() / static_cast<std::size_t>(block.channels);
  for (auto& [topic, out] : sender.pcm) {
    if (out.waiting.empty()) out.first_sample = block.first_sample;
    out.waiting.insert(out.waiting.end(), block.interleaved.begin(), block.interleaved.end());
    flush_pcm(sender, out, block.last);
  }
}

void Daemon::flush_pcm(Guest& sender, PcmOut& out, bool all) {
  const auto& options = sender.session->options();
  const auto channels = static_cast<std::size_t>(session::channel_count(options.channels));
  const std::size_t whole = static_cast<std::size_t>(out.topic.blocks) * options.block_size * channels;
  if (out.waiting.empty() || (!all && out.waiting.size() < whole)) return;
  wire::PcmHeader header;
  header.first_sample = out.first_sample;
  header.rate_hz = options.rate_hz;
  header.channels = static_cast<std::uint32_t>(channels);
  header.format = out.topic.format;
  header.time_s = sender.session->time_of(out.first_sample);
  header.content = wire::MixContent{};
  header.missing_samples = out.missing;
  const bool sent = sockets_->publish(wire::to_string(out.topic),
                                      wire::encode_pcm({sender.session->id(), ++out.sequence}, header, out.waiting));
  const std::uint64_t samples = out.waiting.size() / channels;
  out.missing = sent ? 0 : out.missing + samples;
  if (!sent) sender.samples_in_gaps += samples;
  out.waiting.clear();
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

void Daemon::let_go() {
  const auto now = clock_->now();
  if (const auto lost = strangers_.forget_before(now - kIdleKept); lost > 0) {
    complain("publisher",
             {wire::ErrorCode::kUnknownSession,
              "stream",
              fmt::format("{} of publishers that never described a sheet are forgotten.", counted(lost, "message")),
              "Announce the session, or describe its sheets, every second.",
              0,
              std::nullopt,
              {}});
  }
  for (auto entry = guests_.begin(); entry != guests_.end();) {
    Guest& kept = *entry->second;
    const bool live = kept.session->options().clock == session::Clock::kLive;
    const bool gone = live && kept.client_left && now - std::max(*kept.client_left, kept.last_heard) > kGoneKept;
    const auto limit = gone ? kGoneKept : kIdleKept;
    if (!kept.finished && !kept.detached && now - kept.last_heard > limit) end_idle(kept, limit);
    if (kept.finished && kept.goodbyes.empty() && (kept.detached || now - kept.finished_at > kFinishedKept)) {
      scheduler_->remove(kept.session);
      if (playback_ && kept.played) playback_->end(*kept.played);
      entry = guests_.erase(entry);
    } else {
      ++entry;
    }
  }
}

void Daemon::end_idle(Guest& idle, std::chrono::seconds after) {
  notify(idle, {wire::ErrorCode::kIdle,
                "stream",
                fmt::format("The session \"{}\" has ended: nothing came for {} s.", idle.session->id(), after.count()),
                "Attach again; while a simulation pauses, send a frame or an advance now and then.",
                0,
                std::nullopt,
                {}});
  idle.session->end();
  scheduler_->wake_analysis(idle.session);
  idle.detached = true;
}

}  // namespace rustle::apps
