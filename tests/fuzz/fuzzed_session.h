#pragma once

#include <stdlib.h>

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "rustle/v1/session.pb.h"
#include "server/engine/ingest.h"
#include "server/session/settled_options.h"
#include "server/synthesis/material.h"
#include "server/wire/decode.h"
#include "sound_db/pack/write.h"
#include "tests/fuzz/target.h"
#include "tests/unit/pack/example_pack.h"

namespace rustle::fuzz {

/// Sheet 1 with topology 7, a mesh obstacle 5 and a plane 6: what messages may refer to.
inline std::vector<std::string> opening() {
  const auto floats = [](std::initializer_list<float> values) {
    return std::string(reinterpret_cast<const char*>(values.begin()), values.size() * sizeof(float));
  };
  const std::uint32_t triangles[] = {0, 1, 2, 0, 2, 3};
  const std::string indices(reinterpret_cast<const char*>(triangles), sizeof(triangles));
  std::vector<std::string> out;
  v1::StreamMessage message;
  message.set_session_id("s");
  message.mutable_sheet()->set_sheet_id(1);
  out.push_back(message.SerializeAsString());
  auto* topology = message.mutable_topology();
  topology->set_topology_id(7);
  topology->set_vertex_count(4);
  topology->set_triangles(indices);
  topology->set_material_coordinates(floats({0, 0, 0.1f, 0, 0.1f, 0.1f, 0, 0.1f}));
  out.push_back(message.SerializeAsString());
  auto* scene = message.mutable_scene();
  auto* mesh = scene->add_obstacles();
  mesh->set_obstacle_id(5);
  mesh->mutable_mesh()->set_triangles(indices);
  mesh->mutable_mesh()->set_vertices(floats({-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0}));
  auto* plane = scene->add_obstacles();
  plane->set_obstacle_id(6);
  plane->mutable_plane();
  plane->set_reflecting(true);
  out.push_back(message.SerializeAsString());
  return out;
}

/// A session as the daemon has it, without threads and without rendering: messages are decoded, analysed and planned.
class FuzzedSession {
 public:
  explicit FuzzedSession(const session::SessionOptions& options = {})
      : decoder_(options), ingest_(session::engine_options(session::settled(options), nullptr), packs()) {
    static const std::vector<std::string> messages = opening();
    for (const std::string& message : messages) take(message);
  }

  /// True: the message got as far as the engine.
  bool take(std::string_view bytes) {
    const auto envelope = wire::StreamEnvelope::parse(std::as_bytes(std::span(bytes)), "s");
    if (!envelope) return false;
    const auto decoded = decoder_.decode(*envelope);
    if (!decoded || !decoded->item) return false;
    give(*decoded->item);
    return true;
  }
  void give(const engine::StreamItem& item) {
    engine::CueBatch batch;
    static_cast<void>(ingest_.accept(item, batch));
  }
  wire::Decoder& decoder() { return decoder_; }

 private:
  /// One small pack, called as the default one is; it is read, and made ready for a session, once.
  static std::shared_ptr<pack::PackLibrary> packs() {
    static const auto library = [] {
      static const pack::TemporaryFolder folder;
      auto example = pack::example_pack();
      example.material = "printer-paper";
      example.touched_surface = "wooden-table";
      require(pack::write(example, folder.path() / "pack").has_value());
      return std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{folder.path()});
    }();
    static const auto held = [] {
      const auto pack = library->load("printer-paper", "wooden-table", 48000);
      require(pack.has_value());
      return synthesis::shared_material(*pack, 48000);
    }();
    return library;
  }

  wire::Decoder decoder_;
  engine::Ingest ingest_;
};

}  // namespace rustle::fuzz
