// A sheet of paper that is torn from the keyboard, or by lines on standard input, and heard through a running rustled.
//
//   rustled &
//   build/release/bin/examples/tear_by_hand                                   keys, in real time
//   echo "turn 0.3 0.3 0.6" | build/release/bin/examples/tear_by_hand
//
// What an application does with a torn sheet: it tells TearingSheet what the hands do, sends a new topology whenever the
// mesh was cut, and a frame 60 times a second. After every action a line of JSON says what became of it.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client_sdk/cpp/session.h"
#include "client_sdk/examples/hand_script.h"
#include "client_sdk/sheets/tearing_scripts.h"
#include "client_sdk/sheets/tearing_sheet.h"

namespace {

using namespace rustle;
using examples::HandAction;

constexpr double kFrame_s = 1.0 / 60;

struct Arguments {
  std::string control = client::Endpoints{}.control;
  std::uint64_t seed = 1;
  bool sends_tips = true;
};

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "tear_by_hand: %s\n", what.c_str());
  std::exit(1);
}

template <typename T>
T take(tl::expected<T, client::Error> result) {
  if (!result) fail(client::to_string(result.error()));
  return std::move(*result);
}

sheets::TearingSheet new_sheet(std::uint64_t seed) {
  sheets::TearingOptions options;
  options.seed = seed;
  auto sheet = sheets::TearingSheet::make(options);
  if (!sheet) fail(sheet.error());
  return std::move(*sheet);
}

/// The torn sheet and the session it is sent to.
class Table {
 public:
  Table(client::Session session, const Arguments& arguments)
      : session_(std::move(session)), arguments_(arguments), sheet_(new_sheet(arguments.seed)) {
    from_tip_ = sheets::thumbs_from_tip(sheet_.pose());
    client::SceneUpdate scene;
    scene.obstacles.push_back({.id = 1, .name = "table", .surface_material = "wooden-table", .shape = client::Plane{}});
    take(session_.scene(scene));
  }

  void fresh_sheet() {
    sheet_ = new_sheet(++seeds_ + arguments_.seed);
    from_tip_ = sheets::thumbs_from_tip(sheet_.pose());
    fresh_ = true;
  }

  /// One frame of an action, of which `left_s` are still to go.
  void step(const HandAction* action, double left_s) {
    sheets::HandMotions motions;
    if (action != nullptr && action->kind == HandAction::Kind::kGrip && !sheet_.separated())
      motions = sheets::grip_farther_on(sheet_, from_tip_, std::min(1.0, kFrame_s / left_s));
    if (action != nullptr && action->kind == HandAction::Kind::kMove) {
      const double share = kFrame_s / action->seconds;
      for (const auto side : {sheets::kLeft, sheets::kRight}) {
        motions[side].rotation_rad = share * action->whole[side].rotation_rad;
        motions[side].translation_m = share * action->whole[side].translation_m;
      }
    }
    const auto advance = sheet_.advance(motions, kFrame_s);
    if (!advance) fail(advance.error());
    least_share_ = std::min(least_share_, advance->share);
    send();
  }

  /// What became of an action.
  void tell(const std::string& action) {
    std::printf(
        "{\"action\": \"%s\", \"time_s\": %.4f, \"torn_m\": %.5f, \"share\": %.3f, \"height_m\": %.5f, \"triangles\": %zu, "
        "\"separated\": %s}\n",
        action.c_str(), time_s_, sheet_.torn_length_m(), least_share_, sheet_.cone().height_m(),
        sheet_.mesh()->triangles.size(), sheet_.separated() ? "true" : "false");
    std::fflush(stdout);
    least_share_ = 1;
  }

  void end() {
    take(session_.end());
    const auto figures = take(session_.detach());
    std::printf("{\"frames\": %llu, \"analysed\": %llu, \"refused\": %llu, \"topologies\": %llu}\n",
                static_cast<unsigned long long>(figures.frames_received),
                static_cast<unsigned long long>(figures.frames_analysed),
                static_cast<unsigned long long>(figures.messages_refused), static_cast<unsigned long long>(topology_));
  }

 private:
  void send() {
    if (sheet_.mesh() != sent_mesh_) {
      sent_mesh_ = sheet_.mesh();
      client::Topology topology;
      topology.id = ++topology_;
      topology.vertex_count = static_cast<std::uint32_t>(sent_mesh_->material_coordinates.size());
      topology.triangles = {sent_mesh_->triangles.front().data(), 3 * sent_mesh_->triangles.size()};
      topology.material_coordinates = {sent_mesh_->material_coordinates.front().data(),
                                       2 * std::size_t{topology.vertex_count}};
      take(session_.add_topology(topology));
    }
    std::vector<float> positions(3 * sent_mesh_->material_coordinates.size());
    std::vector<std::uint8_t> held(sent_mesh_->material_coordinates.size());
    sheet_.positions(positions);
    sheet_.anchored(held);
    std::vector<client::TearTip> tips;
    if (const auto tip = sheet_.tip(); tip && arguments_.sends_tips)
      tips.push_back({tip->id, tip->position_m, tip->speed_m_per_s, tip->direction});
    client::FrameExtras extras;
    extras.anchored = held;
    extras.tear_tips = tips;
    extras.reset_history = std::exchange(fresh_, false);
    take(session_.frame(1, topology_, time_s_, positions, extras));
    time_s_ += kFrame_s;
  }

  client::Session session_;
  const Arguments& arguments_;
  sheets::TearingSheet sheet_;
  std::array<sheets::Point2, 2> from_tip_;
  std::shared_ptr<const sheets::SheetMesh> sent_mesh_;
  std::uint64_t topology_ = 0, seeds_ = 0;
  double time_s_ = 0, least_share_ = 1;
  bool fresh_ = true;
};

Arguments read(int argc, char** argv) {
  Arguments arguments;
  for (int k = 1; k < argc; ++k) {
    const std::string name = argv[k];
    if (name == "--help") {
      std::printf("tear_by_hand [--control ENDPOINT] [--seed N] [--tips sent|found]\n%s", examples::kHelp);
      std::exit(0);
    }
    if (k + 1 == argc) fail(name + " takes a value; see --help");
    const std::string value = argv[++k];
    if (name == "--control") {
      arguments.control = value;
    } else if (name == "--seed") {
      arguments.seed = std::strtoull(value.c_str(), nullptr, 10);
    } else if (name == "--tips" && (value == "sent" || value == "found")) {
      arguments.sends_tips = value == "sent";
    } else {
      fail(name + " " + value + " is unknown; see --help");
    }
  }
  return arguments;
}

}  // namespace

int main(int argc, char** argv) {
  const Arguments arguments = read(argc, argv);
  examples::HandInput input;
  auto connection = take(client::Connection::connect({arguments.control, {}, {}}));
  client::SessionOptions options;
  options.name = "tear_by_hand";
  // Keys are heard at once; lines are a script, which is told as fast as the daemon takes it.
  options.clock = input.is_terminal() ? client::Clock::kLive : client::Clock::kSimulation;
  options.seed = arguments.seed;
  options.sheets = {client::SheetOptions{}};
  Table table(take(client::Session::attach(connection, options)), arguments);
  if (input.is_terminal()) std::printf("%s", examples::kHelp);
  auto due = std::chrono::steady_clock::now();
  const auto frame = [&](const HandAction* action, double left_s) {
    table.step(action, left_s);
    if (!input.is_terminal()) return;
    due += std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(kFrame_s));
    std::this_thread::sleep_until(due);
  };
  frame(nullptr, 0);
  for (;;) {
    const auto action = input.next();
    if (!action) {
      frame(nullptr, 0);
      continue;
    }
    if (action->kind == HandAction::Kind::kQuit) break;
    if (action->kind == HandAction::Kind::kNewSheet) table.fresh_sheet();
    for (double left_s = action->seconds; left_s > kFrame_s / 2; left_s -= kFrame_s) frame(&*action, left_s);
    table.tell(action->text);
  }
  table.end();
}
