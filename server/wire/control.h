#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include <tl/expected.hpp>

#include "server/engine/stream_item.h"
#include "server/session/session_options.h"
#include "server/synthesis/gain.h"
#include "server/wire/encode.h"
#include "server/wire/error.h"
#include "server/wire/limits.h"

/// What is asked and answered on the control socket, as plain data. Pure; any thread.
namespace rustle::wire {

using synthesis::Gain;

struct HelloRequest {
  std::string client;
};
struct AttachRequest {
  std::string name;
  session::SessionOptions options;
  std::vector<engine::SheetDescription> sheets;
};
struct DetachRequest {
  bool discard = false;
  std::uint64_t last_sequence = 0;  ///< of the stream; 0: not told
};
struct SetGainsRequest {
  std::vector<Gain> gains;  ///< changes to those in force
};
struct GetStatisticsRequest {};
struct ListPacksRequest {};
struct ChangePackRequest {
  std::uint32_t sheet_id = 0;
  std::string material, touched_surface;  ///< empty: as it is; one of them is not
};
struct ReloadPackRequest {
  std::string name;  ///< empty: all
};
struct StartRecordingRequest {
  std::string file_name;
};
struct StopRecordingRequest {};
struct ListSessionsRequest {};

struct ControlRequest {
  std::uint64_t request_id = 0;
  std::string session_id;
  std::variant<HelloRequest, AttachRequest, DetachRequest, SetGainsRequest, GetStatisticsRequest, ListPacksRequest,
               ChangePackRequest, ReloadPackRequest, StartRecordingRequest, StopRecordingRequest, ListSessionsRequest>
      body;
};

/// A request that cannot be carried out, with the id its answer must bear.
struct ControlError {
  std::uint64_t request_id = 0;
  Error error;
};

/// Checked as the stream is: texts, finiteness, ranges, counts; Hello's protocol version.
[[nodiscard]] tl::expected<ControlRequest, ControlError> decode_control(std::span<const std::byte> bytes,
                                                                        const Limits& limits = {});

struct Welcome {
  std::string server;           ///< name and version
  std::string stream_endpoint;  ///< empty: the daemon connects out instead
  std::string out_endpoint;
  std::uint32_t rate_hz = 0;
  std::uint32_t block_size = 0;
  std::uint32_t sessions = 0;       ///< there now
  std::uint32_t most_sessions = 0;  ///< there may be
};
struct Attached {
  std::string session_id;
  session::SessionOptions options;   ///< as in force
  std::optional<FlowCredit> credit;  ///< simulation clock: the first window
  std::string recording_file_name;   ///< where the session is recorded
};
/// As session.proto says of each.
struct Statistics {
  std::string session_id;
  std::uint64_t messages_received = 0;
  std::uint64_t frames_received = 0;
  std::uint64_t frames_analysed = 0;
  std::map<std::string, std::uint64_t> frames_dropped;  ///< by cause
  std::uint64_t messages_refused = 0;
  std::uint64_t sequence_gaps = 0;
  std::uint64_t samples_due = 0;
  std::uint64_t samples_sent = 0;
  std::uint64_t samples_in_gaps = 0;
  std::uint64_t voices = 0;
  std::uint64_t crumpling_events = 0;
  std::uint64_t friction_episodes = 0;
  std::uint64_t tear_events = 0;
  double newest_time_s = 0;
  double rendered_time_s = 0;
  double playout_delay_s = 0;
  double clock_drift_ppm = 0;
  std::uint32_t load_level = 0;
  std::uint64_t voices_most = 0;
  std::uint64_t voices_stolen = 0;
  std::uint64_t voices_dropped = 0;
  std::uint64_t sources_dropped = 0;
  std::uint64_t cues_dropped = 0;
  std::uint64_t sounds_missing = 0;
  std::uint64_t planes_left_out = 0;
  std::uint64_t samples_limited = 0;
  std::uint64_t samples_not_finite = 0;
  std::uint64_t voices_merged = 0;
  std::uint64_t emitter_samples_left_out = 0;
  std::uint64_t frames_late = 0;
  std::uint64_t time_jumps = 0;
  std::uint64_t input_gaps = 0;
  std::uint64_t samples_in_input_gaps = 0;
  std::uint64_t pcm_gaps = 0;
  std::uint64_t deadline_misses = 0;
  std::uint64_t late_by_run_delay = 0;
  std::uint64_t events_joined = 0;
};
/// Every number of Statistics with its name in session.proto, in the order of its list.
struct NamedNumber {
  const char* name;
  std::variant<std::uint64_t, double> value;
};
[[nodiscard]] std::vector<NamedNumber> numbers_of(const Statistics& statistics);

/// As session.proto says of each.
struct ThreadStatistics {
  std::string name;
  std::uint64_t count = 0;
  double cpu_s = 0, waited_s = 0;
};
struct PlaybackStatistics {
  std::string device;
  std::uint32_t rate_hz = 0;
  std::uint64_t samples_played = 0, samples_missed = 0;
  std::uint64_t devices_opened = 0, devices_lost = 0;
  std::uint64_t samples_in_gaps = 0, samples_left_out = 0, splices = 0;
};
struct ServerStatistics {
  double uptime_s = 0, cpu_s = 0;
  std::uint32_t sessions = 0;
  std::vector<ThreadStatistics> threads;
  std::optional<PlaybackStatistics> playback;
};
struct Detached {
  Statistics statistics;
};
struct GainsSet {
  std::vector<Gain> gains;  ///< all in force
};
struct PackInfo {
  std::string name, material, touched_surface, version, licence;
  std::uint32_t rate_hz = 0;
  std::uint32_t units = 0;
  std::uint32_t spectra = 0;
  std::vector<std::string> models;
};
struct PackList {
  std::vector<PackInfo> packs;
};
struct PackChanged {
  PackInfo pack;
};
struct RecordingStarted {
  std::string file_name;
};
struct RecordingStopped {
  std::string file_name;
  std::uint64_t messages = 0;
  std::uint64_t bytes = 0;
};
struct RecordingProgress {
  std::string file_name;
  std::uint64_t messages = 0;  ///< in the file so far
  std::uint64_t bytes = 0;
};
struct SessionInfo {
  std::string session_id, name;
  session::Clock clock = session::Clock::kLive;
  std::uint32_t sheets = 0;
  double newest_time_s = 0;
  std::optional<RecordingProgress> recording;
};
struct SessionList {
  std::vector<SessionInfo> sessions;
};

using ControlReply = std::variant<Error, Welcome, Attached, Detached, GainsSet, Statistics, PackList, PackChanged,
                                  RecordingStarted, RecordingStopped, SessionList, ServerStatistics>;

[[nodiscard]] std::string encode_reply(std::uint64_t request_id, const ControlReply& reply);
/// A serialized v1::Error, as a refused subscription is answered with.
[[nodiscard]] std::string encode_error(const Error& error);

}  // namespace rustle::wire
