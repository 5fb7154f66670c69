#include "server/wire/session_options.h"

#include <fmt/format.h>

#include <bit>

#include "server/wire/fields.h"

namespace rustle::wire {
namespace {

using session::ChannelLayout;
using session::Clock;
using session::ClothFeatures;
using session::SynthesisMode;
using session::UpAxis;

tl::unexpected<Error> refuse_choice(std::string field, int value) {
  return refuse(ErrorCode::kUnsupported, field, fmt::format("{} is {}, which this version does not know.", field, value),
                "Choose one of the values session.proto lists, or bring the daemon up to date.");
}

}  // namespace

tl::expected<session::SessionOptions, Error> from_wire(const v1::SessionOptions& options, std::string_view prefix,
                                                       const Limits& limits) {
  const auto field = [prefix](std::string_view name) { return fmt::format("{}.{}", prefix, name); };
  session::SessionOptions out;

  switch (options.clock()) {
    case v1::CLOCK_UNSPECIFIED:
    case v1::CLOCK_LIVE:
      out.clock = Clock::kLive;
      break;
    case v1::CLOCK_SIMULATION:
      out.clock = Clock::kSimulation;
      break;
    default:
      return refuse_choice(field("clock"), options.clock());
  }
  switch (options.up_axis()) {
    case v1::UP_AXIS_UNSPECIFIED:
    case v1::UP_AXIS_Z:
      out.up_axis = UpAxis::kZ;
      break;
    case v1::UP_AXIS_Y:
      out.up_axis = UpAxis::kY;
      break;
    default:
      return refuse_choice(field("up_axis"), options.up_axis());
  }
  switch (options.mode()) {
    case v1::SYNTHESIS_MODE_UNSPECIFIED:
    case v1::SYNTHESIS_MODE_CORRECTED:
      out.mode = SynthesisMode::kCorrected;
      break;
    case v1::SYNTHESIS_MODE_PUBLISHED:
      out.mode = SynthesisMode::kPublished;
      break;
    default:
      return refuse_choice(field("mode"), options.mode());
  }
  switch (options.channels()) {
    case v1::CHANNEL_LAYOUT_MONO:
      out.channels = ChannelLayout::kMono;
      break;
    case v1::CHANNEL_LAYOUT_UNSPECIFIED:
    case v1::CHANNEL_LAYOUT_STEREO:
      out.channels = ChannelLayout::kStereo;
      break;
    case v1::CHANNEL_LAYOUT_BINAURAL:
      out.channels = ChannelLayout::kBinaural;
      break;
    default:
      return refuse_choice(field("channels"), options.channels());
  }
  switch (options.cloth_features()) {
    case v1::CLOTH_FEATURES_UNSPECIFIED:
    case v1::CLOTH_FEATURES_CAUSAL:
      out.cloth_features = ClothFeatures::kCausal;
      break;
    case v1::CLOTH_FEATURES_SYMMETRIC:
      out.cloth_features = ClothFeatures::kSymmetric;
      break;
    case v1::CLOTH_FEATURES_GLOBAL:
      out.cloth_features = ClothFeatures::kGlobal;
      break;
    default:
      return refuse_choice(field("cloth_features"), options.cloth_features());
  }

  if (const auto good = check_time(options.time_origin_s(), field("time_origin_s"), limits); !good)
    return tl::unexpected(good.error());
  out.time_origin_s = options.time_origin_s();
  if (options.metres_per_unit() != 0) {
    if (const auto good = check_range(options.metres_per_unit(), limits.metres_per_unit_min, limits.metres_per_unit_max,
                                      field("metres_per_unit"), "m");
        !good)
      return tl::unexpected(good.error());
    out.metres_per_unit = options.metres_per_unit();
  }
  out.seed = options.seed();
  if (options.has_playout_delay_s()) {
    if (const auto good = check_range(options.playout_delay_s(), 0, 10, field("playout_delay_s"), "s"); !good)
      return tl::unexpected(good.error());
    out.playout_delay_s = options.playout_delay_s();
  }
  if (options.rate_hz() != 0) {
    if (const auto good = check_range(options.rate_hz(), 8'000, 192'000, field("rate_hz"), "Hz"); !good)
      return tl::unexpected(good.error());
    out.rate_hz = options.rate_hz();
  }
  if (options.block_size() != 0) {
    if (const auto good = check_range(options.block_size(), 16, 8'192, field("block_size"), "samples"); !good)
      return tl::unexpected(good.error());
    out.block_size = options.block_size();
  }
  if (const auto good = check_text(options.default_material(), field("default_material"), limits); !good)
    return tl::unexpected(good.error());
  if (!options.default_material().empty()) out.default_material = options.default_material();
  out.record = options.record();
  if (const auto good = check_text(options.hrtf(), field("hrtf"), limits); !good) return tl::unexpected(good.error());
  out.hrtf = options.hrtf();
  if (options.friction_fft_size() != 0) {
    const std::uint32_t size = options.friction_fft_size();
    if (const auto good = check_range(size, 128, 8'192, field("friction_fft_size"), "samples"); !good)
      return tl::unexpected(good.error());
    if (!std::has_single_bit(size)) {
      return refuse(ErrorCode::kOutOfRange, field("friction_fft_size"),
                    fmt::format("{} is {}, which is no power of two.", field("friction_fft_size"), size),
                    "Send a power of two from 128 to 8192, or 0 for the daemon's choice.");
    }
    out.friction_fft_size = size;
  }
  if (options.most_voices() != 0) {
    if (const auto good = check_range(options.most_voices(), 1, 512, field("most_voices"), "voices"); !good)
      return tl::unexpected(good.error());
    out.most_voices = options.most_voices();
  }
  return out;
}

void to_wire(const session::SessionOptions& options, v1::SessionOptions* out) {
  out->set_clock(options.clock == Clock::kLive ? v1::CLOCK_LIVE : v1::CLOCK_SIMULATION);
  out->set_time_origin_s(options.time_origin_s);
  out->set_metres_per_unit(options.metres_per_unit);
  out->set_up_axis(options.up_axis == UpAxis::kZ ? v1::UP_AXIS_Z : v1::UP_AXIS_Y);
  out->set_seed(options.seed);
  out->set_mode(options.mode == SynthesisMode::kCorrected ? v1::SYNTHESIS_MODE_CORRECTED : v1::SYNTHESIS_MODE_PUBLISHED);
  if (options.playout_delay_s) out->set_playout_delay_s(*options.playout_delay_s);
  out->set_rate_hz(options.rate_hz);
  out->set_block_size(options.block_size);
  switch (options.channels) {
    case ChannelLayout::kMono:
      out->set_channels(v1::CHANNEL_LAYOUT_MONO);
      break;
    case ChannelLayout::kStereo:
      out->set_channels(v1::CHANNEL_LAYOUT_STEREO);
      break;
    case ChannelLayout::kBinaural:
      out->set_channels(v1::CHANNEL_LAYOUT_BINAURAL);
      break;
  }
  switch (options.cloth_features) {
    case ClothFeatures::kCausal:
      out->set_cloth_features(v1::CLOTH_FEATURES_CAUSAL);
      break;
    case ClothFeatures::kSymmetric:
      out->set_cloth_features(v1::CLOTH_FEATURES_SYMMETRIC);
      break;
    case ClothFeatures::kGlobal:
      out->set_cloth_features(v1::CLOTH_FEATURES_GLOBAL);
      break;
  }
  out->set_default_material(options.default_material);
  out->set_record(options.record);
  out->set_hrtf(options.hrtf);
  out->set_friction_fft_size(options.friction_fft_size);
  out->set_most_voices(options.most_voices);
}

}  // namespace rustle::wire
