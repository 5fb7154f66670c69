#include "server/wire/decisions.h"

#include <fmt/format.h>

#include <cmath>

#include "rustle/v1/session.pb.h"
#include "server/engine/economy.h"
#include "server/wire/fields.h"
#include "server/wire/gains.h"
#include "server/wire/session_options.h"

namespace rustle::wire {
namespace {

using Stepped = tl::expected<session::Step, Error>;

struct AddStep {
  v1::Step& out;

  void operator()(const session::Given& given) const { name(v1::STEP_KIND_GIVEN, given.arrival, given.sequence); }
  void operator()(const session::Failed& failed) const { name(v1::STEP_KIND_FAILED, failed.arrival, failed.sequence); }
  void operator()(const session::FellQuiet&) const { out.set_kind(v1::STEP_KIND_FELL_QUIET); }
  void operator()(const session::Ended&) const { out.set_kind(v1::STEP_KIND_ENDED); }
  void operator()(const session::Asked& asked) const { std::visit(*this, asked); }
  void operator()(const engine::GainChange& change) const {
    out.set_kind(v1::STEP_KIND_GAINS);
    for (const synthesis::Gain& gain : change.gains) to_wire(gain, out.mutable_gains()->add_gains());
  }
  void operator()(const engine::PackChange& change) const {
    out.set_kind(v1::STEP_KIND_PACK);
    v1::ChangePack* pack = out.mutable_pack();
    pack->set_sheet_id(change.sheet);
    pack->set_material(change.material);
    pack->set_touched_surface(change.touched_surface);
  }
  void operator()(const engine::PackReload&) const { out.set_kind(v1::STEP_KIND_PACK_RELOAD); }
  void operator()(const engine::LoadLevel& load) const {
    out.set_kind(v1::STEP_KIND_LOAD_LEVEL);
    out.set_load_level(load.level);
  }
  void operator()(const engine::ListenerMove& move) const {
    out.set_kind(v1::STEP_KIND_LISTENER);
    to_wire(move.position_m, out.mutable_listener());
  }

 private:
  void name(v1::StepKind kind, std::uint64_t arrival, std::uint64_t sequence) const {
    out.set_kind(kind);
    out.set_arrival(arrival);
    out.set_message_sequence(sequence);
  }
};

struct AddDecision {
  v1::Decision& out;

  void operator()(const engine::TimeMapping& mapping) const {
    v1::TimeMapping* to = out.mutable_time_mapping();
    to->set_first_time_s(mapping.first_time_s);
    to->set_first_sample(mapping.first_sample);
    to->set_samples_per_s(mapping.samples_per_s);
    to->set_playout_delay_s(mapping.playout_delay_s);
  }
  void operator()(const session::Step& step) const {
    v1::Step* to = out.mutable_step();
    std::visit(AddStep{*to}, step.what);
    if (step.earliest) to->set_earliest_sample(*step.earliest);
    to->set_accepted_at_sample(step.accepted_at);
    to->set_start_again(step.start_again);
  }
  void operator()(const session::Dropped& dropped) const {
    v1::Dropped* to = out.mutable_dropped();
    to->set_arrival(dropped.arrival);
    to->set_message_sequence(dropped.sequence);
    to->set_cause(dropped.cause);
  }
  void operator()(const session::RenderedTo& rendered) const { out.mutable_rendered_to()->set_sample(rendered.sample); }
  void operator()(const session::RecordingBegun& begun) const {
    v1::RecordingBegun* to = out.mutable_begun();
    to->set_first_sample(begun.first_sample);
    to->set_state_messages(begun.state_messages);
    to->set_first_arrival(begun.first_arrival);
  }
};

tl::unexpected<Error> unknown(std::string_view what) {
  return refuse(ErrorCode::kUnsupported, "decision", fmt::format("The recording holds a {} that is not known here.", what),
                "Use a newer Rustle.");
}

Stepped read(const v1::Step& sent) {
  session::Step step;
  switch (sent.kind()) {
    case v1::STEP_KIND_GIVEN:
      step.what = session::Given{sent.arrival(), sent.message_sequence()};
      break;
    case v1::STEP_KIND_FAILED:
      step.what = session::Failed{sent.arrival(), sent.message_sequence()};
      break;
    case v1::STEP_KIND_FELL_QUIET:
      step.what = session::FellQuiet{};
      break;
    case v1::STEP_KIND_ENDED:
      step.what = session::Ended{};
      break;
    case v1::STEP_KIND_GAINS: {
      auto gains = gains_from_wire(sent.gains().gains(), "step.gains", {});
      if (!gains) return tl::unexpected(std::move(gains.error()));
      step.what = session::Asked(engine::GainChange{std::move(*gains)});
      break;
    }
    case v1::STEP_KIND_PACK:
      step.what =
          session::Asked(engine::PackChange{sent.pack().sheet_id(), sent.pack().material(), sent.pack().touched_surface()});
      break;
    case v1::STEP_KIND_PACK_RELOAD:
      step.what = session::Asked(engine::PackReload{});
      break;
    case v1::STEP_KIND_LOAD_LEVEL:
      if (sent.load_level() > engine::kMostLoadLevel) return unknown("load level");
      step.what = session::Asked(engine::LoadLevel{sent.load_level()});
      break;
    case v1::STEP_KIND_LISTENER: {
      auto position_m = read_vector(sent.listener(), 1, false, Limits{}.position_m, "step.listener", "m");
      if (!position_m) return tl::unexpected(std::move(position_m.error()));
      step.what = session::Asked(engine::ListenerMove{*position_m});
      break;
    }
    default:
      return unknown("kind of step");
  }
  if (sent.has_earliest_sample()) step.earliest = sent.earliest_sample();
  step.accepted_at = sent.accepted_at_sample();
  step.start_again = sent.start_again();
  return step;
}

tl::expected<engine::TimeMapping, Error> read(const v1::TimeMapping& sent) {
  constexpr std::string_view kRemedy = "Record again; this file was altered.";
  for (const double number : {sent.first_time_s(), sent.samples_per_s(), sent.playout_delay_s()}) {
    if (!std::isfinite(number))
      return refuse(ErrorCode::kNotFinite, "time_mapping", fmt::format("A time mapping holds {}.", number),
                    std::string(kRemedy));
  }
  if (!(sent.samples_per_s() > 0))
    return refuse(ErrorCode::kOutOfRange, "time_mapping.samples_per_s",
                  fmt::format("A time mapping has {} samples a second.", sent.samples_per_s()), std::string(kRemedy));
  return engine::TimeMapping{sent.first_time_s(), sent.first_sample(), sent.samples_per_s(), sent.playout_delay_s()};
}

}  // namespace

std::string encode_decision(std::string_view session_id, std::uint64_t sequence, const session::Decision& decision) {
  v1::Decision out;
  out.set_session_id(std::string(session_id));
  out.set_sequence(sequence);
  std::visit(AddDecision{out}, decision);
  return out.SerializeAsString();
}

tl::expected<session::Decision, Error> decode_decision(std::span<const std::byte> bytes) {
  keep_protobuf_quiet();
  v1::Decision sent;
  if (!sent.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
    return refuse(ErrorCode::kMalformed, "decision", "The bytes are no rustle.v1.Decision.", "Record again.");
  switch (sent.decision_case()) {
    case v1::Decision::kTimeMapping:
      return read(sent.time_mapping());
    case v1::Decision::kStep:
      return read(sent.step());
    case v1::Decision::kDropped:
      return session::Dropped{sent.dropped().arrival(), sent.dropped().message_sequence(), sent.dropped().cause()};
    case v1::Decision::kRenderedTo:
      return session::RenderedTo{sent.rendered_to().sample()};
    case v1::Decision::kBegun:
      return session::RecordingBegun{sent.begun().first_sample(), sent.begun().state_messages(),
                                     sent.begun().first_arrival()};
    default:
      return unknown("decision");
  }
}

std::string encode_announcement(std::string_view session_id, const std::string& name,
                                const session::SessionOptions& options) {
  v1::StreamMessage out;
  out.set_session_id(std::string(session_id));
  v1::Announcement* announcement = out.mutable_announcement();
  announcement->set_protocol_version(kProtocolVersion);
  announcement->set_name(name);
  to_wire(options, announcement->mutable_options());
  return out.SerializeAsString();
}

std::string encode_sheet(std::string_view session_id, const engine::SheetDescription& sheet) {
  v1::StreamMessage out;
  out.set_session_id(std::string(session_id));
  v1::Sheet* to = out.mutable_sheet();
  to->set_sheet_id(sheet.id);
  to->set_name(sheet.name);
  to->set_kind(sheet.kind == engine::SheetKind::kCloth ? v1::SHEET_KIND_CLOTH : v1::SHEET_KIND_PAPER);
  to->set_material(sheet.material);
  to->set_touched_surface(sheet.touched_surface);
  if (sheet.grammage_kg_per_m2) to->set_grammage_kg_per_m2(*sheet.grammage_kg_per_m2);
  if (sheet.thickness_m) to->set_thickness_m(*sheet.thickness_m);
  return out.SerializeAsString();
}

}  // namespace rustle::wire
