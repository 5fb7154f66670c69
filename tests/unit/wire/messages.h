#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "rustle/v1/session.pb.h"
#include "server/wire/decode.h"
#include "server/wire/stream_envelope.h"

/// Small messages of a two-triangle sheet, and the shortest way through envelope and decoder.
namespace rustle::wire::test {

inline std::span<const std::byte> as_bytes(const std::string& text) {
  return std::as_bytes(std::span(text));
}

template <class T>
std::string pack(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

inline constexpr std::uint32_t kVertices = 4;
inline const std::vector<std::uint32_t> kTriangles = {0, 1, 2, 0, 2, 3};
inline const std::vector<float> kPositions = {0, 0, 0, 1, 0, 0.5f, 1, 2, 0.25f, 0, 2, -1};

inline v1::StreamMessage message(std::uint64_t sequence = 0) {
  v1::StreamMessage out;
  out.set_session_id("s");
  out.set_sequence(sequence);
  return out;
}

inline v1::StreamMessage sheet_message(std::uint32_t id = 1) {
  auto out = message();
  out.mutable_sheet()->set_sheet_id(id);
  out.mutable_sheet()->set_material("printer-paper");
  return out;
}

inline v1::StreamMessage topology_message(std::uint64_t id = 7) {
  auto out = message();
  auto* topology = out.mutable_topology();
  topology->set_topology_id(id);
  topology->set_vertex_count(kVertices);
  topology->set_triangles(pack(kTriangles));
  return out;
}

inline v1::StreamMessage frame_message(double time_s = 0, std::uint64_t topology_id = 7, std::uint32_t sheet_id = 1) {
  auto out = message();
  auto* frame = out.mutable_frame();
  frame->set_sheet_id(sheet_id);
  frame->set_topology_id(topology_id);
  frame->set_time_s(time_s);
  frame->set_positions(pack(kPositions));
  return out;
}

inline v1::Obstacle* add_obstacle(v1::StreamMessage& scene, std::uint32_t id) {
  auto* obstacle = scene.mutable_scene()->add_obstacles();
  obstacle->set_obstacle_id(id);
  return obstacle;
}

inline v1::StreamMessage mesh_obstacle_message(std::uint32_t id = 5) {
  auto out = message();
  auto* mesh = add_obstacle(out, id)->mutable_mesh();
  mesh->set_triangles(pack(kTriangles));
  mesh->set_vertices(pack(kPositions));
  return out;
}

inline void set(v1::Vector3* v, double x, double y, double z) {
  v->set_x(x);
  v->set_y(y);
  v->set_z(z);
}

inline tl::expected<Decoded, Error> decode(Decoder& decoder, const v1::StreamMessage& sent, const Limits& limits = {}) {
  const std::string bytes = sent.SerializeAsString();
  const auto envelope = StreamEnvelope::parse(as_bytes(bytes), "", limits);
  if (!envelope) return tl::unexpected(envelope.error());
  return decoder.decode(*envelope);
}

/// A decoder that knows sheet 1 and topology 7.
inline Decoder ready(const session::SessionOptions& options = {}, const Limits& limits = {}) {
  Decoder decoder(options, limits);
  static_cast<void>(decode(decoder, sheet_message()));
  static_cast<void>(decode(decoder, topology_message()));
  return decoder;
}

template <class Item>
const Item& item_of(const tl::expected<Decoded, Error>& decoded) {
  return std::get<Item>(decoded.value().item.value());
}

}  // namespace rustle::wire::test
