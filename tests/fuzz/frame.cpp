#include "tests/fuzz/fuzzed_session.h"

/// Stream messages, most of all frames: envelope, decoder, analysis of the mesh, planning of its sound.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  rustle::fuzz::FuzzedSession session;
  for (const auto message : rustle::fuzz::parts_of(rustle::fuzz::text_of(data, size))) session.take(message);
  return 0;
}
