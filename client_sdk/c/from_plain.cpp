#include "client_sdk/c/from_plain.h"

#include <algorithm>
#include <cmath>

#include "client_sdk/c/status.h"

namespace rustle::capi {
namespace {

/// Whether a number from another language is one of an enumeration that counts from 0.
template <typename Enumeration>
Read<void> check(Enumeration value, Enumeration last, const char* field) {
  const auto number = static_cast<long long>(value), most = static_cast<long long>(last);
  if (number >= 0 && number <= most) return {};
  return tl::unexpected(invalid(field, "It is " + std::to_string(number) + ".",
                                "Give a constant of rustle.h, 0 to " + std::to_string(most) + "."));
}

/// Entries of an array that may be NULL where it has none.
template <typename T>
Read<std::span<const T>> entries(const T* array, std::size_t count, const char* field) {
  if (array != nullptr) return std::span(array, count);
  if (count == 0) return std::span<const T>();
  return tl::unexpected(
      invalid(field, "It is NULL; " + std::to_string(count) + " numbers are announced.", "Give the array, or 0 entries."));
}

template <typename T>
std::span<const T> if_there(const T* array, std::size_t count) {
  return array == nullptr ? std::span<const T>() : std::span(array, count);
}

bool is_zero(std::span<const double> numbers) {
  return std::ranges::all_of(numbers, [](double x) { return x == 0; });
}

std::optional<double> unless_zero(double value) {
  return value == 0 ? std::nullopt : std::optional(value);
}

client::SoundKind sound_kind(rustle_sound_kind kind) {
  if (kind == RUSTLE_FRICTION) return client::SoundKind::kFriction;
  return kind == RUSTLE_TEARING ? client::SoundKind::kTearing : client::SoundKind::kCrumpling;
}

Read<client::Contacts> read(const rustle_contacts& contacts) {
  const auto vertices = entries(contacts.vertices, contacts.count, "frame.contacts.vertices");
  if (!vertices) return tl::unexpected(vertices.error());
  const auto partners = entries(contacts.partners, contacts.count, "frame.contacts.partners");
  if (!partners) return tl::unexpected(partners.error());
  const auto table = entries(contacts.partner_table, contacts.partner_count, "frame.contacts.partner_table");
  if (!table) return tl::unexpected(table.error());
  client::Contacts out{.vertices = *vertices,
                       .partners = *partners,
                       .slip_velocities = if_there(contacts.slip_velocities, 3 * contacts.count),
                       .normal_forces = if_there(contacts.normal_forces, contacts.count)};
  for (const rustle_contact_partner& partner : *table) out.partner_table.push_back({partner.is_sheet != 0, partner.id});
  return out;
}

Read<client::Partition> read(const rustle_partition& partition) {
  const auto triangles = entries(partition.triangle_regions, partition.triangle_count, "frame.partition.triangle_regions");
  if (!triangles) return tl::unexpected(triangles.error());
  const auto curved = entries(partition.region_curved, partition.region_count, "frame.partition.region_curved");
  if (!curved) return tl::unexpected(curved.error());
  const auto rulings = entries(partition.rulings, 6 * partition.ruling_count, "frame.partition.rulings");
  if (!rulings) return tl::unexpected(rulings.error());
  const auto regions = entries(partition.ruling_regions, partition.ruling_count, "frame.partition.ruling_regions");
  if (!regions) return tl::unexpected(regions.error());
  const auto points = entries(partition.singular_points, 3 * partition.singular_count, "frame.partition.singular_points");
  if (!points) return tl::unexpected(points.error());
  return client::Partition{.triangle_regions = *triangles,
                           .region_curved = *curved,
                           .rulings = *rulings,
                           .ruling_regions = *regions,
                           .singular_points = *points,
                           .singular_on_border = if_there(partition.singular_on_border, partition.singular_count)};
}

}  // namespace

std::chrono::milliseconds milliseconds(double seconds) {
  constexpr double kMost_s = 1e9;
  return std::chrono::milliseconds(seconds > 0 ? static_cast<std::int64_t>(std::ceil(1000 * std::min(seconds, kMost_s)))
                                               : 0);
}

client::Vector3 read(const double vector[3]) {
  return {vector[0], vector[1], vector[2]};
}

client::Pose read(const rustle_pose& pose) {
  const auto& q = pose.orientation;
  return {.position = read(pose.position),
          .orientation = is_zero(q) ? client::Quaternion{1, 0, 0, 0} : client::Quaternion{q[0], q[1], q[2], q[3]}};
}

client::TearTip read(const rustle_tear_tip& tip) {
  client::TearTip out{.id = tip.id, .position = read(tip.position), .speed = tip.speed};
  if (tip.has_direction != 0) out.direction = read(tip.direction);
  return out;
}

Read<client::SheetOptions> read(const rustle_sheet& sheet) {
  if (auto known = check(sheet.kind, RUSTLE_CLOTH, "sheet.kind"); !known) return tl::unexpected(std::move(known.error()));
  return client::SheetOptions{.id = sheet.id,
                              .name = text(sheet.name),
                              .kind = sheet.kind == RUSTLE_CLOTH ? client::SheetKind::kCloth : client::SheetKind::kPaper,
                              .material = text(sheet.material),
                              .touched_surface = text(sheet.touched_surface),
                              .grammage_kg_per_m2 = unless_zero(sheet.grammage_kg_per_m2),
                              .thickness_m = unless_zero(sheet.thickness_m)};
}

Read<client::SessionOptions> read(const rustle_session_options& options) {
  for (auto& known :
       {check(options.clock, RUSTLE_CLOCK_SIMULATION, "options.clock"),
        check(options.up_axis, RUSTLE_UP_Y, "options.up_axis"), check(options.channels, RUSTLE_BINAURAL, "options.channels"),
        check(options.reconnect, RUSTLE_RECONNECT_NEVER, "options.reconnect")})
    if (!known) return tl::unexpected(known.error());
  constexpr client::Channels kChannels[] = {client::Channels::kStereo, client::Channels::kMono, client::Channels::kBinaural};
  client::SessionOptions out{
      .name = text(options.name),
      .clock = options.clock == RUSTLE_CLOCK_SIMULATION ? client::Clock::kSimulation : client::Clock::kLive,
      .time_origin_s = options.time_origin_s,
      .metres_per_unit = options.metres_per_unit == 0 ? 1 : options.metres_per_unit,
      .up_axis = options.up_axis == RUSTLE_UP_Y ? client::UpAxis::kY : client::UpAxis::kZ,
      .seed = options.seed,
      .mode = options.published_formulas != 0 ? client::SynthesisMode::kPublished : client::SynthesisMode::kCorrected,
      .rate_hz = options.rate_hz,
      .block_size = options.block_size,
      .channels = kChannels[options.channels],
      .default_material = text(options.default_material),
      .record = options.record != 0,
      .hrtf = text(options.hrtf),
      .friction_fft_size = options.friction_fft_size,
      .most_voices = options.most_voices};
  if (options.sets_playout_delay != 0) out.playout_delay_s = options.playout_delay_s;
  const auto sheets = entries(options.sheets, options.sheet_count, "options.sheets");
  if (!sheets) return tl::unexpected(sheets.error());
  for (const rustle_sheet& sheet : *sheets) {
    auto read_sheet = read(sheet);
    if (!read_sheet) return tl::unexpected(std::move(read_sheet.error()));
    out.sheets.push_back(std::move(*read_sheet));
  }
  return out;
}

Read<client::ListenOptions> read(const rustle_listen_options* options) {
  client::ListenOptions out;
  if (options == nullptr) return out;
  for (auto& known : {check(options->content, RUSTLE_EMITTERS, "options.content"),
                      check(options->stem_kind, RUSTLE_TEARING, "options.stem_kind"),
                      check(options->format, RUSTLE_OPUS, "options.format")})
    if (!known) return tl::unexpected(known.error());
  if (options->content == RUSTLE_EMITTERS) out.content = client::EmitterContent{};
  if (options->content == RUSTLE_STEM) {
    if (options->stem_kind == RUSTLE_EVERY_KIND)
      return tl::unexpected(
          invalid("options.stem_kind", "A stem is of one kind of sound.", "Give RUSTLE_CRUMPLING or another."));
    out.content = client::StemContent{options->stem_sheet_id, sound_kind(options->stem_kind)};
  }
  constexpr client::SampleFormat kFormats[] = {client::SampleFormat::kF32, client::SampleFormat::kS16,
                                               client::SampleFormat::kOpus};
  out.format = kFormats[options->format];
  if (options->blocks != 0) out.blocks = options->blocks;
  if (options->queue_messages != 0) out.queue_messages = std::max(0, options->queue_messages);
  return out;
}

Read<client::Topology> read(const rustle_topology& topology) {
  const auto triangles = entries(topology.triangles, 3 * topology.triangle_count, "topology.triangles");
  if (!triangles) return tl::unexpected(triangles.error());
  const std::size_t vertices = topology.vertex_count;
  return client::Topology{.id = topology.id,
                          .vertex_count = topology.vertex_count,
                          .triangles = *triangles,
                          .material_coordinates = if_there(topology.material_coordinates, 2 * vertices),
                          .rest_positions = if_there(topology.rest_positions, 3 * vertices)};
}

Read<void> read(const rustle_mesh_frame& frame, std::size_t vertex_count, client::FrameExtras& extras,
                std::vector<client::TearTip>& tips) {
  extras.velocities = if_there(frame.velocities, 3 * vertex_count);
  extras.anchored = if_there(frame.anchored, vertex_count);
  extras.reset_history = frame.reset_history != 0;
  if (frame.contacts != nullptr) {
    auto contacts = read(*frame.contacts);
    if (!contacts) return tl::unexpected(std::move(contacts.error()));
    extras.contacts.emplace(std::move(*contacts));
  }
  if (frame.partition != nullptr) {
    const auto partition = read(*frame.partition);
    if (!partition) return tl::unexpected(partition.error());
    extras.partition = *partition;
  }
  const auto sent_tips = entries(frame.tear_tips, frame.tear_tip_count, "frame.tear_tips");
  if (!sent_tips) return tl::unexpected(sent_tips.error());
  for (const rustle_tear_tip& tip : *sent_tips) tips.push_back(read(tip));
  extras.tear_tips = tips;
  return {};
}

Read<client::Obstacle> read(const rustle_obstacle& obstacle) {
  if (auto known = check(obstacle.shape, RUSTLE_MESH, "obstacle.shape"); !known)
    return tl::unexpected(std::move(known.error()));
  client::Obstacle out{.id = obstacle.id,
                       .name = text(obstacle.name),
                       .surface_material = text(obstacle.surface_material),
                       .reflecting = obstacle.reflecting != 0,
                       .reflection_coefficient = obstacle.reflection_coefficient == 0 ? 1 : obstacle.reflection_coefficient,
                       .pose = read(obstacle.pose)};
  switch (obstacle.shape) {
    case RUSTLE_PLANE:
      out.shape = is_zero(obstacle.normal) ? client::Plane{} : client::Plane{.normal = read(obstacle.normal)};
      break;
    case RUSTLE_BOX:
      out.shape = client::Box{read(obstacle.half_extents)};
      break;
    case RUSTLE_SPHERE:
      out.shape = client::Sphere{obstacle.radius};
      break;
    case RUSTLE_CAPSULE:
      out.shape = client::Capsule{.radius = obstacle.radius, .half_length = obstacle.half_length};
      break;
    case RUSTLE_MESH: {
      const auto triangles = entries(obstacle.triangles, 3 * obstacle.triangle_count, "obstacle.triangles");
      if (!triangles) return tl::unexpected(triangles.error());
      const auto vertices = entries(obstacle.vertices, 3 * obstacle.vertex_count, "obstacle.vertices");
      if (!vertices) return tl::unexpected(vertices.error());
      out.shape = client::Mesh{.triangles = *triangles, .vertices = *vertices};
      break;
    }
  }
  return out;
}

Read<client::Gain> read(const rustle_gain& gain) {
  if (auto known = check(gain.kind, RUSTLE_TEARING, "gain.kind"); !known) return tl::unexpected(std::move(known.error()));
  client::Gain out{.gain_db = gain.gain_db, .material = text(gain.material)};
  if (gain.of_one_sheet != 0) out.sheet_id = gain.sheet_id;
  if (gain.kind != RUSTLE_EVERY_KIND) out.kind = sound_kind(gain.kind);
  return out;
}

}  // namespace rustle::capi
