#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "client_sdk/capture/capture_record.h"
#include "client_sdk/capture/capture_writer.h"
#include "client_sdk/capture/storage_file.h"

namespace rustle::sinks {

/// A capture that is written while its session goes on. A thread of its own compresses, writes and syncs:
///
///   write() ─► queue ─► writer thread ─► chunk ─► file ─► disk
///
/// A chunk is closed once it spans 250 ms or holds 1 MiB, and is on the disk before the next is begun. What the disk
/// refuses ends the recording: the file is cut after its last whole chunk and finished there. The same goes for a disk so
/// slow that more than `queue_bytes` wait; then all that waits is still written.
class Recording {
 public:
  struct Options {
    std::size_t queue_bytes = std::size_t{64} << 20;  ///< that may wait; one larger record waits alone
    capture::CaptureWriterOptions writer;
  };
  /// How far the writer thread has come.
  struct State {
    std::uint64_t stored_sequence = 0;  ///< every stream message up to it that was given is on the disk
    std::uint64_t messages = 0;         ///< in the file
    std::uint64_t bytes = 0;            ///< of the file
    bool closed = false;                ///< the last state there is
    std::optional<capture::StorageError> failure;
  };

  /// `changed` is called by the writer thread when state() says something new; it must be thread-safe and quick.
  Recording(std::unique_ptr<capture::OutputFile> file, Options options, std::function<void()> changed);
  /// Closes, and waits until that is done.
  ~Recording();
  Recording(const Recording&) = delete;
  Recording& operator=(const Recording&) = delete;

  /// Takes a record; never waits for the disk. What comes after close() or a failure is left out. [network thread]
  void write(capture::CaptureRecord record);
  /// Finishes the file once what was taken is written; state() tells when. [network thread]
  void close();
  /// [any thread]
  State state() const;

 private:
  using Clock = std::chrono::steady_clock;
  using Result = tl::expected<void, capture::StorageError>;

  // ---- [writer thread]
  void run();
  Result serve(capture::CaptureWriter& writer);
  /// Everything before the record's chunk is stored first.
  Result store(capture::CaptureWriter& writer, const capture::CaptureRecord& record);
  Result sync(capture::CaptureWriter& writer);
  void end(std::optional<capture::StorageError> failure, const capture::CaptureTotals& totals);

  const Options options_;
  const std::function<void()> changed_;
  std::unique_ptr<capture::OutputFile> file_;   // writer thread
  std::optional<Clock::time_point> opened_at_;  // writer thread: when the open chunk was begun

  mutable std::mutex mutex_;
  std::condition_variable wanted_;
  std::deque<capture::CaptureRecord> queue_;
  std::size_t waiting_bytes_ = 0;  ///< in the queue and in the writer's hand
  bool closing_ = false;
  std::optional<capture::StorageError> overflow_;
  State state_;

  std::thread thread_;
};

}  // namespace rustle::sinks
