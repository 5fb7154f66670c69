#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

#include "client_sdk/capture/capture_reader.h"
#include "server/sinks/recording.h"
#include "tests/unit/capture/memory_file.h"

namespace recording_test {

namespace {

using namespace rustle;
using namespace std::chrono_literals;
using capture::CaptureRecord;
using capture::MemoryDisk;
using sinks::Recording;

/// A session's messages, 20 ms apart, with a decision after each third. Messages count from 1.
std::vector<CaptureRecord> session_records(int messages) {
  std::vector<CaptureRecord> records;
  std::uint32_t decisions = 0;
  for (int k = 1; k <= messages; ++k) {
    const auto time_ns = static_cast<std::uint64_t>(k) * 20'000'000;
    records.push_back({"/s/frame/1", time_ns, time_ns, static_cast<std::uint32_t>(k),
                       std::string(static_cast<std::size_t>(100 + 7 * k), static_cast<char>('a' + k % 26)),
                       capture::Kind::kStreamMessage});
    if (k % 3 != 0) continue;
    records.push_back({"/s/decision", time_ns, time_ns, ++decisions, "step", capture::Kind::kDecision});
  }
  return records;
}

std::vector<CaptureRecord> read_back(std::string_view bytes, bool* complete = nullptr) {
  auto reader = capture::CaptureReader::open(std::make_unique<capture::MemoryInputFile>(bytes));
  std::vector<CaptureRecord> records;
  if (!reader) return records;
  while (auto record = reader->next()) records.push_back(std::move(*record));
  if (complete != nullptr) *complete = reader->recovery().complete;
  return records;
}

bool same(const CaptureRecord& a, const CaptureRecord& b) {
  return a.topic == b.topic && a.log_time_ns == b.log_time_ns && a.sequence == b.sequence && a.bytes == b.bytes &&
         a.kind == b.kind;
}

/// Whether `part` is how `whole` begins.
bool begins(const std::vector<CaptureRecord>& whole, const std::vector<CaptureRecord>& part) {
  return part.size() <= whole.size() && std::equal(part.begin(), part.end(), whole.begin(), same);
}

/// How many stream messages up to `sequence` are among these.
std::size_t messages_to(const std::vector<CaptureRecord>& records, std::uint64_t sequence) {
  return static_cast<std::size_t>(std::count_if(records.begin(), records.end(), [sequence](const auto& record) {
    return record.kind == capture::Kind::kStreamMessage && record.sequence <= sequence;
  }));
}

bool wait_until(const std::function<bool()>& condition) {
  for (int round = 0; round < 20'000; ++round) {
    if (condition()) return true;
    std::this_thread::sleep_for(1ms);
  }
  return false;
}

Recording::Options small_chunks() {
  Recording::Options options;
  options.writer.mcap.chunk_bytes = 2'000;
  options.writer.mcap.chunk_span_ns = 100'000'000;
  return options;
}

/// A disk that stands still until it is told to go on.
class StalledFile final : public capture::OutputFile {
 public:
  struct Gate {
    std::mutex mutex;
    std::condition_variable changed;
    bool open = false;
  };
  StalledFile(std::unique_ptr<capture::OutputFile> file, std::shared_ptr<Gate> gate)
      : file_(std::move(file)), gate_(std::move(gate)) {}
  std::error_code write(std::string_view bytes) override {
    std::unique_lock lock(gate_->mutex);
    gate_->changed.wait(lock, [this] { return gate_->open; });
    return file_->write(bytes);
  }
  std::error_code sync() override { return file_->sync(); }
  std::error_code truncate(std::uint64_t size_bytes) override { return file_->truncate(size_bytes); }
  std::error_code close() override { return file_->close(); }
  const std::string& name() const override { return file_->name(); }

 private:
  std::unique_ptr<capture::OutputFile> file_;
  std::shared_ptr<Gate> gate_;
};

}  // namespace

TEST_CASE("A recording holds all that was given, in its order", "[sinks][recording]") {
  const auto disk = std::make_shared<MemoryDisk>();
  const auto records = session_records(80);
  Recording recording(std::make_unique<capture::MemoryOutputFile>(disk), small_chunks(), [] {});
  for (const auto& record : records) recording.write(record);
  recording.close();
  recording.write(records.front());  // too late
  REQUIRE(wait_until([&] { return recording.state().closed; }));
  const auto state = recording.state();
  CHECK_FALSE(state.failure.has_value());
  CHECK(state.stored_sequence == 80);
  CHECK(state.messages == records.size());
  CHECK(state.bytes == disk->bytes.size());
  bool complete = false;
  const auto read = read_back(disk->bytes, &complete);
  CHECK(complete);
  CHECK(read.size() == records.size());
  CHECK(begins(records, read));
}

TEST_CASE("What is acknowledged as stored is in the file, whatever becomes of the rest", "[sinks][recording]") {
  const auto disk = std::make_shared<MemoryDisk>();
  std::vector<std::pair<std::uint64_t, std::size_t>> told;  // acknowledged, in the file then
  std::atomic<Recording*> self{nullptr};
  auto recording = std::make_unique<Recording>(std::make_unique<capture::MemoryOutputFile>(disk), small_chunks(), [&] {
    // This is the writer's thread: the disk stands still meanwhile.
    while (self.load() == nullptr) std::this_thread::yield();
    const std::uint64_t stored = self.load()->state().stored_sequence;
    told.emplace_back(stored, messages_to(read_back(disk->bytes), stored));
  });
  self = recording.get();
  for (const auto& record : session_records(60)) recording->write(record);
  recording.reset();
  REQUIRE(told.size() > 5);
  for (const auto& [stored, in_file] : told) CHECK(in_file == stored);
}

TEST_CASE("A chunk that stays open for its span is stored although nothing more comes", "[sinks][recording]") {
  const auto disk = std::make_shared<MemoryDisk>();
  auto options = small_chunks();
  options.writer.mcap.chunk_span_ns = 5'000'000;
  Recording recording(std::make_unique<capture::MemoryOutputFile>(disk), options, [] {});
  recording.write(session_records(1).front());
  CHECK(wait_until([&] { return recording.state().stored_sequence == 1; }));
  CHECK_FALSE(recording.state().closed);
}

TEST_CASE("A disk that fails ends the recording, and leaves what was stored", "[sinks][recording]") {
  const auto records = session_records(40);
  const bool for_good = GENERATE(false, true);
  int failing = 0;
  for (bool failed = true; failed; ++failing) {
    const auto disk = std::make_shared<MemoryDisk>();
    disk->failing_operation = failing;
    disk->fails_from_then_on = for_good;
    Recording recording(std::make_unique<capture::MemoryOutputFile>(disk), small_chunks(), [] {});
    for (const auto& record : records) recording.write(record);
    recording.close();
    REQUIRE(wait_until([&] { return recording.state().closed; }));
    const auto state = recording.state();
    failed = state.failure.has_value();
    CAPTURE(failing, for_good);
    if (failed) CHECK(state.failure->remedy.find("free space") != std::string::npos);
    const auto read = read_back(disk->bytes);
    CHECK(begins(records, read));
    CHECK(messages_to(read, state.stored_sequence) == state.stored_sequence);
    if (!failed) CHECK(read.size() == records.size());
    REQUIRE(failing < 1000);
  }
  CHECK(failing > 10);
}

TEST_CASE("A recording that is cut gives every chunk that is whole", "[sinks][recording]") {
  const auto disk = std::make_shared<MemoryDisk>();
  const auto records = session_records(50);
  {
    Recording recording(std::make_unique<capture::MemoryOutputFile>(disk), small_chunks(), [] {});
    for (const auto& record : records) recording.write(record);
  }
  REQUIRE(disk->write_ends.size() > 10);
  std::size_t before = 0, grown = 0;
  for (const std::size_t end : disk->write_ends) {
    const auto whole = read_back(std::string_view(disk->bytes).substr(0, end));
    CHECK(begins(records, whole));
    CHECK(whole.size() >= before);
    // A byte less, and what this write added is lost, no more.
    const auto cut = read_back(std::string_view(disk->bytes).substr(0, end - 1));
    CHECK(begins(records, cut));
    CHECK(cut.size() >= before);
    grown += whole.size() > before ? 1 : 0;
    before = whole.size();
  }
  CHECK(before == records.size());
  CHECK(grown > 5);
}

TEST_CASE("A disk slower than what arrives ends the recording, and what was taken is written", "[sinks][recording]") {
  const auto disk = std::make_shared<MemoryDisk>();
  const auto gate = std::make_shared<StalledFile::Gate>();
  auto options = small_chunks();
  options.queue_bytes = 5'000;
  Recording recording(std::make_unique<StalledFile>(std::make_unique<capture::MemoryOutputFile>(disk), gate), options,
                      [] {});
  const auto records = session_records(80);
  for (const auto& record : records) recording.write(record);  // does not wait
  {
    std::lock_guard lock(gate->mutex);
    gate->open = true;
  }
  gate->changed.notify_all();
  REQUIRE(wait_until([&] { return recording.state().closed; }));
  const auto state = recording.state();
  REQUIRE(state.failure.has_value());
  CHECK(state.failure->message.find("slower") != std::string::npos);
  CHECK_FALSE(state.failure->remedy.empty());
  const auto read = read_back(disk->bytes);
  CHECK(begins(records, read));
  CHECK(state.messages == read.size());
  std::size_t bytes = 0, taken = 0;
  while (taken < records.size() && bytes + records[taken].bytes.size() <= options.queue_bytes)
    bytes += records[taken++].bytes.size();
  CHECK(read.size() == taken);
}

TEST_CASE("A record larger than the queue goes alone", "[sinks][recording]") {
  const auto disk = std::make_shared<MemoryDisk>();
  auto options = small_chunks();
  options.queue_bytes = 10;
  Recording recording(std::make_unique<capture::MemoryOutputFile>(disk), options, [] {});
  recording.write(session_records(1).front());
  recording.close();
  REQUIRE(wait_until([&] { return recording.state().closed; }));
  CHECK_FALSE(recording.state().failure.has_value());
  CHECK(read_back(disk->bytes).size() == 1);
}

}  // namespace recording_test
