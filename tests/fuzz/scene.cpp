#include "tests/fuzz/fuzzed_session.h"

namespace {

/// The sheet falls through whatever the scene holds by now.
std::string frame(double time_s, float height) {
  rustle::v1::StreamMessage message;
  message.set_session_id("s");
  auto* frame = message.mutable_frame();
  frame->set_sheet_id(1);
  frame->set_topology_id(7);
  frame->set_time_s(time_s);
  const float positions[] = {0, 0, height, 0.1f, 0, height, 0.1f, 0.1f, height, 0, 0.1f, height};
  frame->set_positions(std::string(reinterpret_cast<const char*>(positions), sizeof(positions)));
  return message.SerializeAsString();
}

}  // namespace

/// Scene updates and listeners, then frames near whatever came of them: obstacles' poses, proximity, contacts, reflections.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  rustle::fuzz::FuzzedSession session;
  static const std::string frames[] = {frame(1, 0.001f), frame(1.1, -0.001f)};
  bool changed = false;
  for (const auto message : rustle::fuzz::parts_of(rustle::fuzz::text_of(data, size))) changed |= session.take(message);
  if (!changed) return 0;
  for (const std::string& next : frames) session.take(next);
  return 0;
}
