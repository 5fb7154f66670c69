#include "server/session/settled_options.h"

#include <utility>

namespace rustle::session {
namespace {

constexpr std::uint32_t kDefaultRate = 48000;
constexpr std::uint32_t kDefaultBlock = 128;
constexpr double kSimulationLookAhead_s = 0.050;

}  // namespace

SessionOptions settled(SessionOptions options) {
  if (options.rate_hz == 0) options.rate_hz = kDefaultRate;
  if (options.block_size == 0) options.block_size = kDefaultBlock;
  if (options.default_material.empty()) options.default_material = "printer-paper";
  if (!options.playout_delay_s && options.clock == Clock::kSimulation) options.playout_delay_s = kSimulationLookAhead_s;
  return options;
}

SessionOptions replayed(SessionOptions recorded) {
  if (recorded.clock == Clock::kLive) recorded.playout_delay_s.reset();
  recorded.clock = Clock::kSimulation;
  recorded.record = false;
  return recorded;
}

engine::Options engine_options(const SessionOptions& options, std::shared_ptr<const spatial::Hrtf> hrtf) {
  engine::Options out;
  out.seed = options.seed;
  out.mode = options.mode == SynthesisMode::kPublished ? engine::Mode::kPublished : engine::Mode::kCorrected;
  switch (options.channels) {
    case ChannelLayout::kMono:
      out.layout = engine::Layout::kMono;
      break;
    case ChannelLayout::kStereo:
      out.layout = engine::Layout::kStereo;
      break;
    case ChannelLayout::kBinaural:
      out.layout = engine::Layout::kBinaural;
      out.hrtf = std::move(hrtf);
      break;
  }
  out.friction_fft_size = static_cast<int>(options.friction_fft_size);
  if (options.most_voices != 0) out.max_voices = static_cast<int>(options.most_voices);
  out.rate_hz = static_cast<int>(options.rate_hz);
  out.time_origin_s = options.time_origin_s;
  out.look_ahead_s = options.playout_delay_s.value_or(0);  // a live session's mapping has it
  out.default_material = options.default_material;
  return out;
}

}  // namespace rustle::session
