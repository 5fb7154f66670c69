#include "client_sdk/capture/capture_reader.h"
#include "server/wire/decisions.h"
#include "tests/fuzz/fuzzed_session.h"
#include "tests/fuzz/memory_file.h"

/// Captures: the reader, and a session of what it gives. As a checksum is seldom guessed, the seeds have none.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rustle;
  auto reader = capture::CaptureReader::open(std::make_unique<fuzz::MemoryFile>(fuzz::text_of(data, size)));
  if (!reader) {
    fuzz::require(!reader.error().empty());
    return 0;
  }
  fuzz::FuzzedSession session;
  while (const auto record = reader->next()) {
    if (record->kind == capture::Kind::kStreamMessage) {
      session.take(record->bytes);
    } else {
      static_cast<void>(wire::decode_decision(std::as_bytes(std::span(record->bytes))));
    }
  }
  fuzz::require(reader->recovery().complete == reader->recovery().what.empty());
  fuzz::require(reader->recovery().bytes_read <= size);
  return 0;
}
