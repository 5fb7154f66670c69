#pragma once

#include <deque>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/capture/capture_reader.h"
#include "server/engine/stream_item.h"
#include "server/session/session_options.h"
#include "server/wire/decode.h"

namespace rustle::apps {

/// A capture as a source of stream items: what the daemon would have decoded from its messages.
class CaptureSource {
 public:
  /// Opens the file and reads its announcement. Error: a sentence with the file name and what to do.
  static tl::expected<CaptureSource, std::string> open(const std::filesystem::path& file);

  /// As announced; the defaults of the simulation clock when the capture does not say.
  const session::SessionOptions& options() const { return options_; }
  bool announced() const { return announced_; }

  /// The next item, or nothing at the end.
  std::optional<engine::StreamItem> next();

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
  void note(const wire::Error& error);
  std::optional<wire::StreamEnvelope> next_envelope();

  capture::CaptureReader reader_;
  session::SessionOptions options_;
  bool announced_ = false;
  std::deque<wire::StreamEnvelope> ahead_;  ///< read by open(), up to the first that has a time
  std::optional<wire::Decoder> decoder_;
  std::string session_id_;
  std::map<std::string, Refusals> refused_;
  std::uint64_t frames_ = 0;
  double first_time_s_ = 0, newest_time_s_ = 0;
  std::uintmax_t file_bytes_ = 0;
};

}  // namespace rustle::apps
