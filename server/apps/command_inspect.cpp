#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "server/apps/capture_source.h"
#include "server/apps/command.h"
#include "server/apps/inspected_sheet.h"
#include "server/apps/wording.h"
#include "server/report/film_picture.h"
#include "server/report/sheet_picture.h"

namespace rustle::apps {
namespace {

struct InspectArguments {
  std::string capture, output;
  std::optional<double> time_s, from_s, to_s;
  std::optional<int> film, columns;
  std::optional<std::uint32_t> sheet;
  bool json = false;
};

/// Empty: the arguments make sense together.
std::string misuse(const InspectArguments& arguments) {
  if (arguments.film && arguments.time_s)
    return "--time draws one frame and --film several; leave one of them out (--from and --to bound a film)";
  if (!arguments.film && !arguments.time_s)
    return "say which moment: --time S for one frame, or --film N for N frames of the whole capture";
  if (!arguments.film && (arguments.from_s || arguments.to_s || arguments.columns))
    return "--from, --to and --columns are of a film; add --film N";
  for (const auto& [name, value] :
       {std::pair{"--time", arguments.time_s}, {"--from", arguments.from_s}, {"--to", arguments.to_s}}) {
    if (value && !std::isfinite(*value)) return fmt::format("{} takes a time in s, as in {} 1.5", name, name);
  }
  const auto most_frames = static_cast<int>(report::kMostFilmFrames);
  if (arguments.film && (*arguments.film < 1 || *arguments.film > most_frames))
    return fmt::format("--film takes 1 to {} frames, not {}; try --film 12", most_frames, *arguments.film);
  if (arguments.columns && (*arguments.columns < 1 || *arguments.columns > report::kMostFilmColumns)) {
    return fmt::format("--columns takes 1 to {}, not {}; leave it out and a fitting number is chosen",
                       report::kMostFilmColumns, *arguments.columns);
  }
  if (arguments.from_s && arguments.to_s && *arguments.from_s > *arguments.to_s)
    return fmt::format("--from {} is after --to {}; exchange them", *arguments.from_s, *arguments.to_s);
  return output_conflict({arguments.capture}, {arguments.output});
}

std::vector<std::string> notices_of(const CaptureSource& source) {
  std::vector<std::string> notices;
  for (const auto& [code, refusals] : source.refused())
    notices.push_back(fmt::format("{} left out, first: {}", counted(refusals.count, "message"), refusals.first));
  if (!source.recovery().complete) notices.push_back(source.recovery().what);
  return notices;
}

std::string title_of(const InspectArguments& arguments, const InspectedMoment& moment) {
  const auto stem = std::filesystem::path(arguments.capture).stem().string();
  const bool named = !moment.sheet_name.empty() && moment.sheet_name != "sheet" && moment.sheet_name != stem;
  return fmt::format("{}, sheet {}{}", stem, moment.sheet, named ? fmt::format(" \"{}\"", moment.sheet_name) : "");
}

nlohmann::ordered_json figures_of(const InspectedMoment& moment) {
  return {{"time_s", moment.view.time_s},
          {"triangles", moment.triangles},
          {"regions", moment.regions.size()},
          {"coarse_regions", moment.coarse_regions()},
          {"ridge_triangles", moment.ridge_triangles},
          {"touching_vertices", moment.touching_vertices},
          {"sliding_contacts", moment.sliding_contacts},
          {"events", moment.view.events.size()}};
}

std::string figures_text(const InspectedMoment& moment) {
  return fmt::format("{}, {} ({} coarse), {}, {} touching {}, {}", counted(moment.triangles, "triangle"),
                     counted(moment.regions.size(), "region"), moment.coarse_regions(),
                     counted(moment.ridge_triangles, "ridge triangle"), moment.touching_vertices,
                     moment.touching_vertices == 1 ? "vertex" : "vertices",
                     counted(moment.sliding_contacts, "sliding contact"));
}

int show_frame(const InspectArguments& arguments, CaptureSource& source) {
  constexpr double kEventsShown_s = 0.1;  // before the frame
  Progress progress("analysing");
  InspectedSheet inspected(source, arguments.sheet);
  std::optional<double> shown_s;
  while (inspected.next(*arguments.time_s + 1e-9)) {
    shown_s = inspected.time_s();
    inspected.forget_events_before(*shown_s - kEventsShown_s);
    progress.show(source.progress());
  }
  if (!shown_s)
    return complain(fmt::format("{}: {}", arguments.capture, inspected.nothing_until(*arguments.time_s)), kFailed);
  InspectedMoment moment = inspected.moment();
  moment.view.title = title_of(arguments, moment);
  moment.view.events_over_s = kEventsShown_s;
  if (!arguments.output.empty()) {
    if (auto drawn = report::write_sheet_png(arguments.output, moment.view); !drawn) return complain(drawn.error(), kFailed);
  }
  if (arguments.json) {
    auto regions = nlohmann::ordered_json::array();
    for (std::size_t k = 0; k < moment.regions.size(); ++k) {
      const auto& r = moment.regions[k];
      regions.push_back({{"curved", static_cast<bool>(moment.view.region_curved[k])},
                         {"constrained", r.constrained},
                         {"coarse", r.coarse},
                         {"l_r_m", r.ruling_length_m},
                         {"l_c_m", r.free_border_length_m},
                         {"area_m2", r.area_m2},
                         {"position_m", {r.position_m.x(), r.position_m.y(), r.position_m.z()}}});
    }
    fmt::print("{}\n", nlohmann::ordered_json{{"time_s", moment.view.time_s},
                                              {"sheet", moment.sheet},
                                              {"triangles", moment.triangles},
                                              {"regions", regions},
                                              {"ridge_triangles", moment.ridge_triangles},
                                              {"touching_vertices", moment.touching_vertices},
                                              {"sliding_contacts", moment.sliding_contacts},
                                              {"recent_events", moment.view.events.size()}}
                           .dump());
  } else {
    fmt::print("{} at {:.4f} s: {}, {} in the last {:.0f} ms{}\n", arguments.capture, moment.view.time_s,
               figures_text(moment), counted(moment.view.events.size(), "event"), 1e3 * kEventsShown_s,
               arguments.output.empty() ? "" : "; drawn to " + arguments.output);
  }
  return kDone;
}

/// The frames nearest to `count` times evenly spread from `from_s` to `to_s`, each once. Indices into `times_s`, ascending.
std::vector<std::size_t> spread(const std::vector<double>& times_s, double from_s, double to_s, std::size_t count) {
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < count; ++k) {
    const double share = count == 1 ? 0.5 : static_cast<double>(k) / static_cast<double>(count - 1);
    const double wanted_s = from_s + share * (to_s - from_s);
    std::size_t nearest = times_s.size();
    for (std::size_t i = 0; i < times_s.size(); ++i) {
      if (times_s[i] < from_s - 1e-9 || times_s[i] > to_s + 1e-9) continue;
      if (nearest == times_s.size() || std::abs(times_s[i] - wanted_s) < std::abs(times_s[nearest] - wanted_s)) nearest = i;
    }
    if (nearest < times_s.size()) chosen.push_back(nearest);
  }
  std::sort(chosen.begin(), chosen.end());
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  return chosen;
}

int show_film(const InspectArguments& arguments, CaptureSource& source) {
  auto ahead = CaptureSource::open(arguments.capture);
  if (!ahead) return complain(ahead.error(), kFailed);
  const SheetTimes times = sheet_times(*ahead, arguments.sheet);
  if (times.times_s.empty()) return complain(fmt::format("{}: {}", arguments.capture, times.nothing()), kFailed);
  const auto [first, last] = std::minmax_element(times.times_s.begin(), times.times_s.end());
  report::Film film;
  film.from_s = arguments.from_s.value_or(*first);
  film.to_s = arguments.to_s.value_or(*last);
  film.columns = arguments.columns.value_or(0);
  const auto chosen = spread(times.times_s, film.from_s, film.to_s, static_cast<std::size_t>(*arguments.film));
  if (chosen.empty()) {
    return complain(fmt::format("{}: sheet {} has no frame from {} to {} s; its frames are from {:.3f} to {:.3f} s",
                                arguments.capture, times.sheet, film.from_s, film.to_s, *first, *last),
                    kFailed);
  }
  film.from_s = std::max(film.from_s, *first);
  film.to_s = std::min(film.to_s, *last);

  InspectedSheet inspected(source, times.sheet);
  auto frames = nlohmann::ordered_json::array();
  std::string lines;
  {
    Progress progress("analysing");
    std::size_t index = 0, taken = 0;
    for (; taken < chosen.size() && inspected.next(std::numeric_limits<double>::infinity()); ++index) {
      progress.show(static_cast<double>(index) / static_cast<double>(chosen.back() + 1));
      inspected.forget_events_before(film.from_s);
      if (index != chosen[taken]) continue;
      const InspectedMoment moment = inspected.moment();
      inspected.forget_events_before(std::numeric_limits<double>::infinity());
      if (taken++ == 0) film.title = title_of(arguments, moment);
      frames.push_back(figures_of(moment));
      lines += fmt::format("{:9.4f} s: {}, {}\n", moment.view.time_s, figures_text(moment),
                           counted(moment.view.events.size(), "event"));
      film.frames.push_back(moment.view);
    }
  }
  film.title += fmt::format(": {} from {:.3f} to {:.3f} s", counted(film.frames.size(), "frame"), film.from_s, film.to_s);
  const auto from_s = film.from_s, to_s = film.to_s;
  if (!arguments.output.empty()) {
    if (auto drawn = report::write_film_png(arguments.output, std::move(film)); !drawn)
      return complain(drawn.error(), kFailed);
  }
  if (arguments.json) {
    fmt::print(
        "{}\n",
        nlohmann::ordered_json{{"sheet", times.sheet}, {"from_s", from_s}, {"to_s", to_s}, {"frames", frames}}.dump());
  } else {
    fmt::print("{}", lines);
    fmt::print("{}: {} of {} from {:.3f} to {:.3f} s; events are those since the line before{}\n", arguments.capture,
               counted(chosen.size(), "frame"), times.times_s.size(), from_s, to_s,
               arguments.output.empty() ? "" : "; drawn to " + arguments.output);
  }
  return kDone;
}

int run(const InspectArguments& arguments) {
  if (auto wrong = misuse(arguments); !wrong.empty()) return complain(wrong, kWrongUsage);
  auto source = CaptureSource::open(arguments.capture);
  if (!source) return complain(source.error(), std::filesystem::exists(arguments.capture) ? kFailed : kWrongUsage);
  const int status = arguments.film ? show_film(arguments, *source) : show_frame(arguments, *source);
  if (status != kDone) return status;
  while (source->next()) {  // whether the file ends as it should shows at its end only
  }
  return done_with(notices_of(*source));
}

}  // namespace

void add_inspect(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<InspectArguments>();
  auto* command = app.add_subcommand("inspect", "Draw what the analysis sees in a capture: one frame, or a film of several");
  command->footer(
      "Example: rustle inspect crumple.mcap --time 1.5 -o frame.png\n"
      "         rustle inspect crumple.mcap --film 12 --from 0.5 --to 2 -o film.png\n"
      "Drawn are regions, rulings, ridges, free borders, contacts and events. A film is one picture of N frames evenly\n"
      "spread over the time, with one camera and scale; its events are those since the frame before.");
  command->add_option("CAPTURE", arguments->capture, "The capture (.mcap)")->required();
  command->add_option("--time", arguments->time_s, "Simulation time in s: the last frame up to it is shown");
  command->add_option("--film", arguments->film, "Show so many frames, 1 to 100");
  command->add_option("--from", arguments->from_s, "Simulation time in s at which a film begins; the capture's when absent");
  command->add_option("--to", arguments->to_s, "Simulation time in s at which a film ends; the capture's when absent");
  command->add_option("--columns", arguments->columns, "Frames side by side in a film, 1 to 20; chosen when absent");
  command->add_option("--sheet", arguments->sheet, "Id of the sheet; the first one when absent");
  command->add_option("-o,--output", arguments->output, "PNG file to draw");
  command->add_flag("--json", arguments->json, "Print regions, contacts and events as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
