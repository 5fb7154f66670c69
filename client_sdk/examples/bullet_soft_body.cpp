// A soft body of Bullet's, attached to a running rustled: a sheet is shaken by two of its corners, then drawn over a ball
// that lies on a table.
//
//   rustled &
//   build/release/bin/examples/bullet_soft_body sheet.wav
//
// usage: bullet_soft_body [--live] [WAV [CONTROL_ENDPOINT]]
// With --live it goes at the pace of a clock, for `rustle listen` or the daemon's sound card, and writes no file.
//
// What an engine has to do: the nodes of the soft body are the sheet's vertices, its faces the triangles, nodes without mass
// are held; rigid bodies are obstacles. Bullet is tuned for things of about a metre, so the sheet is ten times as large as
// paper, gravity too, and the session is told so: a unit is 0.1 m.
#include <BulletSoftBody/btSoftBody.h>
#include <BulletSoftBody/btSoftBodyHelpers.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <BulletSoftBody/btSoftRigidDynamicsWorld.h>
#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client_sdk/cpp/session.h"

namespace {

using namespace rustle;

constexpr double kMetresPerUnit = 0.1, kFrame_s = 1.0 / 60, kSeconds = 3.5;
constexpr int kColumns = 15, kRows = 21, kSubsteps = 8;
constexpr btScalar kWidth = 2.1f, kHeight = 2.97f, kRadius = 0.4f, kGap = 0.015f;  // 1.5 mm: sliding is heard within 3 mm

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "bullet_soft_body: %s\n", what.c_str());
  std::exit(1);
}

template <typename T>
T take(tl::expected<T, client::Error> result) {
  if (!result) fail(client::to_string(result.error()));
  return std::move(*result);
}

/// A table, a ball, and a sheet that two hands hold.
class World {
 public:
  World() {
    world_.setGravity({0, 0, btScalar(-9.81 / kMetresPerUnit)});
    world_.getWorldInfo().m_gravity = world_.getGravity();
    world_.getWorldInfo().air_density = 0.1f;
    add(table_, {0, 0, 0});
    add(ball_, {0, 0.6f, kRadius});
    sheet_.reset(btSoftBodyHelpers::CreatePatch(world_.getWorldInfo(), {-kWidth / 2, 0, 1}, {kWidth / 2, 0, 1},
                                                {-kWidth / 2, 0, 1 + kHeight}, {kWidth / 2, 0, 1 + kHeight}, kColumns, kRows,
                                                0, true));
    btSoftBody::Material* material = sheet_->appendMaterial();
    material->m_kLST = 0.6f;
    sheet_->generateBendingConstraints(2, material);
    sheet_->setTotalMass(0.5f);
    sheet_->getCollisionShape()->setMargin(kGap);
    sheet_->m_cfg.piterations = 10;
    sheet_->m_cfg.kDP = 0.003f;
    sheet_->m_cfg.kDF = 0.3f;
    for (int node = kColumns * (kRows - 1); node < kColumns * kRows; ++node) {
      const int column = node % kColumns;
      if (column > 1 && column < kColumns - 2) continue;
      sheet_->setMass(node, 0);
      held_.emplace_back(node, sheet_->m_nodes[node].m_x);
    }
    world_.addSoftBody(sheet_.get());
  }
  ~World() { world_.removeSoftBody(sheet_.get()); }
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  void step(double t) {
    for (int substep = 1; substep <= kSubsteps; ++substep) {
      const btScalar dt = btScalar(kFrame_s) / kSubsteps;
      for (const auto& [node, place] : held_) {
        btSoftBody::Node& hand = sheet_->m_nodes[node];
        const btVector3 next = place + hands(t + substep * static_cast<double>(dt));
        hand.m_v = (next - hand.m_x) / dt;
        hand.m_q = hand.m_x = next;
      }
      world_.stepSimulation(dt, 0);
    }
  }

  std::vector<client::Obstacle> obstacles() const {
    client::Obstacle ball{.id = 2, .name = "ball", .shape = client::Sphere{kRadius}};
    ball.pose.position = {0, 0.6, kRadius};
    return {{.id = 1, .name = "table", .reflecting = true, .shape = client::Plane{}}, ball};
  }

  std::vector<std::uint32_t> triangles() const {
    std::vector<std::uint32_t> out;
    for (int face = 0; face < sheet_->m_faces.size(); ++face)
      for (const btSoftBody::Node* corner : sheet_->m_faces[face].m_n)
        out.push_back(static_cast<std::uint32_t>(corner - &sheet_->m_nodes[0]));
    return out;
  }

  /// Before anything moves the sheet is flat.
  std::vector<float> material_coordinates() const {
    std::vector<float> out;
    for (int node = 0; node < sheet_->m_nodes.size(); ++node)
      out.insert(out.end(), {float(sheet_->m_nodes[node].m_x.x()), float(sheet_->m_nodes[node].m_x.z())});
    return out;
  }

  void frame(std::vector<float>& positions, std::vector<std::uint8_t>& anchored) const {
    positions.clear();
    anchored.clear();
    for (int k = 0; k < sheet_->m_nodes.size(); ++k) {
      const btSoftBody::Node& node = sheet_->m_nodes[k];
      positions.insert(positions.end(), {float(node.m_x.x()), float(node.m_x.y()), float(node.m_x.z())});
      anchored.push_back(node.m_im == 0 ? 1 : 0);
    }
  }

 private:
  void add(btCollisionShape& shape, const btVector3& place) {
    bodies_.push_back(std::make_unique<btRigidBody>(0, nullptr, &shape));
    bodies_.back()->setWorldTransform(btTransform(btQuaternion::getIdentity(), place));
    bodies_.back()->setFriction(0.5f);
    world_.addRigidBody(bodies_.back().get());
  }

  /// Where the hands have gone by then.
  static btVector3 hands(double t) {
    const double shake = t < 1.5 ? 0.5 * std::sin(2 * SIMD_PI * 4 * t) : 0;
    const double down = std::clamp((t - 1.7) / 0.6, 0.0, 1.0), along = std::clamp((t - 2.0) / 1.3, 0.0, 1.0);
    return {0, btScalar(shake + 2.5 * along), btScalar(-3.2 * down)};
  }

  btStaticPlaneShape table_{{0, 0, 1}, 0};
  btSphereShape ball_{kRadius};
  btSoftBodyRigidBodyCollisionConfiguration configuration_{};
  btCollisionDispatcher dispatcher_{&configuration_};
  btDbvtBroadphase broadphase_{};
  btSequentialImpulseConstraintSolver solver_{};
  btSoftRigidDynamicsWorld world_{&dispatcher_, &broadphase_, &solver_, &configuration_};
  std::vector<std::unique_ptr<btRigidBody>> bodies_{};
  std::unique_ptr<btSoftBody> sheet_{};
  std::vector<std::pair<int, btVector3>> held_{};
};

void simulate(client::Session& session, bool live) {
  World world;
  take(session.scene({.obstacles = world.obstacles()}));
  const auto triangles = world.triangles();
  const auto flat = world.material_coordinates();
  take(session.add_topology({.id = 1,
                             .vertex_count = static_cast<std::uint32_t>(flat.size() / 2),
                             .triangles = triangles,
                             .material_coordinates = flat}));
  std::vector<float> positions;
  std::vector<std::uint8_t> anchored;
  const auto begun = std::chrono::steady_clock::now();
  for (int frame = 0; frame < static_cast<int>(kSeconds / kFrame_s); ++frame) {
    const double t = frame * kFrame_s;
    if (live)
      std::this_thread::sleep_until(
          begun + std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(t)));
    world.frame(positions, anchored);
    take(session.frame(1, 1, t, positions, {.anchored = anchored}));
    world.step(t);
  }
  take(session.end());
}

/// 32-bit floats.
void write_wav(const std::string& path, const client::Sound& sound) {
  std::ofstream file(path, std::ios::binary);
  const auto put = [&](std::uint32_t value, int bytes) {
    for (int k = 0; k < bytes; ++k) file.put(static_cast<char>(value >> 8 * k & 0xff));
  };
  const auto bytes = static_cast<std::uint32_t>(sizeof(float) * sound.interleaved.size());
  file << "RIFF";
  put(36 + bytes, 4);
  file << "WAVEfmt ";
  put(16, 4);
  put(3, 2);
  put(sound.channels, 2);
  put(sound.rate_hz, 4);
  put(4 * sound.rate_hz * sound.channels, 4);
  put(4 * sound.channels, 2);
  put(32, 2);
  file << "data";
  put(bytes, 4);
  file.write(static_cast<const char*>(static_cast<const void*>(sound.interleaved.data())), bytes);
  if (!file.flush()) fail(path + " could not be written");
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  const bool live = std::erase(arguments, "--live") > 0;
  client::Endpoints endpoints;
  if (arguments.size() > 1) endpoints.control = arguments[1];
  const auto connection = take(client::Connection::connect(endpoints));
  auto session = take(client::Session::attach(connection, {.name = "bullet",
                                                           .clock = live ? client::Clock::kLive : client::Clock::kSimulation,
                                                           .metres_per_unit = kMetresPerUnit,
                                                           .sheets = {{.id = 1}}}));
  if (live) {
    simulate(session, true);
  } else {
    auto reader = take(session.listen());
    simulate(session, false);
    write_wav(arguments.empty() ? "bullet.wav" : arguments[0], take(reader.read_all()));
  }
  const auto figures = take(session.detach());
  std::printf("%llu frames, %llu crumpling events, %llu contacts that slid\n",
              static_cast<unsigned long long>(figures.frames_analysed),
              static_cast<unsigned long long>(figures.crumpling_events),
              static_cast<unsigned long long>(figures.friction_episodes));
}
