#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "server/apps/daemon.h"
#include "server/apps/wording.h"

/// What is changed by control while sessions sound: gains and packs.
namespace rustle::apps {
namespace {

wire::Error refusal(wire::ErrorCode code, std::string field, std::string message, std::string remedy) {
  return {code, std::move(field), std::move(message), std::move(remedy), 0, std::nullopt, {}};
}

}  // namespace

std::optional<wire::Error> Daemon::check_sheet(const Guest& asked, sheet::SheetId sheet, std::string field) {
  const auto ids = asked.decoder.sheet_ids();
  if (std::find(ids.begin(), ids.end(), sheet) != ids.end()) return std::nullopt;
  return refusal(
      wire::ErrorCode::kUnknownSheet, std::move(field),
      fmt::format("The session \"{}\" has no sheet {}.", asked.session->id(), sheet),
      ids.empty() ? std::string("Describe the sheet first.") : fmt::format("There are: {}.", fmt::join(ids, ", ")));
}

std::optional<wire::Error> Daemon::hand_over(Guest& asked, engine::StreamItem item) {
  switch (asked.session->offer(std::move(item), 0)) {
    case session::Offer::kTaken:
      scheduler_->wake_analysis(asked.session);
      return std::nullopt;
    case session::Offer::kFull:
      return refusal(wire::ErrorCode::kOverloaded, "session_id",
                     fmt::format("The session \"{}\" has too much to analyse before.", asked.session->id()),
                     "Ask again in a moment.");
    case session::Offer::kEnded:
      break;
  }
  return refusal(wire::ErrorCode::kUnknownSession, "session_id",
                 fmt::format("The session \"{}\" has ended.", asked.session->id()), "Attach a new one.");
}

// -------------------------------------------------------------------------------------------------------------- gains

wire::ControlReply Daemon::set_gains(Guest& asked, const wire::SetGainsRequest& request) {
  for (std::size_t k = 0; k < request.gains.size(); ++k) {
    const wire::Gain& gain = request.gains[k];
    const std::string field = fmt::format("set_gains.gains[{}]", k);
    if (gain.sheet_id) {
      if (auto wrong = check_sheet(asked, *gain.sheet_id, field + ".sheet_id")) return *wrong;
    }
    if (gain.material.empty()) continue;
    if (auto wrong = check_material(gain.material, {}, field + ".material")) return *wrong;
  }
  auto gains = synthesis::changed(asked.gains, request.gains);
  const std::size_t most = wire::Limits{}.gains;
  if (gains.size() > most) {
    return refusal(wire::ErrorCode::kTooLarge, "set_gains.gains",
                   fmt::format("{} would be in force; at most {} may be.", counted(gains.size(), "gain"), most),
                   "Take some away by setting them to 0 dB.");
  }
  if (gains != asked.gains) {
    if (auto wrong = hand_over(asked, engine::GainChange{gains})) return *wrong;
    asked.gains = std::move(gains);
  }
  return wire::GainsSet{asked.gains};
}

// -------------------------------------------------------------------------------------------------------------- packs

wire::PackInfo Daemon::info_of(const pack::PackEntry& entry) const {
  wire::PackInfo info{entry.name, entry.material, entry.touched_surface, entry.version, entry.licence, 0, 0, 0, {}};
  const auto held = held_packs_.find(entry.folder);
  if (held == held_packs_.end()) return info;
  const pack::SoundPack& pack = *held->second;
  info.rate_hz = pack.stored_rate_hz;
  if (pack.crumpling) {
    info.units = static_cast<std::uint32_t>(pack.crumpling->units.size());
    info.models.push_back("crumpling");
  }
  if (pack.friction) {
    info.spectra = static_cast<std::uint32_t>(pack.friction->spectra.size());
    info.models.push_back("friction");
  }
  return info;
}

wire::PackList Daemon::pack_list() const {
  wire::PackList list;
  for (const auto& entry : packs_->entries()) list.packs.push_back(info_of(entry));
  return list;
}

wire::ControlReply Daemon::change_pack(Guest& asked, const wire::ChangePackRequest& request) {
  if (auto wrong = check_sheet(asked, request.sheet_id, "change_pack.sheet_id")) return *wrong;
  const engine::SheetDescription& now = *asked.decoder.find_sheet(request.sheet_id);
  const auto first_of = [](const std::string& a, const std::string& b, const std::string& c) {
    return !a.empty() ? a : !b.empty() ? b : c;
  };
  const auto found = packs_->find(first_of(request.material, now.material, asked.session->options().default_material),
                                  first_of(request.touched_surface, now.touched_surface, engine::Options{}.default_surface));
  if (!found) {
    return refusal(wire::ErrorCode::kUnknownMaterial, "change_pack.material", found.error().message + ".",
                   found.error().remedy);
  }
  const engine::PackChange change{request.sheet_id, request.material, request.touched_surface};
  if (auto wrong = hand_over(asked, change)) return *wrong;
  asked.decoder.change_pack(change);
  keep_for_recordings(asked, *asked.decoder.find_sheet(request.sheet_id));
  return wire::PackChanged{info_of(*found)};
}

void Daemon::finish_reloads() {
  for (auto& [request, read] : reloads_->take_done()) {
    if (!read) {
      pack::PackError what = read.error();
      std::string remedy = std::exchange(what.remedy, {});
      const auto entries = packs_->entries();
      const bool known = request.name.empty() || std::any_of(entries.begin(), entries.end(), [&](const auto& entry) {
                           return entry.name == request.name || entry.material == request.name;
                         });
      const wire::Error error =
          refusal(known ? wire::ErrorCode::kMalformed : wire::ErrorCode::kUnknownMaterial, "reload_pack.name",
                  fmt::format("{}. All packs stay as they were.", what.text()), std::move(remedy));
      complain("control request", error);
      sockets_->send_control(request.peer, wire::encode_reply(request.request_id, error));
      continue;
    }
    const auto entries = packs_->entries();
    bool changed = false;
    wire::PackList list;
    for (const auto& pack : *read) {
      auto& held = held_packs_[pack->folder];
      changed |= held != pack;
      held = pack;
      const auto entry =
          std::find_if(entries.begin(), entries.end(), [&](const auto& e) { return e.folder == pack->folder; });
      if (entry != entries.end()) list.packs.push_back(info_of(*entry));
    }
    std::erase_if(held_packs_, [&](const auto& held) {
      return std::none_of(entries.begin(), entries.end(), [&](const auto& e) { return e.folder == held.first; });
    });
    spdlog::info("{} read anew{}", counted(list.packs.size(), "sound pack"), changed ? "" : ", unchanged");
    for (auto& [id, guest] : guests_) {
      if (changed) static_cast<void>(hand_over(*guest, engine::PackReload{}));
    }
    sockets_->send_control(request.peer, wire::encode_reply(request.request_id, list));
  }
}

}  // namespace rustle::apps
