#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "server/engine/stream_item.h"
#include "server/session/session_options.h"
#include "server/wire/error.h"
#include "server/wire/limits.h"
#include "server/wire/stream_envelope.h"

namespace rustle::v1 {
class MeshFrame;
class Contacts;
class Obstacle;
class Partition;
class Pose;
class SceneUpdate;
class Sheet;
class TearTip;
class TearTips;
class Topology;
}  // namespace rustle::v1

namespace rustle::wire {

/// A stream message as the engine takes it. Without an item: it was kept here (a topology), says nothing new (a sheet
/// described again in the same words, an advance to an earlier time), or is no matter of the engine's (an announcement).
struct Decoded {
  std::uint64_t sequence = 0;
  double sent_at_s = 0;
  std::optional<engine::StreamItem> item;
};

/// The sheet descriptions of Attach and of the stream, checked.
/// Errors: TOO_LARGE, MALFORMED (texts), UNSUPPORTED (kind), NOT_FINITE, OUT_OF_RANGE (grammage 1e-4 to 100 kg/m², thickness
/// 1e-7 to 0.1 m). `prefix` such as "sheet" or "attach.sheets[2]".
[[nodiscard]] tl::expected<engine::SheetDescription, Error> decode_sheet(const v1::Sheet& sheet, std::string_view prefix,
                                                                         const Limits& limits);

/// One session's stream, from messages to the engine's input: metres, seconds, z up. Holds the session's topologies, and
/// knows its sheets and obstacles, so that everything it returns refers to things that exist.
///
/// Conversion: lengths times metres_per_unit (material coordinates, rest positions, velocities, slip velocities and the tear
/// tips' speed too); with y up (x, y, z) -> (x, -z, y). Obstacle shapes stay in their own frame, whose orientation is
/// turned, so that "its own z" means what the sender means by it. A plane's point and normal are taken into its pose.
///
/// Times: a sheet's frames increase; its tear tips, and the session's scene and listener updates, do not decrease. Nothing
/// but announcements follows the end.
///
/// A refused message changes nothing. One thread at a time.
class Decoder {
 public:
  explicit Decoder(const session::SessionOptions& options, const Limits& limits = {});
  ~Decoder();
  Decoder(Decoder&&) noexcept;
  Decoder& operator=(Decoder&&) noexcept;

  /// A sheet of Attach. Error: TOO_LARGE beyond `limits.sheets`.
  [[nodiscard]] tl::expected<void, Error> add_sheet(const engine::SheetDescription& sheet);

  /// O(bytes). Errors as the fields have them, `sequence` set.
  [[nodiscard]] tl::expected<Decoded, Error> decode(const StreamEnvelope& envelope);

  std::size_t sheet_count() const { return sheets_.size(); }
  std::vector<sheet::SheetId> sheet_ids() const;
  /// A sheet as described, and as changed since. Null: it was never described.
  const engine::SheetDescription* find_sheet(sheet::SheetId id) const;
  /// The sheet was given another material or touched surface by control; a description in the words of the last one does
  /// not undo it.
  void change_pack(const engine::PackChange& change);

  /// Of the meshes that its sheets have now, or would have if this message, a frame, were taken.
  std::size_t triangles_in_use() const;
  std::size_t triangles_in_use_with(const StreamEnvelope& frame) const;

  std::size_t topology_count() const { return topologies_.size(); }
  std::size_t obstacle_count() const { return obstacles_.size(); }

 private:
  using Item = tl::expected<std::optional<engine::StreamItem>, Error>;

  struct KnownSheet {
    engine::SheetDescription description;  ///< as sent last
    engine::SheetDescription now;          ///< and as changed since
    std::optional<double> newest_frame_s;
    std::optional<double> newest_tips_s;
    std::uint64_t topology_id = 0;
    bool has_topology = false;
  };
  struct KnownTopology {
    std::shared_ptr<const sheet::Topology> topology;
    std::uint64_t last_use = 0;
    bool used = false;
    std::size_t current_of_sheets = 0;
  };
  struct KnownObstacle {
    std::size_t vertex_count = 0;    ///< of a mesh; 0: no mesh
    std::size_t triangle_count = 0;  ///< of a mesh
    scene::Pose shape_in_frame;      ///< identity but for planes
  };

  Item decode_body(const StreamEnvelope& envelope);
  Item describe_sheet(const v1::Sheet& sent);
  Item keep_topology(const v1::Topology& sent);
  Item decode_frame(const v1::MeshFrame& sent);
  Item decode_scene(const v1::SceneUpdate& sent);
  Item decode_tear_tips(const v1::TearTips& sent);
  tl::expected<std::vector<sheet::SentContact>, Error> decode_contacts(const v1::Contacts& sent, std::size_t vertices) const;
  tl::expected<sheet::SentPartition, Error> decode_partition(const v1::Partition& sent, std::size_t triangles) const;
  template <class Tips>
  tl::expected<std::vector<sheet::SentTearTip>, Error> decode_tips(const Tips& sent, const std::string& field) const;
  tl::expected<scene::Pose, Error> decode_pose(const v1::Pose* sent, const std::string& field,
                                               const scene::Pose& shape_in_frame) const;
  struct NewObstacle {
    scene::Obstacle obstacle;
    KnownObstacle known;
  };
  tl::expected<NewObstacle, Error> decode_obstacle(const v1::Obstacle& sent, const std::string& field) const;
  tl::expected<KnownSheet*, Error> find_sheet(std::uint32_t id, std::string_view field);
  void use_topology(KnownSheet& sheet, std::uint64_t id);
  void drop_old_topologies();

  Limits limits_;
  double metres_per_unit_ = 1;
  bool y_up_ = false;
  std::map<sheet::SheetId, KnownSheet> sheets_;
  std::map<std::uint64_t, KnownTopology> topologies_;
  std::map<sheet::ObstacleId, KnownObstacle> obstacles_;
  std::uint64_t topology_clock_ = 0;
  std::optional<double> newest_scene_s_, newest_listener_s_, newest_advance_s_;
  bool ended_ = false;
};

}  // namespace rustle::wire
