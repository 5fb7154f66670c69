#include "server/apps/recorder.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "server/apps/wording.h"
#include "server/wire/decisions.h"

namespace rustle::apps {
namespace {

constexpr std::chrono::seconds kSettleWait{1};  // for a session whose threads have no time left
constexpr std::size_t kNameBytes = 64;          // of a session's id in a file name
constexpr std::size_t kFileNameBytes = 200;
constexpr int kNamesTried = 1000;  // of sessions that begin in the same second
constexpr std::size_t kEndedKept = 256;
constexpr std::string_view kSuffix = ".mcap";

std::string text_of(std::span<const std::byte> bytes) {
  return {static_cast<const char*>(static_cast<const void*>(bytes.data())), bytes.size()};
}

/// Of a session's id what is good in a file name everywhere.
std::string stem_of(const std::string& session_id) {
  std::string stem = session_id.substr(0, kNameBytes);
  for (char& c : stem) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
    if (!plain) c = '_';
  }
  return stem;
}

wire::Error refused(wire::ErrorCode code, std::string field, std::string message, std::string remedy) {
  return {code, std::move(field), std::move(message), std::move(remedy), 0, std::nullopt, {}};
}

/// A client learns a file's name, not where the daemon keeps it.
wire::Error storage_refused(const std::string& file_name, const capture::StorageError& error) {
  std::string remedy = error.remedy + ".";
  remedy.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(remedy.front())));
  return refused(wire::ErrorCode::kStorage, "recording", fmt::format("{}: {}.", file_name, error.message),
                 std::move(remedy));
}

tl::expected<std::string, wire::Error> plain_name(std::string wanted) {
  const auto control = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; };
  if (wanted.front() == '.' || wanted.find('/') != std::string::npos || std::ranges::any_of(wanted, control) ||
      wanted.size() > kFileNameBytes) {
    return tl::unexpected(refused(wire::ErrorCode::kMalformed, "start_recording.file_name",
                                  "A recording's name is a plain file name: the daemon's recording folder is its place.",
                                  fmt::format("Give a name without slashes and control characters, not beginning with a "
                                              "dot, of {} bytes at most, or none.",
                                              kFileNameBytes)));
  }
  if (!wanted.ends_with(kSuffix)) wanted += kSuffix;
  return wanted;
}

}  // namespace

Recorder::Recorder(Options options, const session::WallClock& clock)
    : options_(std::move(options)),
      clock_(clock),
      epoch_ns_(std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count() -
                clock.now().count()) {}

tl::expected<std::unique_ptr<Recorder>, std::string> Recorder::open(Options options, const session::WallClock& clock) {
  std::error_code failed;
  std::filesystem::create_directories(options.folder, failed);
  if (failed || !std::filesystem::is_directory(options.folder, failed)) {
    return tl::unexpected(fmt::format("recordings.folder: {} cannot be made a folder{}; name another with --recordings",
                                      options.folder.string(), failed ? " (" + failed.message() + ")" : ""));
  }
  return std::unique_ptr<Recorder>(new Recorder(std::move(options), clock));
}

tl::expected<Recorder::NewFile, wire::Error> Recorder::create(const std::string& session_id,
                                                              const std::string& wanted) const {
  if (!wanted.empty()) {
    auto name = plain_name(wanted);
    if (!name) return tl::unexpected(std::move(name.error()));
    auto file = capture::create_new_file(options_.folder / *name);
    if (!file) return tl::unexpected(storage_refused(*name, file.error()));
    return NewFile{std::move(*file), std::move(*name)};
  }
  const auto now = std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now());
  const std::string stem = fmt::format("{}_{:%Y%m%dT%H%M%SZ}", stem_of(session_id), now);
  for (int k = 1;; ++k) {
    std::string name = k == 1 ? fmt::format("{}{}", stem, kSuffix) : fmt::format("{}-{}{}", stem, k, kSuffix);
    std::error_code unknown;
    const auto path = options_.folder / name;
    if (k < kNamesTried && std::filesystem::exists(path, unknown)) continue;
    auto file = capture::create_new_file(path);
    if (!file) return tl::unexpected(storage_refused(name, file.error()));
    return NewFile{std::move(*file), std::move(name)};
  }
}

std::uint64_t Recorder::log_time_ns() const {
  return static_cast<std::uint64_t>(epoch_ns_ + clock_.now().count());
}

void Recorder::begin(NewFile file, const std::shared_ptr<session::Session>& session, const std::string& name,
                     const State* state, std::uint64_t next_arrival) {
  sinks::Recording::Options options;
  options.queue_bytes = options_.queue_bytes;
  options.writer.notes = {{"source", "rustled " RUSTLE_VERSION}, {"session", session->id()}};
  auto& entry = entries_[session.get()];
  entry.session = session;
  entry.file_name = file.name;
  entry.recording = std::make_unique<sinks::Recording>(std::move(file.file), std::move(options), options_.changed);
  spdlog::info("session {} is recorded to {}", session->id(), (options_.folder / file.name).string());

  const std::string& id = session->id();
  const std::uint64_t now_ns = log_time_ns();
  entry.recording->write({fmt::format("/{}/announcement", id), now_ns, now_ns, 0,
                          wire::encode_announcement(id, name, session->options()), capture::Kind::kStreamMessage});
  if (state == nullptr) {
    decided(entry, session::RecordingBegun{0, 0, next_arrival});
    return;
  }
  const std::int64_t first_sample = session->samples_rendered();
  session->decisions().keep(true);
  auto messages = state->standing.messages();
  decided(entry, session::RecordingBegun{first_sample, static_cast<std::uint32_t>(messages.size()), next_arrival});
  decided(entry, session->mapping());
  for (auto& message : messages) {
    message.set_session_id(id);
    entry.recording->write(capture::record_of(message, now_ns, now_ns));
  }
  const auto held = [&](session::Asked asked) {
    session::Step step;
    step.what = std::move(asked);
    step.accepted_at = first_sample;
    decided(entry, step);
  };
  if (!state->gains.empty()) held(engine::GainChange{state->gains});
  if (state->listener) held(*state->listener);
  if (state->load_level > 0) held(engine::LoadLevel{state->load_level});
}

std::optional<wire::RecordingProgress> Recorder::progress(const session::Session& session) const {
  const auto entry = entries_.find(&session);
  if (entry == entries_.end()) return std::nullopt;
  const auto state = entry->second.recording->state();
  return wire::RecordingProgress{entry->second.file_name, state.messages, state.bytes};
}

void Recorder::arrived(const session::Session& session, const wire::StreamEnvelope* envelope,
                       std::span<const std::byte> bytes) {
  const auto entry = entries_.find(&session);
  if (entry == entries_.end()) return;
  const std::uint64_t now_ns = log_time_ns();
  entry->second.recording->write(
      {envelope != nullptr ? capture::topic_of(envelope->message(), session.id()) : fmt::format("/{}/other", session.id()),
       now_ns, now_ns, envelope != nullptr ? static_cast<std::uint32_t>(envelope->sequence()) : 0, text_of(bytes),
       capture::Kind::kStreamMessage});
}

void Recorder::decided(Entry& entry, const session::Decision& decision) {
  const std::uint64_t number = ++entry.decisions;
  const std::uint64_t now_ns = log_time_ns();
  const std::string& id = entry.session->id();
  entry.recording->write({capture::decision_topic(id), now_ns, now_ns, static_cast<std::uint32_t>(number),
                          wire::encode_decision(id, number, decision), capture::Kind::kDecision});
}

void Recorder::take_decisions(Entry& entry) {
  bool settled = false;
  for (const auto& decision : entry.session->decisions().take()) {
    if (!entry.closing) decided(entry, decision);
    settled |= entry.settling_since && std::holds_alternative<session::RenderedTo>(decision);
  }
  if (entry.closing || !entry.settling_since) return;
  if (!settled && clock_.now() - *entry.settling_since < kSettleWait) return;
  entry.session->decisions().keep(false);
  entry.recording->close();
  entry.closing = true;
}

void Recorder::finish(const session::Session& session) {
  const auto entry = entries_.find(&session);
  if (entry != entries_.end()) finish(entry->second);
}

void Recorder::finish(Entry& entry) {
  if (entry.settling_since) return;
  entry.settling_since = clock_.now();
  entry.session->decisions().want_rendered();
  options_.settle(entry.session);
}

void Recorder::finish_all() {
  for (auto& [session, entry] : entries_) finish(entry);
}

std::optional<wire::ControlReply> Recorder::stop(const std::string& session_id, const wire::ControlPeer& peer,
                                                 std::uint64_t request_id) {
  for (auto& [session, entry] : entries_) {
    if (session->id() != session_id) continue;
    finish(entry);
    entry.answers.push_back({peer, request_id});
    return std::nullopt;
  }
  if (const auto ended = ended_.find(session_id); ended != ended_.end()) return ended->second;
  return refused(wire::ErrorCode::kUnsupported, "stop_recording", fmt::format("\"{}\" is not recorded.", session_id),
                 "Start a recording first; `list_sessions` says which sessions are recorded.");
}

Recorder::News Recorder::news_of(Entry& entry) {
  News news{entry.session, entry.file_name, std::nullopt, std::nullopt, std::nullopt, {}};
  const auto state = entry.recording->state();
  if (state.stored_sequence > entry.stored_told) news.stored_sequence = entry.stored_told = state.stored_sequence;
  if (!state.closed) return news;
  if (state.failure) news.failure = storage_refused(entry.file_name, *state.failure);
  if (news.failure) {
    news.ended = *news.failure;
  } else {
    news.ended = wire::RecordingStopped{entry.file_name, state.messages, state.bytes};
    spdlog::info("session {}: {} closed: {}, {:.1f} MB", entry.session->id(), entry.file_name,
                 counted(state.messages, "record"), 1e-6 * static_cast<double>(state.bytes));
  }
  news.answers = std::move(entry.answers);
  return news;
}

std::vector<Recorder::News> Recorder::serve() {
  std::vector<News> all;
  for (auto each = entries_.begin(); each != entries_.end();) {
    take_decisions(each->second);
    News news = news_of(each->second);
    if (news.ended) {
      news.session->decisions().keep(false);
      static_cast<void>(news.session->decisions().take());
      if (ended_.size() >= kEndedKept) ended_.erase(ended_.begin());
      ended_.insert_or_assign(news.session->id(), *news.ended);
      each = entries_.erase(each);
    } else {
      ++each;
    }
    if (news.stored_sequence || news.ended) all.push_back(std::move(news));
  }
  return all;
}

}  // namespace rustle::apps
