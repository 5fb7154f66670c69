#include "server/sinks/recording.h"

#include <fmt/format.h>

#include <utility>

namespace rustle::sinks {

Recording::Recording(std::unique_ptr<capture::OutputFile> file, Options options, std::function<void()> changed)
    : options_(std::move(options)), changed_(std::move(changed)), file_(std::move(file)), thread_([this] { run(); }) {}

Recording::~Recording() {
  close();
  thread_.join();
}

void Recording::write(capture::CaptureRecord record) {
  {
    std::lock_guard lock(mutex_);
    if (closing_ || state_.closed) return;
    const std::size_t bytes = record.bytes.size();
    if (waiting_bytes_ > 0 && waiting_bytes_ + bytes > options_.queue_bytes) {
      overflow_ = capture::StorageError{
          "", fmt::format("the disk is slower than what arrives: more than {} MiB wait", options_.queue_bytes >> 20),
          "record to a faster disk, or send coarser meshes"};
      closing_ = true;
    } else {
      waiting_bytes_ += bytes;
      queue_.push_back(std::move(record));
    }
  }
  wanted_.notify_one();
}

void Recording::close() {
  {
    std::lock_guard lock(mutex_);
    closing_ = true;
  }
  wanted_.notify_one();
}

Recording::State Recording::state() const {
  std::lock_guard lock(mutex_);
  return state_;
}

void Recording::run() {
  const std::string name = file_->name();
  auto writer = capture::CaptureWriter::create(std::move(file_), options_.writer);
  if (!writer) {
    end(writer.error(), {name, 0, 0});
    return;
  }
  Result written = serve(*writer);
  const auto closed = writer->close();
  if (written && !closed) written = tl::unexpected(closed.error());
  std::optional<capture::StorageError> failure;
  if (!written) failure = written.error();
  end(std::move(failure), writer->totals());
}

Recording::Result Recording::serve(capture::CaptureWriter& writer) {
  const std::chrono::nanoseconds span(options_.writer.mcap.chunk_span_ns);
  for (;;) {
    std::deque<capture::CaptureRecord> batch;
    bool closing = false;
    {
      std::unique_lock lock(mutex_);
      const auto something = [this] { return !queue_.empty() || closing_; };
      if (opened_at_) {
        wanted_.wait_until(lock, *opened_at_ + span, something);
      } else {
        wanted_.wait(lock, something);
      }
      batch.swap(queue_);
      closing = closing_;
    }
    for (const auto& record : batch) {
      if (Result stored = store(writer, record); !stored) return stored;
      std::lock_guard lock(mutex_);
      waiting_bytes_ -= record.bytes.size();
    }
    if (opened_at_ && Clock::now() >= *opened_at_ + span) {
      if (Result synced = sync(writer); !synced) return synced;
    }
    if (closing) return sync(writer);
  }
}

Recording::Result Recording::store(capture::CaptureWriter& writer, const capture::CaptureRecord& record) {
  const bool open = !writer.open_chunk_is_empty();
  if (Result closed = writer.close_chunk_before(record.log_time_ns); !closed) return closed;
  if (open && writer.open_chunk_is_empty()) {
    if (Result synced = sync(writer); !synced) return synced;
  }
  if (Result written = writer.write(record); !written) return written;
  if (writer.open_chunk_is_empty()) return sync(writer);
  if (!opened_at_) opened_at_ = Clock::now();
  return {};
}

Recording::Result Recording::sync(capture::CaptureWriter& writer) {
  opened_at_.reset();
  const auto stored = writer.sync();
  if (!stored) return tl::unexpected(stored.error());
  {
    std::lock_guard lock(mutex_);
    state_.stored_sequence = *stored;
    state_.messages = writer.totals().messages;
    state_.bytes = writer.totals().bytes;
  }
  changed_();
  return {};
}

void Recording::end(std::optional<capture::StorageError> failure, const capture::CaptureTotals& totals) {
  {
    std::lock_guard lock(mutex_);
    queue_.clear();
    if (!failure && overflow_) {
      failure = overflow_;
      failure->file_name = totals.file_name;
    }
    state_.messages = totals.messages;
    state_.bytes = totals.bytes;
    state_.failure = std::move(failure);
    state_.closed = true;
  }
  changed_();
}

}  // namespace rustle::sinks
