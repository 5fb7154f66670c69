#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client_sdk/capture/capture_reader.h"
#include "client_sdk/capture/capture_writer.h"
#include "server/sinks/recording.h"
#include "tests/fuzz/memory_file.h"

/// Captures under faults: cut at every byte, flipped at every bit, their writer killed, writes and syncs that fail.
/// usage: fault_captures cuts CAPTURE
///        fault_captures flips|some-flips|kills|errors NUMBER     some-flips: of one bit in every byte
/// Prints what was injected and what was seen; status 0 when everything holds.
namespace {

using namespace rustle;
using Clock = std::chrono::steady_clock;

// ---------------------------------------------------------------------------------------------------- records to tell

/// Record `k` of a recording, whose bytes say which one it is: one that was not written cannot look like one.
capture::CaptureRecord record(std::uint32_t k) {
  std::mt19937 random(k);
  std::string bytes(16 + random() % 400, '\0');
  for (char& c : bytes) c = static_cast<char>(random());
  return {fmt::format("/s/frame/{}", k % 3),
          std::uint64_t{k} * 20'000'000,
          std::uint64_t{k} * 20'000'000,
          k,
          std::move(bytes),
          k % 7 == 0 ? capture::Kind::kDecision : capture::Kind::kStreamMessage};
}

bool same(const capture::CaptureRecord& a, const capture::CaptureRecord& b) {
  return a.topic == b.topic && a.log_time_ns == b.log_time_ns && a.sequence == b.sequence && a.bytes == b.bytes &&
         a.kind == b.kind;
}

struct ReadBack {
  std::vector<capture::CaptureRecord> records;
  std::vector<std::uint64_t> ends;  ///< bytes read when each record was given: the end of its chunk
  bool complete = false;
};

ReadBack read_back(std::string_view bytes) {
  ReadBack out;
  auto reader = capture::CaptureReader::open(std::make_unique<fuzz::MemoryFile>(bytes));
  if (!reader) return out;
  while (auto next = reader->next()) {
    out.records.push_back(std::move(*next));
    out.ends.push_back(reader->recovery().bytes_read);
  }
  out.complete = reader->recovery().complete;
  return out;
}

std::string bytes_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// ------------------------------------------------------------------------------------------------------------- damage

struct Damage {
  std::uint64_t cases = 0, wrong = 0, lost = 0, unnoticed = 0;
};

/// What was read of a damaged file, whose bytes before `whole` are as they were: nothing but what is in it, in its order,
/// with all of the chunks that end before.
void check(const ReadBack& truth, const ReadBack& read, std::uint64_t whole, Damage& damage) {
  ++damage.cases;
  auto left = truth.records.begin();
  for (const capture::CaptureRecord& record : read.records) {
    left = std::find_if(left, truth.records.end(), [&](const auto& true_record) { return same(record, true_record); });
    if (left == truth.records.end()) {
      ++damage.wrong;
      break;
    }
    ++left;
  }
  const auto due = std::upper_bound(truth.ends.begin(), truth.ends.end(), whole) - truth.ends.begin();
  const auto undamaged =
      std::mismatch(truth.records.begin(), truth.records.begin() + due, read.records.begin(), read.records.end(), same);
  if (undamaged.first != truth.records.begin() + due) ++damage.lost;
  if (read.complete) ++damage.unnoticed;
}

int told(const char* what, const Damage& damage) {
  fmt::print("{}: {} injected; {} records wrong, {} files with whole chunks lost, {} not noticed\n", what, damage.cases,
             damage.wrong, damage.lost, damage.unnoticed);
  return damage.wrong + damage.lost + damage.unnoticed == 0 ? 0 : 1;
}

int cut_everywhere(const std::string& bytes) {
  const ReadBack truth = read_back(bytes);
  Damage damage;
  for (std::size_t length = 0; length < bytes.size(); ++length)
    check(truth, read_back(std::string_view(bytes).substr(0, length)), length, damage);
  return truth.complete && !truth.records.empty() ? told("cut at every byte", damage) : 1;
}

// -------------------------------------------------------------------------------------------------------------- kills

sinks::Recording::Options small_chunks() {
  sinks::Recording::Options options;
  options.writer.mcap.chunk_span_ns = 40'000'000;  // two records
  return options;
}

/// Records until it is killed, and tells on `tell` up to which record it was acknowledged.
[[noreturn]] void record_for_ever(const std::filesystem::path& file, int tell) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  auto out = capture::create_file(file);
  if (!out) std::_Exit(3);
  sinks::Recording* recording = nullptr;
  std::uint64_t last = 0;
  sinks::Recording made(std::move(*out), small_chunks(), [&] {
    if (recording == nullptr) return;
    const std::uint64_t stored = recording->state().stored_sequence;
    if (stored == std::exchange(last, stored)) return;
    if (::write(tell, &stored, sizeof(stored)) != sizeof(stored)) std::_Exit(4);
  });
  recording = &made;
  for (std::uint32_t k = 1;; ++k) {
    made.write(record(k));
    if (k % 8 == 0) std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
}

int kill_while_recording(int runs) {
  const auto folder = std::filesystem::temp_directory_path() / fmt::format("rustle-kills-{}", ::getpid());
  std::filesystem::create_directories(folder);
  std::mt19937 random(1);
  std::uint64_t acknowledged_in_all = 0, lost = 0, invented = 0, silent = 0;
  for (int run = 0; run < runs; ++run) {
    const auto file = folder / "killed.mcap";
    std::filesystem::remove(file);
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) return 1;
    const pid_t child = ::fork();
    if (child == 0) record_for_ever(file, ends[1]);
    ::close(ends[1]);
    // Killed within the first acknowledgements, wherever it is then: in a write, in a sync, between.
    std::uint64_t acknowledged = 0, stored = 0;
    const auto read_one = [&] {
      if (::read(ends[0], &stored, sizeof(stored)) != sizeof(stored)) return false;
      acknowledged = stored;
      return true;
    };
    for (std::uint32_t k = random() % 6; k > 0 && read_one(); --k) {
    }
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 2000));
    ::kill(child, SIGKILL);
    while (read_one()) {
    }
    ::close(ends[0]);
    ::waitpid(child, nullptr, 0);
    const ReadBack read = read_back(bytes_of(file));
    acknowledged_in_all += acknowledged;
    if (acknowledged == 0) ++silent;
    if (read.records.size() < acknowledged) ++lost;
    for (std::size_t k = 0; k < read.records.size(); ++k)
      if (!same(read.records[k], record(static_cast<std::uint32_t>(k + 1)))) ++invented;
  }
  std::filesystem::remove_all(folder);
  fmt::print("writer killed: {} injected; {} records acknowledged, {} files with one lost, {} records invented\n", runs,
             acknowledged_in_all, lost, invented);
  return lost + invented == 0 && silent < static_cast<std::uint64_t>(runs) / 2 + 1 ? 0 : 1;
}

// ------------------------------------------------------------------------------------------------------------- errors

/// A disk on which one operation fails. As Linux has it, what was written since the last sync is gone when a sync fails,
/// and the next sync succeeds all the same: who tries again is told a lie.
struct Disk {
  std::string durable, written;
  std::uint64_t operations = 0, failing = 0;
  bool by_half = false;  ///< the failing write leaves a part of its bytes
  bool from_then_on = false;
  bool failed = false;
  bool synced_after_failed_sync = false, sync_failed = false;
};

class FailingFile : public capture::OutputFile {
 public:
  explicit FailingFile(std::shared_ptr<Disk> disk) : disk_(std::move(disk)) {}

  std::error_code write(std::string_view bytes) override {
    if (fails()) {
      if (disk_->by_half) disk_->written += bytes.substr(0, bytes.size() / 2);
      return std::make_error_code(std::errc::no_space_on_device);
    }
    disk_->written += bytes;
    return {};
  }
  std::error_code sync() override {
    if (disk_->sync_failed) disk_->synced_after_failed_sync = true;
    if (fails()) {
      disk_->sync_failed = true;
      disk_->written.resize(disk_->durable.size());
      return std::make_error_code(std::errc::io_error);
    }
    disk_->durable = disk_->written;
    return {};
  }
  std::error_code truncate(std::uint64_t size_bytes) override {
    if (fails()) return std::make_error_code(std::errc::io_error);
    disk_->written.resize(size_bytes);
    return {};
  }
  std::error_code close() override { return {}; }
  const std::string& name() const override { return name_; }

 private:
  bool fails() {
    const bool now = ++disk_->operations == disk_->failing || (disk_->from_then_on && disk_->failed);
    disk_->failed |= now;
    return now;
  }

  std::shared_ptr<Disk> disk_;
  std::string name_ = "failing.mcap";
};

int flip_everywhere(int records, bool every_bit) {
  auto disk = std::make_shared<Disk>();
  auto writer = capture::CaptureWriter::create(std::make_unique<FailingFile>(disk), small_chunks().writer);
  for (int k = 1; k <= records; ++k) (void)writer->write(record(static_cast<std::uint32_t>(k)));
  if (!writer->close()) return 1;
  std::string bytes = disk->durable;
  const ReadBack truth = read_back(bytes);
  Damage damage;
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    for (int bit = every_bit ? 0 : static_cast<int>(at % 8); bit < 8; bit += every_bit ? 1 : 8) {
      bytes[at] = static_cast<char>(bytes[at] ^ (1 << bit));
      check(truth, read_back(bytes), at, damage);
      bytes[at] = static_cast<char>(bytes[at] ^ (1 << bit));
    }
  }
  return truth.complete && truth.records.size() == static_cast<std::size_t>(records) ? told("flipped at every bit", damage)
                                                                                     : 1;
}

int fail_writes_and_syncs(int runs) {
  constexpr std::uint32_t kRecords = 200;
  std::uint64_t met = 0, unspoken = 0, false_acknowledgements = 0, wrong = 0, retried = 0;
  std::mt19937 random(2);
  for (int run = 0; run < runs; ++run) {
    auto disk = std::make_shared<Disk>();
    disk->failing = 1 + random() % 220;
    disk->by_half = random() % 2 == 0;
    disk->from_then_on = random() % 2 == 0;
    sinks::Recording recording(std::make_unique<FailingFile>(disk), small_chunks(), [] {});
    for (std::uint32_t k = 1; k <= kRecords; ++k) recording.write(record(k));
    recording.close();
    sinks::Recording::State state;
    do {
      state = recording.state();
      std::this_thread::sleep_for(std::chrono::microseconds(50));
    } while (!state.closed);
    met += disk->failed ? 1 : 0;
    if (disk->failed != state.failure.has_value()) ++unspoken;
    if (disk->synced_after_failed_sync) ++retried;
    // After a power cut only what is durable is there.
    const ReadBack read = read_back(disk->durable);
    if (read.records.size() < state.stored_sequence) ++false_acknowledgements;
    for (std::size_t k = 0; k < read.records.size(); ++k)
      if (!same(read.records[k], record(static_cast<std::uint32_t>(k + 1)))) ++wrong;
  }
  fmt::print(
      "write or sync failed: {} injected, {} met; {} not told, {} false acknowledgements, {} records wrong, {} syncs tried "
      "again\n",
      runs, met, unspoken, false_acknowledgements, wrong, retried);
  return unspoken + false_acknowledgements + wrong + retried == 0 && met > static_cast<std::uint64_t>(runs) / 2 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc == 3 ? argv[1] : "";
  if (what == "cuts") return cut_everywhere(bytes_of(argv[2]));
  if (what == "flips" || what == "some-flips") return flip_everywhere(std::atoi(argv[2]), what == "flips");
  if (what == "kills") return kill_while_recording(std::atoi(argv[2]));
  if (what == "errors") return fail_writes_and_syncs(std::atoi(argv[2]));
  fmt::print(stderr, "usage: {} cuts CAPTURE\n       {} flips|some-flips|kills|errors NUMBER\n", argv[0], argv[0]);
  return 2;
}
