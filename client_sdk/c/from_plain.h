#pragma once

#include <chrono>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/c/rustle.h"
#include "client_sdk/cpp/pcm_reader.h"
#include "client_sdk/cpp/types.h"

/// The structs of C as those of C++, which point into the same arrays. Pure. Not for applications.
/// Errors: "invalid", where a number is none of its enumeration, or an array is NULL that should have entries.
namespace rustle::capi {

template <typename T>
using Read = tl::expected<T, client::Error>;

inline std::string text(const char* text) {
  return text == nullptr ? std::string() : std::string(text);
}
/// From 0 to about thirty years; what is no number is 0.
std::chrono::milliseconds milliseconds(double seconds);

Read<client::SheetOptions> read(const rustle_sheet& sheet);
Read<client::SessionOptions> read(const rustle_session_options& options);
/// `options` NULL: the mix.
Read<client::ListenOptions> read(const rustle_listen_options* options);
Read<client::Topology> read(const rustle_topology& topology);
/// The tear tips, which FrameExtras only points to, are put into `tips`.
Read<void> read(const rustle_mesh_frame& frame, std::size_t vertex_count, client::FrameExtras& extras,
                std::vector<client::TearTip>& tips);
Read<client::Obstacle> read(const rustle_obstacle& obstacle);
Read<client::Gain> read(const rustle_gain& gain);
client::TearTip read(const rustle_tear_tip& tip);
client::Pose read(const rustle_pose& pose);
client::Vector3 read(const double vector[3]);

}  // namespace rustle::capi
