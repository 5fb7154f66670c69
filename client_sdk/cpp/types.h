#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

/// What a simulator and the daemon say to each other, as plain data. Lengths are in the session's units (metres unless
/// SessionOptions say otherwise), in the session's axes; times are seconds of simulation time.
namespace rustle::client {

/// Why something did not succeed. `code` is v1::ErrorCode's number where the daemon refused (such as 7, "unknown_topology");
/// 0 where it happened on this side: "unreachable", "timeout", "invalid", "closed".
struct Error {
  int code = 0;
  std::string code_name{};
  std::string field{};    ///< such as "frame.positions"
  std::string message{};  ///< a sentence
  std::string remedy{};   ///< a sentence
};

/// "timeout: no answer from ...".
std::string to_string(const Error& error);

enum class ErrorKind {
  kInvalidArgument,  ///< an argument that cannot be sent; nothing was sent
  kUnreachable,      ///< nobody answers at the endpoint, or the daemon is gone
  kTimedOut,         ///< the daemon is there, but what was waited for did not come in time
  kRefused,          ///< the daemon said no
  kSessionLost,      ///< the daemon no longer has the session: it was started anew, or ended it because nothing came
  kClosed,           ///< the session was detached on this side
  kOther,            ///< such as "malformed", "too_large"
};
ErrorKind kind_of(const Error& error);

/// CURVE keys, Z85 of 40 characters each. read_keys() of client_sdk/cpp/certificate.h reads them from a folder.
struct Keys {
  std::string public_key{}, secret_key{};  ///< one's own
  std::string server_key{};                ///< the daemon's public key: nobody else is talked to
};

/// Where the daemon is. Empty: asked from the daemon.
struct Endpoints {
  std::string control = "tcp://127.0.0.1:7390";
  std::string stream{};
  std::string out{};
  std::optional<Keys> keys{};  ///< of a daemon that was started with keys
};

enum class Clock { kLive, kSimulation };
enum class UpAxis { kZ, kY };
enum class SynthesisMode { kCorrected, kPublished };
enum class Channels { kMono, kStereo, kBinaural };
enum class SheetKind { kPaper, kCloth };
enum class SoundKind { kCrumpling, kFriction, kTearing };

struct SheetOptions {
  std::uint32_t id = 1;
  std::string name{};
  SheetKind kind = SheetKind::kPaper;
  std::string material{};         ///< a sound pack's, such as "printer-paper"; empty: the session's default
  std::string touched_surface{};  ///< empty: "wooden-table"
  std::optional<double> grammage_kg_per_m2{};
  std::optional<double> thickness_m{};
};

struct SessionOptions {
  std::string name{};  ///< for people
  Clock clock = Clock::kLive;
  double time_origin_s = 0;  ///< the simulation time of the first sample
  double metres_per_unit = 1;
  UpAxis up_axis = UpAxis::kZ;
  std::uint64_t seed = 0;
  SynthesisMode mode = SynthesisMode::kCorrected;
  std::optional<double> playout_delay_s{};  ///< absent: the daemon's choice
  std::uint32_t rate_hz = 0;                ///< 0: the daemon's
  std::uint32_t block_size = 0;             ///< 0: the daemon's
  Channels channels = Channels::kStereo;
  std::string default_material{};       ///< empty: "printer-paper"
  bool record = false;                  ///< the daemon records the session from its first sample on
  std::string hrtf{};                   ///< binaural: "structural", "kemar" or one the daemon offers; empty: the daemon's
  std::uint32_t friction_fft_size = 0;  ///< a power of two, 128 to 8192; 0: the daemon's
  std::uint32_t most_voices = 0;        ///< at a time, 1 to 512; 0: 512, or what the key may have
  std::vector<SheetOptions> sheets{};   ///< more may follow by add_sheet()
};

/// Immutable once sent; the spans are read during the call only.
struct Topology {
  std::uint64_t id = 1;
  std::uint32_t vertex_count = 0;
  std::span<const std::uint32_t> triangles{};     ///< [T,3], counter-clockwise seen from the side the normals point to
  std::span<const float> material_coordinates{};  ///< [V,2] or empty
  std::span<const float> rest_positions{};        ///< [V,3] or empty
};

struct ContactPartner {
  bool is_sheet = false;  ///< else an obstacle
  std::uint32_t id = 0;
};

/// Contacts that the simulator knows, one entry each in parallel arrays.
struct Contacts {
  std::span<const std::uint32_t> vertices{};  ///< [C]
  std::span<const std::uint32_t> partners{};  ///< [C], into the table
  std::vector<ContactPartner> partner_table{};
  std::span<const float> slip_velocities{};  ///< [C,3] or empty
  std::span<const float> normal_forces{};    ///< [C], newtons: what is pressed is louder; empty: its own weight
};

/// The simulator's own partition into developable regions.
struct Partition {
  std::span<const std::uint32_t> triangle_regions{};   ///< [T], 0xffffffff: none
  std::span<const std::uint8_t> region_curved{};       ///< [R]
  std::span<const float> rulings{};                    ///< [L,6]
  std::span<const std::uint32_t> ruling_regions{};     ///< [L]
  std::span<const float> singular_points{};            ///< [S,3]
  std::span<const std::uint8_t> singular_on_border{};  ///< [S] or empty
};

using Vector3 = std::array<double, 3>;
using Quaternion = std::array<double, 4>;  ///< w, x, y, z

struct TearTip {
  std::uint32_t id = 0;
  Vector3 position{};
  double speed = 0;  ///< units per second
  std::optional<Vector3> direction{};
};

/// What a frame may say beyond positions.
struct FrameExtras {
  std::span<const float> velocities{};       ///< [V,3] or empty
  std::span<const std::uint8_t> anchored{};  ///< [V] or empty
  bool reset_history = false;
  std::optional<Contacts> contacts{};  ///< present: replace what proximity finds
  std::optional<Partition> partition{};
  std::span<const TearTip> tear_tips{};
};

struct Pose {
  Vector3 position{};
  Quaternion orientation{1, 0, 0, 0};
};

/// Solid below; the normal need not have unit length.
struct Plane {
  Vector3 point{};
  Vector3 normal{0, 0, 1};
};
struct Box {
  Vector3 half_extents{};
};
struct Sphere {
  double radius = 0;
};
/// Along z from -half_length to +half_length, caps beyond.
struct Capsule {
  double radius = 0;
  double half_length = 0;
};
struct Mesh {
  std::span<const std::uint32_t> triangles{};  ///< [T,3]
  std::span<const float> vertices{};           ///< [V,3]
};

struct Obstacle {
  std::uint32_t id = 0;
  std::string name{};
  std::string surface_material{};  ///< empty: the sheet's touched_surface
  bool reflecting = false;         ///< planes only
  double reflection_coefficient = 1;
  std::variant<Plane, Box, Sphere, Capsule, Mesh> shape{};
  Pose pose{};
};

struct SceneUpdate {
  double time_s = 0;
  std::vector<Obstacle> obstacles{};  ///< created or replaced
  std::vector<std::pair<std::uint32_t, Pose>> poses{};
  std::vector<std::pair<std::uint32_t, std::span<const float>>> vertices{};  ///< of mesh obstacles, [V,3]
  std::vector<std::uint32_t> removed{};
};

struct Listener {
  double time_s = 0;
  Vector3 position{};
  std::optional<Vector3> forward{};  ///< absent: toward the sheets
  std::optional<Vector3> up{};       ///< absent: the session's up axis
};

/// A sound's level is the product of all gains that concern it.
struct Gain {
  double gain_db = 0;                       ///< -200 to 24, or -infinity: silence
  std::optional<std::uint32_t> sheet_id{};  ///< absent: every sheet
  std::optional<SoundKind> kind{};          ///< absent: every kind
  std::string material{};                   ///< empty: every material
};

struct ServerInfo {
  std::string server{};
  std::string stream_endpoint{}, out_endpoint{};
  std::uint32_t rate_hz = 0;
  std::uint32_t block_size = 0;
  std::uint32_t sessions = 0;       ///< there, when it was asked
  std::uint32_t most_sessions = 0;  ///< there may be; 0: it does not say
};

struct PackInfo {
  std::string name{}, material{}, touched_surface{}, version{}, licence{};
  std::uint32_t rate_hz = 0, units = 0, spectra = 0;
  std::vector<std::string> models{};
};

/// A file in the daemon's recording folder.
struct RecordingInfo {
  std::string file_name{};
  std::uint64_t messages = 0, bytes = 0;
};

struct SessionInfo {
  std::string session_id{}, name{};
  Clock clock = Clock::kLive;
  std::uint32_t sheets = 0;
  double newest_time_s = 0;
  std::optional<RecordingInfo> recording{};  ///< present: it is recorded; so far
};

/// As proto/rustle/v1/session.proto says of each.
struct Statistics {
  std::string session_id{};
  std::uint64_t messages_received = 0, frames_received = 0, frames_analysed = 0;
  std::map<std::string, std::uint64_t> frames_dropped{};  ///< by cause
  std::uint64_t messages_refused = 0, sequence_gaps = 0;
  std::uint64_t samples_due = 0, samples_sent = 0, samples_in_gaps = 0;
  std::uint64_t voices = 0, voices_most = 0, voices_stolen = 0, voices_dropped = 0;
  std::uint64_t sources_dropped = 0, cues_dropped = 0, sounds_missing = 0, planes_left_out = 0;
  std::uint64_t samples_limited = 0, samples_not_finite = 0, voices_merged = 0;
  std::uint64_t emitter_samples_left_out = 0;
  std::uint64_t frames_late = 0, time_jumps = 0, input_gaps = 0, samples_in_input_gaps = 0;
  std::uint64_t pcm_gaps = 0, deadline_misses = 0, late_by_run_delay = 0;
  std::uint64_t events_joined = 0;
  std::uint64_t crumpling_events = 0, friction_episodes = 0, tear_events = 0;
  double newest_time_s = 0, rendered_time_s = 0, playout_delay_s = 0, clock_drift_ppm = 0;
  std::uint32_t load_level = 0;
};

/// A figure of Statistics by the name it has in session.proto.
struct Figure {
  std::string name{};
  std::variant<std::uint64_t, double> value{};
};
/// All numbers of Statistics, in their order.
std::vector<Figure> figures(const Statistics& statistics);

/// Figures of the daemon, as proto/rustle/v1/session.proto says of each.
struct ThreadStatistics {
  std::string name{};
  std::uint64_t count = 0;
  double cpu_s = 0, waited_s = 0;
};
struct PlaybackStatistics {
  std::string device{};
  std::uint32_t rate_hz = 0;
  std::uint64_t samples_played = 0, samples_missed = 0, devices_opened = 0, devices_lost = 0;
  std::uint64_t samples_in_gaps = 0, samples_left_out = 0, splices = 0;
};
struct ServerStatistics {
  double uptime_s = 0, cpu_s = 0;
  std::uint32_t sessions = 0;
  std::vector<ThreadStatistics> threads{};
  std::optional<PlaybackStatistics> playback{};  ///< absent: it plays nothing
};

enum class NoticeLevel { kInfo, kWarning, kError };

/// What the daemon says about a stream message.
struct Notice {
  NoticeLevel level = NoticeLevel::kInfo;
  std::string code{};  ///< such as "unknown_topology"
  std::string field{}, message{}, remedy{};
  std::uint64_t sequence = 0;  ///< of the message it is about; 0: none
  std::uint64_t count = 1;     ///< how often since the last notice of this code
};

/// "not_finite in frame.positions: Vertex 3 is nan. Stop there. (2 times)".
std::string to_string(const Notice& notice);

}  // namespace rustle::client
