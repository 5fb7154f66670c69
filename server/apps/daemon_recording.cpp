#include <spdlog/spdlog.h>

#include <thread>
#include <utility>

#include "server/apps/daemon.h"
#include "server/wire/decisions.h"

/// What a daemon has to do with recordings.
namespace rustle::apps {
namespace {

constexpr std::chrono::seconds kEndWait{1};  // of a daemon that ends, for its disk
constexpr std::chrono::milliseconds kEndStep{2};

wire::Error not_now(std::string message, std::string remedy) {
  return {wire::ErrorCode::kUnsupported, "start_recording", std::move(message), std::move(remedy), 0, std::nullopt, {}};
}

}  // namespace

tl::expected<Recorder::NewFile, wire::Error> Daemon::new_recording(const std::string& session_id,
                                                                   const std::string& name) const {
  if (!recorder_) {
    return tl::unexpected(not_now("This daemon has no folder for recordings.",
                                  "Start rustled with --recordings FOLDER, or attach without the option `record`."));
  }
  return recorder_->create(session_id, name);
}

void Daemon::take_attached(Guest& guest, const engine::SheetDescription& sheet) {
  const std::uint64_t arrival = ++guest.arrivals;
  if (recorder_) {
    const std::string bytes = wire::encode_sheet(guest.session->id(), sheet);
    if (const auto envelope = wire::StreamEnvelope::parse(std::as_bytes(std::span(bytes)), {})) {
      recorder_->arrived(*guest.session, &*envelope, std::as_bytes(std::span(bytes)));
      guest.standing->take(envelope->message());
    }
  }
  static_cast<void>(guest.session->offer(sheet, 0, 0, arrival));
}

void Daemon::keep_for_recordings(Guest& guest, const engine::SheetDescription& sheet) {
  if (!guest.standing) return;
  const std::string bytes = wire::encode_sheet(guest.session->id(), sheet);
  if (const auto envelope = wire::StreamEnvelope::parse(std::as_bytes(std::span(bytes)), {}))
    guest.standing->take(envelope->message());
}

wire::ControlReply Daemon::start_recording(Guest& guest, const std::string& file_name) {
  const auto& session = *guest.session;
  if (guest.finished || guest.detached) {
    return not_now("The session has ended.", "Attach a new one with the option `record`.");
  }
  if (const auto begun = recorder_ ? recorder_->progress(session) : std::nullopt) {
    return not_now("The session is recorded already, to " + begun->file_name + ".", "Stop that recording first.");
  }
  auto file = new_recording(session.id(), file_name);
  if (!file) return file.error();
  wire::RecordingStarted started{file->name};
  const Recorder::State state{*guest.standing, guest.gains, guest.listener, guest.load_level};
  recorder_->begin(std::move(*file), guest.session, guest.name, &state, guest.arrivals + 1);
  return started;
}

std::optional<wire::ControlReply> Daemon::stop_recording(const wire::ControlPeer& peer,
                                                         const wire::ControlRequest& request) {
  if (recorder_) return recorder_->stop(request.session_id, peer, request.request_id);
  return new_recording(request.session_id, {}).error();
}

void Daemon::serve_recordings() {
  if (!recorder_) return;
  for (auto& news : recorder_->serve()) {
    const std::string& id = news.session->id();
    Guest* recorded = guest(id);
    if (recorded != nullptr && recorded->session == news.session) {
      const std::string topic = wire::acknowledgements_topic(id);
      if (news.stored_sequence) {
        sockets_->publish(topic,
                          wire::encode_stored({id, ++recorded->out_sequence[topic]}, *news.stored_sequence, news.file_name));
      }
      if (news.failure) notify(*recorded, *news.failure);
    } else if (news.failure) {
      spdlog::error("session {}: {}", id, wire::to_string(*news.failure));
    }
    for (const auto& asker : news.answers) {
      sockets_->send_control(asker.peer, wire::encode_reply(asker.request_id, *news.ended));
    }
  }
}

void Daemon::end_recordings() {
  if (!recorder_) return;
  recorder_->finish_all();
  const auto since = clock_->now();
  while (!recorder_->idle() && clock_->now() - since < kEndWait) {
    serve_recordings();
    std::this_thread::sleep_for(kEndStep);
  }
}

bool Daemon::recording_is_over(const Guest& guest) {
  if (!recorder_ || !recorder_->records(*guest.session)) return true;
  recorder_->finish(*guest.session);
  return false;
}

}  // namespace rustle::apps
