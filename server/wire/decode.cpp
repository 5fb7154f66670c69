#include "server/wire/decode.h"

#include <algorithm>
#include <cstring>

#include <fmt/format.h>

#include "rustle/v1/session.pb.h"
#include "server/wire/fields.h"

namespace rustle::wire {

using sheet::Vec2f;
using sheet::Vec3d;
using sheet::Vec3f;

namespace {

tl::unexpected<Error> refuse_order(std::string_view field, double time_s, double newest_s, std::string_view rule) {
  return refuse(ErrorCode::kTimeOrder, field,
                fmt::format("{} is {} s, after {} s was taken; {}.", field, time_s, newest_s, rule),
                "Send in the order of time; to begin anew, attach a new session.");
}

bool same_description(const engine::SheetDescription& a, const engine::SheetDescription& b) {
  return a.name == b.name && a.kind == b.kind && a.material == b.material && a.touched_surface == b.touched_surface &&
         a.grammage_kg_per_m2 == b.grammage_kg_per_m2 && a.thickness_m == b.thickness_m;
}

}  // namespace

tl::expected<engine::SheetDescription, Error> decode_sheet(const v1::Sheet& sent, std::string_view prefix,
                                                           const Limits& limits) {
  const auto field = [prefix](std::string_view name) { return fmt::format("{}.{}", prefix, name); };
  engine::SheetDescription out;
  out.id = sent.sheet_id();
  for (const auto& [text, name] : {std::pair<const std::string&, std::string_view>{sent.name(), "name"},
                                   {sent.material(), "material"},
                                   {sent.touched_surface(), "touched_surface"}})
    if (const auto good = check_text(text, field(name), limits); !good) return tl::unexpected(good.error());
  out.name = sent.name();
  out.material = sent.material();
  out.touched_surface = sent.touched_surface();
  switch (sent.kind()) {
    case v1::SHEET_KIND_UNSPECIFIED:
    case v1::SHEET_KIND_PAPER:
      out.kind = engine::SheetKind::kPaper;
      break;
    case v1::SHEET_KIND_CLOTH:
      out.kind = engine::SheetKind::kCloth;
      break;
    default:
      return refuse(ErrorCode::kUnsupported, field("kind"), fmt::format("{} is {}.", field("kind"), int{sent.kind()}),
                    "Choose paper or cloth.");
  }
  if (sent.has_grammage_kg_per_m2()) {
    if (const auto good = check_range(sent.grammage_kg_per_m2(), 1e-4, 100, field("grammage_kg_per_m2"), "kg/m²"); !good)
      return tl::unexpected(good.error());
    out.grammage_kg_per_m2 = sent.grammage_kg_per_m2();
  }
  if (sent.has_thickness_m()) {
    if (const auto good = check_range(sent.thickness_m(), 1e-7, 0.1, field("thickness_m"), "m"); !good)
      return tl::unexpected(good.error());
    out.thickness_m = sent.thickness_m();
  }
  return out;
}

Decoder::Decoder(const session::SessionOptions& options, const Limits& limits)
    : limits_(limits), metres_per_unit_(options.metres_per_unit), y_up_(options.up_axis == session::UpAxis::kY) {}
Decoder::~Decoder() = default;
Decoder::Decoder(Decoder&&) noexcept = default;
Decoder& Decoder::operator=(Decoder&&) noexcept = default;

tl::expected<void, Error> Decoder::add_sheet(const engine::SheetDescription& sheet) {
  const auto known = sheets_.find(sheet.id);
  if (known == sheets_.end() && sheets_.size() >= limits_.sheets)
    return refuse(ErrorCode::kTooLarge, "sheet.sheet_id",
                  fmt::format("Sheet {} would be one more than the {} a session may have.", sheet.id, limits_.sheets),
                  "Reuse sheet ids, or attach another session.");
  KnownSheet& added = sheets_[sheet.id];
  added.description = added.now = sheet;
  return {};
}

tl::expected<Decoded, Error> Decoder::decode(const StreamEnvelope& envelope) {
  auto item = decode_body(envelope);
  if (!item) {
    item.error().sequence = envelope.sequence();
    return tl::unexpected(std::move(item.error()));
  }
  return Decoded{.sequence = envelope.sequence(), .sent_at_s = envelope.sent_at_s(), .item = std::move(*item)};
}

Decoder::Item Decoder::decode_body(const StreamEnvelope& envelope) {
  using Body = StreamEnvelope::Body;
  const v1::StreamMessage& message = envelope.message();
  if (envelope.body() == Body::kAnnouncement) return std::nullopt;
  if (ended_)
    return refuse(ErrorCode::kTimeOrder, "body", "The session has ended; nothing is taken after its end.",
                  "Attach a new session.");
  switch (envelope.body()) {
    case Body::kAnnouncement:
      return std::nullopt;
    case Body::kSheet:
      return describe_sheet(message.sheet());
    case Body::kTopology:
      return keep_topology(message.topology());
    case Body::kFrame:
      return decode_frame(message.frame());
    case Body::kScene:
      return decode_scene(message.scene());
    case Body::kTearTips:
      return decode_tear_tips(message.tear_tips());
    case Body::kListener: {
      const v1::Listener& sent = message.listener();
      if (const auto good = check_time(sent.time_s(), "listener.time_s", limits_); !good)
        return tl::unexpected(good.error());
      if (newest_listener_s_ && sent.time_s() < *newest_listener_s_)
        return refuse_order("listener.time_s", sent.time_s(), *newest_listener_s_, "listener times do not decrease");
      if (!sent.has_position())
        return refuse(ErrorCode::kMalformed, "listener.position", "The listener has no position.", "Send its position.");
      const auto position =
          read_vector(sent.position(), metres_per_unit_, y_up_, limits_.position_m, "listener.position", "m");
      if (!position) return tl::unexpected(position.error());
      const auto forward = read_direction(sent.forward(), y_up_, "listener.forward");
      if (!forward) return tl::unexpected(forward.error());
      const auto up = read_direction(sent.up(), y_up_, "listener.up");
      if (!up) return tl::unexpected(up.error());
      scene::Listener listener{.time_s = sent.time_s(), .position_m = *position, .forward = {}, .up = Vec3d::UnitZ()};
      if (!forward->isZero(0)) listener.forward = *forward;
      if (!up->isZero(0)) listener.up = *up;
      newest_listener_s_ = sent.time_s();
      return engine::StreamItem(listener);
    }
    case Body::kAdvance: {
      const double time_s = message.advance().time_s();
      if (const auto good = check_time(time_s, "advance.time_s", limits_); !good) return tl::unexpected(good.error());
      if (newest_advance_s_ && time_s <= *newest_advance_s_) return std::nullopt;
      newest_advance_s_ = time_s;
      return engine::StreamItem(engine::Advance{.time_s = time_s});
    }
    case Body::kEnd: {
      const double time_s = message.end().time_s();
      if (const auto good = check_time(time_s, "end.time_s", limits_); !good) return tl::unexpected(good.error());
      ended_ = true;
      return engine::StreamItem(engine::End{.time_s = time_s == 0 ? std::nullopt : std::optional(time_s)});
    }
  }
  return std::nullopt;
}

std::vector<sheet::SheetId> Decoder::sheet_ids() const {
  std::vector<sheet::SheetId> ids;
  for (const auto& [id, known] : sheets_) ids.push_back(id);
  return ids;
}

const engine::SheetDescription* Decoder::find_sheet(sheet::SheetId id) const {
  const auto known = sheets_.find(id);
  return known == sheets_.end() ? nullptr : &known->second.now;
}

std::size_t Decoder::triangles_in_use() const {
  std::size_t triangles = 0;
  for (const auto& [id, known] : sheets_)
    if (known.has_topology) triangles += topologies_.at(known.topology_id).topology->triangle_count();
  return triangles;
}

std::size_t Decoder::triangles_in_use_with(const StreamEnvelope& frame) const {
  const v1::MeshFrame& sent = frame.message().frame();
  std::size_t triangles = triangles_in_use();
  const auto next = topologies_.find(sent.topology_id());
  const auto sheet = sheets_.find(sent.sheet_id());
  if (next == topologies_.end() || sheet == sheets_.end()) return triangles;
  if (sheet->second.has_topology) triangles -= topologies_.at(sheet->second.topology_id).topology->triangle_count();
  return triangles + next->second.topology->triangle_count();
}

void Decoder::change_pack(const engine::PackChange& change) {
  const auto known = sheets_.find(change.sheet);
  if (known == sheets_.end()) return;
  if (!change.material.empty()) known->second.now.material = change.material;
  if (!change.touched_surface.empty()) known->second.now.touched_surface = change.touched_surface;
}

Decoder::Item Decoder::describe_sheet(const v1::Sheet& sent) {
  auto sheet = decode_sheet(sent, "sheet", limits_);
  if (!sheet) return tl::unexpected(std::move(sheet.error()));
  const auto known = sheets_.find(sheet->id);
  if (known != sheets_.end() && same_description(known->second.description, *sheet)) return std::nullopt;
  if (const auto added = add_sheet(*sheet); !added) return tl::unexpected(added.error());
  return engine::StreamItem(std::move(*sheet));
}

Decoder::Item Decoder::keep_topology(const v1::Topology& sent) {
  const std::size_t vertices = sent.vertex_count();
  if (vertices > limits_.vertices)
    return refuse(
        ErrorCode::kTooLarge, "topology.vertex_count",
        fmt::format("Topology {} has {} vertices; at most {} are taken.", sent.topology_id(), vertices, limits_.vertices),
        "Send a coarser mesh, or several sheets.");
  auto triangles = read_triangles(sent.triangles(), vertices, limits_.triangles, "topology.triangles");
  if (!triangles) return tl::unexpected(std::move(triangles.error()));
  if (triangles->empty())
    return refuse(ErrorCode::kMalformed, "topology.triangles",
                  fmt::format("Topology {} has no triangle.", sent.topology_id()), "Send at least one.");

  sheet::Topology::Input input{.id = sent.topology_id(),
                               .vertex_count = vertices,
                               .triangles = std::move(*triangles),
                               .material_coordinates_m = {},
                               .rest_positions_m = {}};
  if (!sent.material_coordinates().empty()) {
    constexpr std::string_view kField = "topology.material_coordinates";
    if (const auto good = check_size(sent.material_coordinates(), vertices, sizeof(Vec2f), kField, "vertices"); !good)
      return tl::unexpected(good.error());
    auto read = read_points_2d(sent.material_coordinates(), metres_per_unit_,
                               {.field = kField, .item = "Vertex", .limit = limits_.position_m, .limit_unit = "m"});
    if (!read) return tl::unexpected(std::move(read.error()));
    input.material_coordinates_m = std::move(*read);
  }
  if (!sent.rest_positions().empty()) {
    constexpr std::string_view kField = "topology.rest_positions";
    if (const auto good = check_size(sent.rest_positions(), vertices, sizeof(Vec3f), kField, "vertices"); !good)
      return tl::unexpected(good.error());
    auto read = read_points(sent.rest_positions(), metres_per_unit_, y_up_,
                            {.field = kField, .item = "Vertex", .limit = limits_.position_m, .limit_unit = "m"});
    if (!read) return tl::unexpected(std::move(read.error()));
    input.rest_positions_m = std::move(*read);
  }

  if (const auto known = topologies_.find(sent.topology_id()); known != topologies_.end()) {
    const sheet::Topology& old = *known->second.topology;
    if (old.vertex_count() == vertices && std::ranges::equal(old.triangles(), input.triangles) &&
        std::ranges::equal(old.material_coordinates_m(), input.material_coordinates_m) &&
        std::ranges::equal(old.rest_positions_m(), input.rest_positions_m))
      return std::nullopt;
    return refuse(
        ErrorCode::kMalformed, "topology.topology_id",
        fmt::format("Topology {} was sent before with other content; a topology never changes.", sent.topology_id()),
        "Give the new one an id of its own.");
  }
  auto made = sheet::Topology::make(std::move(input));
  if (!made) return refuse(ErrorCode::kMalformed, "topology", std::move(made.error()), "Correct the mesh that is sent.");
  topologies_.emplace(
      sent.topology_id(),
      KnownTopology{.topology = std::move(*made), .last_use = ++topology_clock_, .used = false, .current_of_sheets = 0});
  drop_old_topologies();
  return std::nullopt;
}

void Decoder::use_topology(KnownSheet& sheet, std::uint64_t id) {
  KnownTopology& next = topologies_.at(id);
  next.last_use = ++topology_clock_;
  next.used = true;
  if (sheet.has_topology && sheet.topology_id == id) return;
  ++next.current_of_sheets;
  if (sheet.has_topology) --topologies_.at(sheet.topology_id).current_of_sheets;
  sheet.has_topology = true;
  sheet.topology_id = id;
  drop_old_topologies();
}

void Decoder::drop_old_topologies() {
  while (true) {
    std::size_t replaced = 0, waiting = 0, triangles = 0;
    auto oldest_replaced = topologies_.end(), oldest_waiting = topologies_.end();
    for (auto entry = topologies_.begin(); entry != topologies_.end(); ++entry) {
      const KnownTopology& known = entry->second;
      if (known.current_of_sheets > 0) continue;
      triangles += known.topology->triangle_count();
      ++(known.used ? replaced : waiting);
      auto& oldest = known.used ? oldest_replaced : oldest_waiting;
      if (oldest == topologies_.end() || known.last_use < oldest->second.last_use) oldest = entry;
    }
    const bool too_many = triangles > limits_.kept_triangles && replaced + waiting > 1;
    if (replaced > limits_.replaced_topologies || (too_many && replaced > 0)) {
      topologies_.erase(oldest_replaced);
    } else if (waiting > limits_.waiting_topologies || too_many) {
      topologies_.erase(oldest_waiting);
    } else {
      return;
    }
  }
}

tl::expected<Decoder::KnownSheet*, Error> Decoder::find_sheet(std::uint32_t id, std::string_view field) {
  const auto known = sheets_.find(id);
  if (known == sheets_.end())
    return refuse(ErrorCode::kUnknownSheet, field, fmt::format("Sheet {} was never described.", id),
                  "Send a Sheet with this id first, with attach or in the stream.");
  return &known->second;
}

Decoder::Item Decoder::decode_frame(const v1::MeshFrame& sent) {
  const auto found = find_sheet(sent.sheet_id(), "frame.sheet_id");
  if (!found) return tl::unexpected(found.error());
  KnownSheet& sheet = **found;
  const auto known = topologies_.find(sent.topology_id());
  if (known == topologies_.end())
    return refuse(ErrorCode::kUnknownTopology, "frame.topology_id",
                  fmt::format("Topology {} was not sent, or so long ago that it was dropped.", sent.topology_id()),
                  "Send the Topology before its first frame, and again when it was unused for long.");
  const std::shared_ptr<const sheet::Topology>& topology = known->second.topology;
  const std::size_t vertices = topology->vertex_count();

  if (const auto good = check_time(sent.time_s(), "frame.time_s", limits_); !good) return tl::unexpected(good.error());
  if (sheet.newest_frame_s && sent.time_s() <= *sheet.newest_frame_s)
    return refuse_order("frame.time_s", sent.time_s(), *sheet.newest_frame_s, "a sheet's frame times increase");

  sheet::MeshFrame frame;
  frame.sheet = sent.sheet_id();
  frame.time_s = sent.time_s();
  frame.topology = topology;
  frame.reset_history = sent.reset_history();

  if (const auto good = check_size(sent.positions(), vertices, sizeof(Vec3f), "frame.positions", "vertices"); !good)
    return tl::unexpected(good.error());
  auto positions =
      read_points(sent.positions(), metres_per_unit_, y_up_,
                  {.field = "frame.positions", .item = "Vertex", .limit = limits_.position_m, .limit_unit = "m"});
  if (!positions) return tl::unexpected(std::move(positions.error()));
  frame.positions_m = std::move(*positions);

  if (!sent.velocities().empty()) {
    if (const auto good = check_size(sent.velocities(), vertices, sizeof(Vec3f), "frame.velocities", "vertices"); !good)
      return tl::unexpected(good.error());
    auto velocities =
        read_points(sent.velocities(), metres_per_unit_, y_up_,
                    {.field = "frame.velocities", .item = "Vertex", .limit = limits_.speed_m_per_s, .limit_unit = "m/s"});
    if (!velocities) return tl::unexpected(std::move(velocities.error()));
    frame.velocities_m_per_s = std::move(*velocities);
  }
  if (!sent.anchored().empty()) {
    if (const auto good = check_size(sent.anchored(), vertices, 1, "frame.anchored", "vertices"); !good)
      return tl::unexpected(good.error());
    frame.anchored.resize(vertices);
    for (std::size_t v = 0; v < vertices; ++v) frame.anchored[v] = sent.anchored()[v] != 0;
  }
  if (sent.has_contacts()) {
    auto contacts = decode_contacts(sent.contacts(), vertices);
    if (!contacts) return tl::unexpected(std::move(contacts.error()));
    frame.contacts = std::move(*contacts);
  }
  if (sent.has_partition()) {
    auto partition = decode_partition(sent.partition(), topology->triangle_count());
    if (!partition) return tl::unexpected(std::move(partition.error()));
    frame.partition = std::move(*partition);
  }
  if (sent.tear_tips_size() > 0) {
    auto tips = decode_tips(sent.tear_tips(), "frame.tear_tips");
    if (!tips) return tl::unexpected(std::move(tips.error()));
    frame.tear_tips = std::move(*tips);
  }

  sheet.newest_frame_s = sent.time_s();
  use_topology(sheet, sent.topology_id());
  return engine::StreamItem(std::move(frame));
}

tl::expected<std::vector<sheet::SentContact>, Error> Decoder::decode_contacts(const v1::Contacts& sent,
                                                                              std::size_t vertices) const {
  const auto count = count_rows(sent.vertices(), sizeof(std::uint32_t), limits_.contacts, "frame.contacts.vertices");
  if (!count) return tl::unexpected(count.error());
  if (const auto good = check_size(sent.partners(), *count, sizeof(std::uint32_t), "frame.contacts.partners", "contacts");
      !good)
    return tl::unexpected(good.error());
  const auto table_size = static_cast<std::size_t>(sent.partner_table_size());
  if (table_size > limits_.contact_partners)
    return refuse(ErrorCode::kTooLarge, "frame.contacts.partner_table",
                  fmt::format("The table has {} partners; at most {} are taken.", table_size, limits_.contact_partners),
                  "List every partner once.");
  std::vector<sheet::ContactPartner> table;
  table.reserve(table_size);
  for (const v1::ContactPartner& partner : sent.partner_table()) {
    switch (partner.partner_case()) {
      case v1::ContactPartner::kObstacleId:
        if (!obstacles_.contains(partner.obstacle_id()))
          return refuse(ErrorCode::kUnknownObstacle, "frame.contacts.partner_table",
                        fmt::format("Obstacle {} is not in the scene.", partner.obstacle_id()),
                        "Send the obstacle in a SceneUpdate first.");
        table.emplace_back(sheet::ObstaclePartner{partner.obstacle_id()});
        break;
      case v1::ContactPartner::kSheetId:
        if (!sheets_.contains(partner.sheet_id()))
          return refuse(ErrorCode::kUnknownSheet, "frame.contacts.partner_table",
                        fmt::format("Sheet {} was never described.", partner.sheet_id()),
                        "Send a Sheet with this id first.");
        table.emplace_back(sheet::SheetPartner{partner.sheet_id()});
        break;
      case v1::ContactPartner::PARTNER_NOT_SET:
        return refuse(ErrorCode::kMalformed, "frame.contacts.partner_table",
                      fmt::format("Partner {} is neither an obstacle nor a sheet.", table.size()), "Name one of the two.");
    }
  }
  const auto touching = read_indices(sent.vertices(), vertices, false, "frame.contacts.vertices", "Contact", "vertices");
  if (!touching) return tl::unexpected(touching.error());
  const auto partners = read_indices(sent.partners(), table.size(), false, "frame.contacts.partners", "Contact", "partners");
  if (!partners) return tl::unexpected(partners.error());

  std::vector<Vec3f> slips;
  if (!sent.slip_velocities().empty()) {
    constexpr std::string_view kField = "frame.contacts.slip_velocities";
    if (const auto good = check_size(sent.slip_velocities(), *count, sizeof(Vec3f), kField, "contacts"); !good)
      return tl::unexpected(good.error());
    auto read = read_points(sent.slip_velocities(), metres_per_unit_, y_up_,
                            {.field = kField, .item = "Contact", .limit = limits_.speed_m_per_s, .limit_unit = "m/s"});
    if (!read) return tl::unexpected(std::move(read.error()));
    slips = std::move(*read);
  }
  std::vector<float> forces;
  if (!sent.normal_forces().empty()) {
    constexpr std::string_view kField = "frame.contacts.normal_forces";
    if (const auto good = check_size(sent.normal_forces(), *count, sizeof(float), kField, "contacts"); !good)
      return tl::unexpected(good.error());
    auto read = read_magnitudes(sent.normal_forces(),
                                {.field = kField, .item = "Contact", .limit = limits_.normal_force_n, .limit_unit = "N"});
    if (!read) return tl::unexpected(std::move(read.error()));
    forces = std::move(*read);
  }
  std::vector<sheet::SentContact> contacts;
  contacts.reserve(*count);
  for (std::size_t c = 0; c < *count; ++c) {
    sheet::SentContact contact{
        .vertex = (*touching)[c], .partner = table[(*partners)[c]], .slip_velocity_m_per_s = {}, .normal_force_n = {}};
    if (!slips.empty()) contact.slip_velocity_m_per_s = slips[c];
    if (!forces.empty()) contact.normal_force_n = forces[c];
    contacts.push_back(contact);
  }
  return contacts;
}

tl::expected<sheet::SentPartition, Error> Decoder::decode_partition(const v1::Partition& sent, std::size_t triangles) const {
  const auto regions = count_rows(sent.region_curved(), 1, limits_.regions, "frame.partition.region_curved");
  if (!regions) return tl::unexpected(regions.error());
  if (const auto good = check_size(sent.triangle_regions(), triangles, sizeof(std::uint32_t),
                                   "frame.partition.triangle_regions", "triangles");
      !good)
    return tl::unexpected(good.error());
  const auto rulings = count_rows(sent.rulings(), 2 * sizeof(Vec3f), limits_.rulings, "frame.partition.rulings");
  if (!rulings) return tl::unexpected(rulings.error());
  if (const auto good =
          check_size(sent.ruling_regions(), *rulings, sizeof(std::uint32_t), "frame.partition.ruling_regions", "rulings");
      !good)
    return tl::unexpected(good.error());
  const auto singular =
      count_rows(sent.singular_points(), sizeof(Vec3f), limits_.singular_points, "frame.partition.singular_points");
  if (!singular) return tl::unexpected(singular.error());
  if (!sent.singular_on_border().empty())
    if (const auto good =
            check_size(sent.singular_on_border(), *singular, 1, "frame.partition.singular_on_border", "singular points");
        !good)
      return tl::unexpected(good.error());

  sheet::SentPartition out;
  auto triangle_regions = read_indices(sent.triangle_regions(), *regions, true, "frame.partition.triangle_regions",
                                       "Triangle", "regions (region_curved has one entry each)");
  if (!triangle_regions) return tl::unexpected(std::move(triangle_regions.error()));
  out.triangle_regions = std::move(*triangle_regions);
  out.region_curved.resize(*regions);
  for (std::size_t r = 0; r < *regions; ++r) out.region_curved[r] = sent.region_curved()[r] != 0;

  const auto ends = read_points(
      sent.rulings(), metres_per_unit_, y_up_,
      {.field = "frame.partition.rulings", .item = "Ruling end", .limit = limits_.position_m, .limit_unit = "m"});
  if (!ends) return tl::unexpected(ends.error());
  const auto ruling_regions = read_indices(sent.ruling_regions(), *regions, false, "frame.partition.ruling_regions",
                                           "Ruling", "regions (region_curved has one entry each)");
  if (!ruling_regions) return tl::unexpected(ruling_regions.error());
  out.rulings.reserve(*rulings);
  for (std::size_t r = 0; r < *rulings; ++r)
    out.rulings.push_back({.start_m = (*ends)[2 * r], .end_m = (*ends)[2 * r + 1], .region = (*ruling_regions)[r]});

  const auto points = read_points(
      sent.singular_points(), metres_per_unit_, y_up_,
      {.field = "frame.partition.singular_points", .item = "Point", .limit = limits_.position_m, .limit_unit = "m"});
  if (!points) return tl::unexpected(points.error());
  out.singular_points.reserve(*singular);
  for (std::size_t s = 0; s < *singular; ++s)
    out.singular_points.push_back(
        {.position_m = (*points)[s], .on_border = !sent.singular_on_border().empty() && sent.singular_on_border()[s] != 0});
  return out;
}

template <class Tips>
tl::expected<std::vector<sheet::SentTearTip>, Error> Decoder::decode_tips(const Tips& sent, const std::string& field) const {
  if (static_cast<std::size_t>(sent.size()) > limits_.tear_tips)
    return refuse(ErrorCode::kTooLarge, field,
                  fmt::format("{} tear tips come at once; at most {} are taken.", sent.size(), limits_.tear_tips),
                  "Send the fastest ones.");
  std::vector<sheet::SentTearTip> tips;
  tips.reserve(static_cast<std::size_t>(sent.size()));
  for (const v1::TearTip& tip : sent) {
    const std::string prefix = fmt::format("{}[{}]", field, tips.size());
    if (!tip.has_position())
      return refuse(ErrorCode::kMalformed, prefix + ".position", "The tear tip has no position.", "Send its position.");
    const auto position =
        read_vector(tip.position(), metres_per_unit_, y_up_, limits_.position_m, prefix + ".position", "m");
    if (!position) return tl::unexpected(position.error());
    const double speed_m_per_s = tip.speed() * metres_per_unit_;
    if (const auto good = check_range(speed_m_per_s, 0, limits_.speed_m_per_s, prefix + ".speed", "m/s"); !good)
      return tl::unexpected(good.error());
    const auto direction = read_direction(tip.direction(), y_up_, prefix + ".direction");
    if (!direction) return tl::unexpected(direction.error());
    sheet::SentTearTip out{.tip_id = tip.tip_id(),
                           .position_m = position->cast<float>(),
                           .speed_m_per_s = static_cast<float>(speed_m_per_s),
                           .direction = {}};
    if (!direction->isZero(0)) out.direction = direction->cast<float>();
    tips.push_back(out);
  }
  return tips;
}

Decoder::Item Decoder::decode_tear_tips(const v1::TearTips& sent) {
  const auto found = find_sheet(sent.sheet_id(), "tear_tips.sheet_id");
  if (!found) return tl::unexpected(found.error());
  KnownSheet& sheet = **found;
  if (const auto good = check_time(sent.time_s(), "tear_tips.time_s", limits_); !good) return tl::unexpected(good.error());
  for (const auto& newest_s : {sheet.newest_frame_s, sheet.newest_tips_s})
    if (newest_s && sent.time_s() < *newest_s)
      return refuse_order("tear_tips.time_s", sent.time_s(), *newest_s, "a sheet's tear tips are not older than its frames");
  auto tips = decode_tips(sent.tips(), "tear_tips.tips");
  if (!tips) return tl::unexpected(std::move(tips.error()));
  sheet.newest_tips_s = sent.time_s();
  return engine::StreamItem(engine::TearTips{.sheet = sent.sheet_id(), .time_s = sent.time_s(), .tips = std::move(*tips)});
}

}  // namespace rustle::wire
