#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "client_sdk/capture/capture_writer.h"
#include "client_sdk/cpp/types.h"

namespace rustle::apps {

/// A sentence; absent: all went well.
using Failure = std::optional<std::string>;

/// Keeps what a demo's session sends as a capture, which takes its name in finish(). Log times are simulation times. Until
/// it is opened it keeps nothing.
class DemoRecording {
 public:
  DemoRecording() = default;
  DemoRecording(const DemoRecording&) = delete;
  DemoRecording& operator=(const DemoRecording&) = delete;
  ~DemoRecording();

  Failure open(const std::string& file, const client::SessionOptions& options);
  Failure topology(const client::Topology& topology);
  Failure scene(const client::SceneUpdate& update);
  Failure frame(std::uint32_t sheet_id, std::uint64_t topology_id, double time_s, std::span<const float> positions,
                const client::FrameExtras& extras);
  Failure finish();

 private:
  Failure keep(v1::StreamMessage& message);

  std::optional<capture::CaptureWriter> writer_;
  std::string file_, partial_;
  std::uint64_t sequence_ = 0;
  double time_s_ = 0;
};

}  // namespace rustle::apps
