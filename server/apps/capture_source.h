#pragma once

#include <deque>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/capture/capture_reader.h"
#include "server/engine/stream_item.h"
#include "server/session/decision.h"
#include "server/session/session_options.h"
#include "server/wire/decode.h"

namespace rustle::apps {

/// Of a capture's topic "/SESSION/...".
std::string_view session_of(std::string_view topic);

/// A capture as a source of stream items: what the daemon would have decoded from its messages. A daemon's recording also
/// holds what its session decided.
class CaptureSource {
 public:
  /// Opens the file and reads its announcement. Error: a sentence with the file name and what to do.
  static tl::expected<CaptureSource, std::string> open(const std::filesystem::path& file);

  /// As announced; the defaults of the simulation clock when the capture does not say.
  const session::SessionOptions& options() const { return options_; }
  bool announced() const { return announced_; }

  /// The next item, or nothing at the end.
  std::optional<engine::StreamItem> next();

  /// A message, and the item that it was where it was one.
  struct Arrived {
    std::uint64_t arrival = 0;  ///< by which decisions name it; 0: it says what held when the recording began
    std::optional<engine::StreamItem> item;
  };
  using Record = std::variant<Arrived, session::Decision>;
  /// What next() passes through: the next message or decision, or nothing at the end.
  std::optional<Record> next_record();
  /// Where this is a daemon's recording.
  const std::optional<session::RecordingBegun>& begun() const { return begun_; }

  /// What was left out: refused messages by error code, each with its first complaint.
  struct Refusals {
    std::uint64_t count = 0;
    std::string first;
  };
  const std::map<std::string, Refusals>& refused() const { return refused_; }
  const capture::Recovery& recovery() const { return reader_.recovery(); }
  std::uint64_t frames() const { return frames_; }
  double first_time_s() const { return first_time_s_; }
  double newest_time_s() const { return newest_time_s_; }
  /// Share of the file read so far, 0 to 1.
  double progress() const;

 private:
  explicit CaptureSource(capture::CaptureReader reader) : reader_(std::move(reader)) {}
  /// As the file has it, not yet decoded.
  struct Message {
    std::uint64_t arrival;
    wire::StreamEnvelope envelope;
  };
  using Entry = std::variant<Message, session::Decision>;

  void note(const wire::Error& error);
  std::optional<Entry> read_entry();
  std::optional<session::Decision> read_decision(const capture::CaptureRecord& record);
  /// Of the next stream message; 0 for the state with which a recording begins.
  std::uint64_t count_arrival();

  capture::CaptureReader reader_;
  session::SessionOptions options_;
  bool announced_ = false;
  std::deque<Entry> ahead_;  ///< read by open(), up to the first message that has a time
  std::optional<session::RecordingBegun> begun_;
  std::uint32_t state_to_come_ = 0;
  std::uint64_t next_arrival_ = 1;
  std::optional<wire::Decoder> decoder_;
  std::string session_id_;
  std::map<std::string, Refusals> refused_;
  std::uint64_t frames_ = 0;
  double first_time_s_ = 0, newest_time_s_ = 0;
  std::uintmax_t file_bytes_ = 0;
};

}  // namespace rustle::apps
