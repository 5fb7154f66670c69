#include "server/wire/control.h"

#include <fmt/format.h>

#include "proto/statistics_figures.h"
#include "rustle/v1/session.pb.h"
#include "server/wire/decode.h"
#include "server/wire/fields.h"
#include "server/wire/gains.h"
#include "server/wire/session_options.h"

namespace rustle::wire {
namespace {

using Body = decltype(ControlRequest::body);

tl::expected<Body, Error> decode_attach(const v1::Attach& sent, const Limits& limits) {
  AttachRequest out;
  if (const auto good = check_text(sent.name(), "attach.name", limits); !good) return tl::unexpected(good.error());
  out.name = sent.name();
  auto options = from_wire(sent.options(), "attach.options", limits);
  if (!options) return tl::unexpected(std::move(options.error()));
  out.options = std::move(*options);
  if (static_cast<std::size_t>(sent.sheets_size()) > limits.sheets)
    return refuse(ErrorCode::kTooLarge, "attach.sheets",
                  fmt::format("{} sheets are attached; at most {} are taken.", sent.sheets_size(), limits.sheets),
                  "Attach several sessions.");
  for (const v1::Sheet& sheet : sent.sheets()) {
    auto read = decode_sheet(sheet, fmt::format("attach.sheets[{}]", out.sheets.size()), limits);
    if (!read) return tl::unexpected(std::move(read.error()));
    out.sheets.push_back(std::move(*read));
  }
  return out;
}

tl::expected<Body, Error> decode_gains(const v1::SetGains& sent, const Limits& limits) {
  auto gains = gains_from_wire(sent.gains(), "set_gains.gains", limits);
  if (!gains) return tl::unexpected(std::move(gains.error()));
  return SetGainsRequest{std::move(*gains)};
}

tl::expected<Body, Error> decode_body(const v1::ControlRequest& request, const Limits& limits) {
  switch (request.request_case()) {
    case v1::ControlRequest::kHello: {
      const v1::Hello& hello = request.hello();
      if (hello.protocol_version() != kProtocolVersion)
        return refuse(
            ErrorCode::kProtocolVersion, "hello.protocol_version",
            fmt::format("The client speaks version {}, this daemon version {}.", hello.protocol_version(), kProtocolVersion),
            "Bring the older of the two up to date.");
      if (const auto good = check_text(hello.client(), "hello.client", limits); !good) return tl::unexpected(good.error());
      return HelloRequest{.client = hello.client()};
    }
    case v1::ControlRequest::kAttach:
      return decode_attach(request.attach(), limits);
    case v1::ControlRequest::kDetach:
      return DetachRequest{.discard = request.detach().discard(), .last_sequence = request.detach().last_sequence()};
    case v1::ControlRequest::kSetGains:
      return decode_gains(request.set_gains(), limits);
    case v1::ControlRequest::kGetStatistics:
      return GetStatisticsRequest{};
    case v1::ControlRequest::kListPacks:
      return ListPacksRequest{};
    case v1::ControlRequest::kChangePack: {
      const v1::ChangePack& change = request.change_pack();
      if (const auto good = check_text(change.material(), "change_pack.material", limits); !good)
        return tl::unexpected(good.error());
      if (const auto good = check_text(change.touched_surface(), "change_pack.touched_surface", limits); !good)
        return tl::unexpected(good.error());
      if (change.material().empty() && change.touched_surface().empty())
        return refuse(ErrorCode::kMalformed, "change_pack.material", "Neither a material nor a touched surface is named.",
                      "Name the material whose pack the sheet is to get.");
      return ChangePackRequest{change.sheet_id(), change.material(), change.touched_surface()};
    }
    case v1::ControlRequest::kReloadPack:
      if (const auto good = check_text(request.reload_pack().name(), "reload_pack.name", limits); !good)
        return tl::unexpected(good.error());
      return ReloadPackRequest{request.reload_pack().name()};
    case v1::ControlRequest::kStartRecording:
      if (const auto good = check_text(request.start_recording().file_name(), "start_recording.file_name", limits); !good)
        return tl::unexpected(good.error());
      return StartRecordingRequest{request.start_recording().file_name()};
    case v1::ControlRequest::kStopRecording:
      return StopRecordingRequest{};
    case v1::ControlRequest::kListSessions:
      return ListSessionsRequest{};
    case v1::ControlRequest::REQUEST_NOT_SET:
      break;
  }
  return refuse(ErrorCode::kMalformed, "request", "The request asks nothing that this version knows.",
                "Set one of ControlRequest's requests, or bring the daemon up to date.");
}

void write(const Statistics& statistics, v1::Statistics* out) {
  out->set_session_id(statistics.session_id);
  for (const auto& [cause, count] : statistics.frames_dropped) (*out->mutable_frames_dropped())[cause] = count;
  v1::for_each_figure<Statistics>([&](const char*, auto member, auto, auto set) { (out->*set)(statistics.*member); });
}

void write(const ServerStatistics& statistics, v1::ServerStatistics* out) {
  out->set_uptime_s(statistics.uptime_s);
  out->set_cpu_s(statistics.cpu_s);
  out->set_sessions(statistics.sessions);
  for (const ThreadStatistics& thread : statistics.threads) {
    v1::ThreadStatistics* told = out->add_threads();
    told->set_name(thread.name);
    told->set_cpu_s(thread.cpu_s);
    told->set_waited_s(thread.waited_s);
    told->set_count(thread.count);
  }
  if (!statistics.playback) return;
  const PlaybackStatistics& playback = *statistics.playback;
  v1::PlaybackStatistics* told = out->mutable_playback();
  told->set_device(playback.device);
  told->set_rate_hz(playback.rate_hz);
  told->set_samples_played(playback.samples_played);
  told->set_samples_missed(playback.samples_missed);
  told->set_devices_opened(playback.devices_opened);
  told->set_devices_lost(playback.devices_lost);
  told->set_samples_in_gaps(playback.samples_in_gaps);
  told->set_samples_left_out(playback.samples_left_out);
  told->set_splices(playback.splices);
}

void write(const PackInfo& pack, v1::PackInfo* out) {
  out->set_name(pack.name);
  out->set_material(pack.material);
  out->set_touched_surface(pack.touched_surface);
  out->set_version(pack.version);
  out->set_licence(pack.licence);
  out->set_rate_hz(pack.rate_hz);
  out->set_units(pack.units);
  out->set_spectra(pack.spectra);
  for (const std::string& model : pack.models) out->add_models(model);
}

void write(const Error& error, v1::Error* out) {
  out->set_code(static_cast<v1::ErrorCode>(error.code));
  out->set_field(error.field);
  out->set_message(error.message);
  out->set_remedy(error.remedy);
  out->set_sequence(error.sequence);
  if (error.quota) {
    out->mutable_quota()->set_name(error.quota->name);
    out->mutable_quota()->set_limit(error.quota->limit);
    out->mutable_quota()->set_asked(error.quota->asked);
  }
  out->set_permission(error.permission);
}

struct AddReply {
  v1::ControlReply& reply;

  void operator()(const Error& error) const { write(error, reply.mutable_error()); }
  void operator()(const Welcome& welcome) const {
    v1::Welcome* out = reply.mutable_welcome();
    out->set_protocol_version(kProtocolVersion);
    out->set_server(welcome.server);
    out->set_stream_endpoint(welcome.stream_endpoint);
    out->set_out_endpoint(welcome.out_endpoint);
    out->set_rate_hz(welcome.rate_hz);
    out->set_block_size(welcome.block_size);
    out->set_sessions(welcome.sessions);
    out->set_most_sessions(welcome.most_sessions);
  }
  void operator()(const Attached& attached) const {
    v1::Attached* out = reply.mutable_attached();
    out->set_session_id(attached.session_id);
    to_wire(attached.options, out->mutable_options());
    if (attached.credit) {
      out->mutable_credit()->set_acknowledged_sequence(attached.credit->acknowledged_sequence);
      out->mutable_credit()->set_window_messages(attached.credit->window_messages);
      out->mutable_credit()->set_window_bytes(attached.credit->window_bytes);
    }
    out->set_recording_file_name(attached.recording_file_name);
  }
  void operator()(const Detached& detached) const {
    write(detached.statistics, reply.mutable_detached()->mutable_statistics());
  }
  void operator()(const GainsSet& set) const {
    v1::GainsSet* out = reply.mutable_gains_set();
    for (const Gain& gain : set.gains) to_wire(gain, out->add_gains());
  }
  void operator()(const Statistics& statistics) const { write(statistics, reply.mutable_statistics()); }
  void operator()(const ServerStatistics& statistics) const { write(statistics, reply.mutable_server_statistics()); }
  void operator()(const PackList& list) const {
    v1::PackList* out = reply.mutable_pack_list();
    for (const PackInfo& pack : list.packs) write(pack, out->add_packs());
  }
  void operator()(const PackChanged& changed) const { write(changed.pack, reply.mutable_pack_changed()->mutable_pack()); }
  void operator()(const RecordingStarted& started) const {
    reply.mutable_recording_started()->set_file_name(started.file_name);
  }
  void operator()(const RecordingStopped& stopped) const {
    v1::RecordingStopped* out = reply.mutable_recording_stopped();
    out->set_file_name(stopped.file_name);
    out->set_messages(stopped.messages);
    out->set_bytes(stopped.bytes);
  }
  void operator()(const SessionList& list) const {
    v1::SessionList* out = reply.mutable_session_list();
    for (const SessionInfo& session : list.sessions) {
      v1::SessionInfo* info = out->add_sessions();
      info->set_session_id(session.session_id);
      info->set_name(session.name);
      info->set_clock(session.clock == session::Clock::kLive ? v1::CLOCK_LIVE : v1::CLOCK_SIMULATION);
      info->set_sheets(session.sheets);
      info->set_newest_time_s(session.newest_time_s);
      if (session.recording) {
        info->mutable_recording()->set_file_name(session.recording->file_name);
        info->mutable_recording()->set_messages(session.recording->messages);
        info->mutable_recording()->set_bytes(session.recording->bytes);
      }
    }
  }
};

}  // namespace

tl::expected<ControlRequest, ControlError> decode_control(std::span<const std::byte> bytes, const Limits& limits) {
  keep_protobuf_quiet();
  v1::ControlRequest request;
  if (bytes.size() > limits.control_bytes)
    return tl::unexpected(ControlError{
        0, refuse(ErrorCode::kTooLarge, "",
                  fmt::format("The request has {} bytes; at most {} are taken.", bytes.size(), limits.control_bytes),
                  "Send meshes in the stream, not on the control socket.")
               .value()});
  if (!request.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
    return tl::unexpected(ControlError{0, refuse(ErrorCode::kMalformed, "", "The bytes are no rustle.v1.ControlRequest.",
                                                 "Speak the protocol's version 1; text fields are UTF-8.")
                                              .value()});
  if (const auto good = check_text(request.session_id(), "session_id", limits); !good)
    return tl::unexpected(ControlError{request.request_id(), good.error()});
  auto body = decode_body(request, limits);
  if (!body) return tl::unexpected(ControlError{request.request_id(), std::move(body.error())});
  return ControlRequest{.request_id = request.request_id(), .session_id = request.session_id(), .body = std::move(*body)};
}

std::string encode_error(const Error& error) {
  v1::Error message;
  write(error, &message);
  return message.SerializeAsString();
}

std::string encode_reply(std::uint64_t request_id, const ControlReply& reply) {
  v1::ControlReply out;
  out.set_request_id(request_id);
  std::visit(AddReply{out}, reply);
  return out.SerializeAsString();
}

std::vector<NamedNumber> numbers_of(const Statistics& statistics) {
  std::vector<NamedNumber> out;
  v1::for_each_figure<Statistics>([&](const char* name, auto member, auto, auto) {
    out.push_back({name, statistics.*member});
  });
  return out;
}

}  // namespace rustle::wire
