#include "client_sdk/cpp/stream_messages.h"

#include <bit>

static_assert(std::endian::native == std::endian::little, "arrays are copied as they are: little-endian");

namespace rustle::client::internal {
namespace {

void write(const Vector3& v, v1::Vector3* out) {
  out->set_x(v[0]);
  out->set_y(v[1]);
  out->set_z(v[2]);
}

void write(const Pose& pose, v1::Pose* out) {
  write(pose.position, out->mutable_position());
  v1::Quaternion* q = out->mutable_orientation();
  q->set_w(pose.orientation[0]);
  q->set_x(pose.orientation[1]);
  q->set_y(pose.orientation[2]);
  q->set_z(pose.orientation[3]);
}

struct WriteShape {
  v1::Obstacle& out;

  void operator()(const Plane& plane) const {
    write(plane.point, out.mutable_plane()->mutable_point());
    write(plane.normal, out.mutable_plane()->mutable_normal());
  }
  void operator()(const Box& box) const { write(box.half_extents, out.mutable_box()->mutable_half_extents()); }
  void operator()(const Sphere& sphere) const { out.mutable_sphere()->set_radius(sphere.radius); }
  void operator()(const Capsule& capsule) const {
    out.mutable_capsule()->set_radius(capsule.radius);
    out.mutable_capsule()->set_half_length(capsule.half_length);
  }
  void operator()(const Mesh& mesh) const {
    set_bytes(mesh.triangles, out.mutable_mesh()->mutable_triangles());
    set_bytes(mesh.vertices, out.mutable_mesh()->mutable_vertices());
  }
};

}  // namespace

void write(const SheetOptions& sheet, v1::Sheet* out) {
  out->set_sheet_id(sheet.id);
  out->set_name(sheet.name);
  out->set_kind(sheet.kind == SheetKind::kCloth ? v1::SHEET_KIND_CLOTH : v1::SHEET_KIND_PAPER);
  out->set_material(sheet.material);
  out->set_touched_surface(sheet.touched_surface);
  if (sheet.grammage_kg_per_m2) out->set_grammage_kg_per_m2(*sheet.grammage_kg_per_m2);
  if (sheet.thickness_m) out->set_thickness_m(*sheet.thickness_m);
}

void write(const SessionOptions& options, v1::SessionOptions* out) {
  out->set_clock(options.clock == Clock::kSimulation ? v1::CLOCK_SIMULATION : v1::CLOCK_LIVE);
  out->set_time_origin_s(options.time_origin_s);
  out->set_metres_per_unit(options.metres_per_unit);
  out->set_up_axis(options.up_axis == UpAxis::kY ? v1::UP_AXIS_Y : v1::UP_AXIS_Z);
  out->set_seed(options.seed);
  out->set_mode(options.mode == SynthesisMode::kPublished ? v1::SYNTHESIS_MODE_PUBLISHED : v1::SYNTHESIS_MODE_CORRECTED);
  if (options.playout_delay_s) out->set_playout_delay_s(*options.playout_delay_s);
  out->set_rate_hz(options.rate_hz);
  out->set_block_size(options.block_size);
  switch (options.channels) {
    case Channels::kMono:
      out->set_channels(v1::CHANNEL_LAYOUT_MONO);
      break;
    case Channels::kStereo:
      out->set_channels(v1::CHANNEL_LAYOUT_STEREO);
      break;
    case Channels::kBinaural:
      out->set_channels(v1::CHANNEL_LAYOUT_BINAURAL);
      break;
  }
  out->set_default_material(options.default_material);
  out->set_record(options.record);
  out->set_hrtf(options.hrtf);
  out->set_friction_fft_size(options.friction_fft_size);
  out->set_most_voices(options.most_voices);
}

void read(const v1::SessionOptions& sent, SessionOptions& options) {
  options.clock = sent.clock() == v1::CLOCK_SIMULATION ? Clock::kSimulation : Clock::kLive;
  options.time_origin_s = sent.time_origin_s();
  options.metres_per_unit = sent.metres_per_unit() == 0 ? 1 : sent.metres_per_unit();
  options.up_axis = sent.up_axis() == v1::UP_AXIS_Y ? UpAxis::kY : UpAxis::kZ;
  options.seed = sent.seed();
  options.mode = sent.mode() == v1::SYNTHESIS_MODE_PUBLISHED ? SynthesisMode::kPublished : SynthesisMode::kCorrected;
  options.playout_delay_s = sent.has_playout_delay_s() ? std::optional(sent.playout_delay_s()) : std::nullopt;
  options.rate_hz = sent.rate_hz();
  options.block_size = sent.block_size();
  switch (sent.channels()) {
    case v1::CHANNEL_LAYOUT_MONO:
      options.channels = Channels::kMono;
      break;
    case v1::CHANNEL_LAYOUT_BINAURAL:
      options.channels = Channels::kBinaural;
      break;
    default:
      options.channels = Channels::kStereo;
      break;
  }
  options.default_material = sent.default_material();
  options.record = sent.record();
  options.hrtf = sent.hrtf();
  options.friction_fft_size = sent.friction_fft_size();
  options.most_voices = sent.most_voices();
}

void write(const Topology& topology, v1::Topology* out) {
  out->set_topology_id(topology.id);
  out->set_vertex_count(topology.vertex_count);
  set_bytes(topology.triangles, out->mutable_triangles());
  set_bytes(topology.material_coordinates, out->mutable_material_coordinates());
  set_bytes(topology.rest_positions, out->mutable_rest_positions());
}

void write(const FrameExtras& extras, v1::MeshFrame* out) {
  set_bytes(extras.velocities, out->mutable_velocities());
  set_bytes(extras.anchored, out->mutable_anchored());
  out->set_reset_history(extras.reset_history);
  if (extras.contacts) {
    const Contacts& contacts = *extras.contacts;
    v1::Contacts* sent = out->mutable_contacts();
    set_bytes(contacts.vertices, sent->mutable_vertices());
    set_bytes(contacts.partners, sent->mutable_partners());
    for (const ContactPartner& partner : contacts.partner_table) {
      v1::ContactPartner* entry = sent->add_partner_table();
      if (partner.is_sheet) {
        entry->set_sheet_id(partner.id);
      } else {
        entry->set_obstacle_id(partner.id);
      }
    }
    set_bytes(contacts.slip_velocities, sent->mutable_slip_velocities());
    set_bytes(contacts.normal_forces, sent->mutable_normal_forces());
  }
  if (extras.partition) {
    const Partition& partition = *extras.partition;
    v1::Partition* sent = out->mutable_partition();
    set_bytes(partition.triangle_regions, sent->mutable_triangle_regions());
    set_bytes(partition.region_curved, sent->mutable_region_curved());
    set_bytes(partition.rulings, sent->mutable_rulings());
    set_bytes(partition.ruling_regions, sent->mutable_ruling_regions());
    set_bytes(partition.singular_points, sent->mutable_singular_points());
    set_bytes(partition.singular_on_border, sent->mutable_singular_on_border());
  }
  for (const TearTip& tip : extras.tear_tips) write(tip, out->add_tear_tips());
}

void write(const SceneUpdate& update, v1::SceneUpdate* out) {
  out->set_time_s(update.time_s);
  for (const Obstacle& obstacle : update.obstacles) {
    v1::Obstacle* sent = out->add_obstacles();
    sent->set_obstacle_id(obstacle.id);
    sent->set_name(obstacle.name);
    sent->set_surface_material(obstacle.surface_material);
    sent->set_reflecting(obstacle.reflecting);
    sent->set_reflection_coefficient(obstacle.reflection_coefficient);
    std::visit(WriteShape{*sent}, obstacle.shape);
    write(obstacle.pose, sent->mutable_pose());
  }
  for (const auto& [id, pose] : update.poses) {
    v1::ObstaclePose* sent = out->add_poses();
    sent->set_obstacle_id(id);
    write(pose, sent->mutable_pose());
  }
  for (const auto& [id, vertices] : update.vertices) {
    v1::ObstacleVertices* sent = out->add_vertices();
    sent->set_obstacle_id(id);
    set_bytes(vertices, sent->mutable_vertices());
  }
  for (const std::uint32_t id : update.removed) out->add_removed_obstacle_ids(id);
}

void write(const Listener& listener, v1::Listener* out) {
  out->set_time_s(listener.time_s);
  write(listener.position, out->mutable_position());
  if (listener.forward) write(*listener.forward, out->mutable_forward());
  if (listener.up) write(*listener.up, out->mutable_up());
}

void write(const TearTip& tip, v1::TearTip* out) {
  out->set_tip_id(tip.id);
  write(tip.position, out->mutable_position());
  out->set_speed(tip.speed);
  if (tip.direction) write(*tip.direction, out->mutable_direction());
}

Notice read(const v1::Notice& notice) {
  NoticeLevel level = NoticeLevel::kInfo;
  if (notice.level() == v1::NOTICE_LEVEL_WARNING) level = NoticeLevel::kWarning;
  if (notice.level() == v1::NOTICE_LEVEL_ERROR) level = NoticeLevel::kError;
  return {.level = level,
          .code = notice.code(),
          .field = notice.field(),
          .message = notice.message(),
          .remedy = notice.remedy(),
          .sequence = notice.sequence(),
          .count = notice.count()};
}

}  // namespace rustle::client::internal
