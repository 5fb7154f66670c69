#include "server/wire/control.h"

#include <optional>

#include "server/synthesis/gain.h"
#include "tests/fuzz/fuzzed_session.h"

namespace {

using namespace rustle;

/// Carries requests out. The session that they find is there from the first of them that needs one.
struct Carried {
  std::optional<fuzz::FuzzedSession> found;

  fuzz::FuzzedSession& session() { return found ? *found : found.emplace(); }
  void operator()(const wire::AttachRequest& attach) {
    fuzz::FuzzedSession attached(attach.options);
    for (const auto& sheet : attach.sheets)
      if (attached.decoder().add_sheet(sheet)) attached.give(sheet);
    const wire::ControlReply reply = wire::Attached{"s", session::settled(attach.options), wire::FlowCredit{0, 1, 1}, {}};
    fuzz::require(!wire::encode_reply(1, reply).empty());
  }
  void operator()(const wire::SetGainsRequest& request) {
    const auto gains = synthesis::changed({}, request.gains);
    session().give(engine::GainChange{gains});
    fuzz::require(synthesis::changed(gains, request.gains) == gains);
  }
  void operator()(const wire::ChangePackRequest& request) {
    const engine::PackChange change{request.sheet_id, request.material, request.touched_surface};
    session().decoder().change_pack(change);
    session().give(change);
  }
  template <class Other>
  void operator()(const Other&) {}
};

}  // namespace

/// Control requests, and what the daemon does of them to a session.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Carried carried;
  for (const auto part : fuzz::parts_of(fuzz::text_of(data, size))) {
    const auto request = wire::decode_control(std::as_bytes(std::span(part)));
    if (request) {
      std::visit(carried, request->body);
    } else {
      fuzz::require(!request.error().error.message.empty());
      fuzz::require(!wire::encode_reply(request.error().request_id, request.error().error).empty());
    }
  }
  return 0;
}
