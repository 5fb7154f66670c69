/** Rustle's C SDK: attach a simulator to `rustled`, send its sheets, hear them. Plain C99, for any language that calls C.
 *
 *   rustle_connection* daemon;
 *   rustle_session* session;
 *   rustle_reader* reader;
 *   rustle_sheet sheet = {.id = 1};
 *   rustle_session_options options = {.name = "flag", .clock = RUSTLE_CLOCK_SIMULATION, .sheets = &sheet, .sheet_count = 1};
 *   rustle_topology topology = {.id = 1, .vertex_count = V, .triangles = triangles, .triangle_count = T};
 *   rustle_connect(NULL, &daemon);
 *   rustle_attach(daemon, &options, &session);
 *   rustle_listen(session, NULL, &reader);
 *   rustle_add_topology(session, &topology);
 *   for (...) rustle_frame(session, &(rustle_mesh_frame){.sheet_id = 1, .topology_id = 1, .time_s = t, .positions = xyz});
 *   rustle_end(session, NULL);
 *   rustle_read_all(reader, 60, &sound);
 *
 * Structs      One that is all zeros holds the defaults; pointers to structs may be NULL where that is said. What a call is
 *              given is read during the call only. Texts are UTF-8; NULL is the empty text.
 * Arrays       Row after row; shapes stand in brackets: V vertices, T triangles, C contacts. Floats are 32-bit, indices
 *              count from 0 and are 32-bit.
 * Units        Lengths in the session's units (metres unless its options say otherwise), in its axes (z up unless they say
 *              otherwise); times in seconds of simulation time; timeouts in seconds of the clock on the wall.
 * Errors       A status below 0 is an error, and rustle_last_error() says what is wrong, where, and what to do. An output
 *              argument of a call that failed is not written to.
 * Threads      A connection serves any thread. A session or a reader serves one thread at a time; each may have its own.
 *              No call starts a thread of this library's that calls back.
 * Order        Free readers and sessions before or after their connection, as you like: each keeps what it needs.
 */
#ifndef RUSTLE_H
#define RUSTLE_H

#include <stddef.h>
#include <stdint.h>

#if defined(RUSTLE_STATIC)
#define RUSTLE_API
#elif defined(_WIN32) && defined(RUSTLE_BUILDS_LIBRARY)
#define RUSTLE_API __declspec(dllexport)
#elif defined(_WIN32)
#define RUSTLE_API __declspec(dllimport)
#elif defined(__GNUC__)
#define RUSTLE_API __attribute__((visibility("default")))
#else
#define RUSTLE_API
#endif

/* Enumerations are 32 bits wide, and in C++ too any number may be said, which is then an error. */
#ifdef __cplusplus
#define RUSTLE_ENUM : int32_t
extern "C" {
#else
#define RUSTLE_ENUM
#endif

/* ---- what can go wrong */

typedef enum rustle_status RUSTLE_ENUM {
  RUSTLE_OK = 0,
  RUSTLE_DROPPED = 1,  /**< LIVE clock only: left out and counted, for the queue was full or the daemon is away */
  RUSTLE_NOTHING = 2,  /**< nothing came in time */
  RUSTLE_COMPLETE = 3, /**< the sound has come to its end */

  RUSTLE_INVALID_ARGUMENT = -1, /**< an argument that cannot be sent; nothing was sent */
  RUSTLE_UNREACHABLE = -2,      /**< nobody answers at the endpoint, or the daemon is gone */
  RUSTLE_TIMED_OUT = -3,        /**< the daemon is there, but what was waited for did not come in time */
  RUSTLE_REFUSED = -4,          /**< the daemon said no */
  RUSTLE_SESSION_LOST = -5, /**< the daemon has the session no longer: it was started anew, or nothing came for too long */
  RUSTLE_CLOSED = -6,       /**< the session was detached on this side */
  RUSTLE_OTHER = -7         /**< such as a message that is too large, or no memory */
} rustle_status;

typedef struct rustle_error {
  rustle_status status;
  int32_t code;          /**< of the protocol where the daemon refused, such as 7; 0 where it happened on this side */
  const char* code_name; /**< such as "unknown_topology", "unreachable", "timeout", "invalid" */
  const char* field;     /**< such as "frame.positions"; may be empty */
  const char* message;   /**< a sentence */
  const char* remedy;    /**< a sentence; may be empty */
} rustle_error;

/** Why the newest call of this thread that failed did so; valid until one fails again. Never NULL. */
RUSTLE_API const rustle_error* rustle_last_error(void);

/** Of this library, such as "0.1.0". */
RUSTLE_API const char* rustle_version(void);

/* ---- connections */

/** The control socket of a daemon: what is asked and answered. Comes back by itself when the daemon does. */
typedef struct rustle_connection rustle_connection;

/** CURVE keys, Z85 of 40 characters each. */
typedef struct rustle_keys {
  const char* public_key; /**< one's own */
  const char* secret_key; /**< one's own */
  const char* server_key; /**< the daemon's public key: nobody else is talked to */
} rustle_keys;

typedef struct rustle_endpoints {
  const char* control;     /**< NULL: "tcp://127.0.0.1:7390" */
  const char* stream;      /**< NULL: asked from the daemon */
  const char* out;         /**< NULL: asked from the daemon */
  const rustle_keys* keys; /**< NULL: none, or those of `keys_folder` */
  const char* keys_folder; /**< as `rustle keys new` makes it: one NAME.key_secret, and server.key; NULL: none */
  double timeout_s;        /**< of this and every later request; 0: 5 s */
} rustle_endpoints;

/** Says hello and waits for the welcome. `endpoints` may be NULL. Free with rustle_disconnect().
 * Errors: INVALID_ARGUMENT (endpoint, keys), UNREACHABLE (nobody answers, or not to this key), REFUSED (other version). */
RUSTLE_API rustle_status rustle_connect(const rustle_endpoints* endpoints, rustle_connection** connection);
/** NULL is left alone. */
RUSTLE_API void rustle_disconnect(rustle_connection* connection);

/** Whether the daemon is there, without asking it: at once. Error: UNREACHABLE, soon after it has gone. */
RUSTLE_API rustle_status rustle_check(rustle_connection* connection);

typedef struct rustle_server {
  char name[64]; /**< the daemon's name and version, cut where it is longer */
  uint32_t rate_hz;
  uint32_t block_size;
} rustle_server;

/** What the newest welcome said. */
RUSTLE_API rustle_status rustle_get_server(rustle_connection* connection, rustle_server* server);

/* ---- sessions */

/** A simulator's session with the daemon.
 *
 * SIMULATION clock: sound follows simulation time; every message waits until the daemon has room for it, at most the send
 * timeout; nothing is dropped, and the same messages give the same samples.
 * LIVE clock: sound follows the audio clock; rustle_frame(), rustle_tear_tips(), rustle_listener() and rustle_advance()
 * never wait, and are RUSTLE_DROPPED where the queue is full. The others wait for room, at most the send timeout.
 *
 * What the daemon refuses later comes back as a notice: rustle_next_notice().
 *
 * A daemon that goes away is waited for where the session reconnects: whatever is sent to the daemon that came back goes on
 * under the same session id, after sheets, topologies, scene, listener and gains. LIVE: nothing waits and nothing is an
 * error meanwhile. SIMULATION: calls wait, at most the send timeout. Else it is UNREACHABLE within two seconds, and one that
 * was started anew is SESSION_LOST. */
typedef struct rustle_session rustle_session;

typedef enum rustle_clock RUSTLE_ENUM { RUSTLE_CLOCK_LIVE = 0, RUSTLE_CLOCK_SIMULATION = 1 } rustle_clock;
typedef enum rustle_up_axis RUSTLE_ENUM { RUSTLE_UP_Z = 0, RUSTLE_UP_Y = 1 } rustle_up_axis;
typedef enum rustle_channels RUSTLE_ENUM { RUSTLE_STEREO = 0, RUSTLE_MONO = 1, RUSTLE_BINAURAL = 2 } rustle_channels;
typedef enum rustle_sheet_kind RUSTLE_ENUM { RUSTLE_PAPER = 0, RUSTLE_CLOTH = 1 } rustle_sheet_kind;
typedef enum rustle_sound_kind RUSTLE_ENUM {
  RUSTLE_EVERY_KIND = 0,
  RUSTLE_CRUMPLING = 1,
  RUSTLE_FRICTION = 2,
  RUSTLE_TEARING = 3
} rustle_sound_kind;
typedef enum rustle_reconnect RUSTLE_ENUM {
  RUSTLE_RECONNECT_AS_CLOCK = 0, /**< LIVE does, SIMULATION, which promises the same samples, does not */
  RUSTLE_RECONNECT_ALWAYS = 1,
  RUSTLE_RECONNECT_NEVER = 2
} rustle_reconnect;

typedef struct rustle_sheet {
  uint32_t id;
  rustle_sheet_kind kind;
  const char* name;
  const char* material;        /**< a sound pack's, such as "printer-paper"; NULL: the session's default */
  const char* touched_surface; /**< NULL: "wooden-table" */
  double grammage_kg_per_m2;   /**< 0: the material's */
  double thickness_m;          /**< 0: the material's */
} rustle_sheet;

typedef struct rustle_session_options {
  const char* name; /**< for people */
  rustle_clock clock;
  rustle_up_axis up_axis;
  rustle_channels channels;
  rustle_reconnect reconnect;
  int32_t published_formulas; /**< 1: the papers' as printed; 0: corrected */
  int32_t record;             /**< 1: the daemon records the session from its first sample on */
  int32_t sets_playout_delay; /**< 1: `playout_delay_s` holds; 0: the daemon chooses */
  double playout_delay_s;
  double time_origin_s;   /**< the simulation time of the first sample */
  double metres_per_unit; /**< 0: 1 */
  uint64_t seed;
  uint32_t rate_hz;             /**< 0: the daemon's */
  uint32_t block_size;          /**< samples; 0: the daemon's */
  uint32_t friction_fft_size;   /**< a power of two, 128 to 8192; 0: the daemon's */
  uint32_t most_voices;         /**< at a time, 1 to 512; 0: 512, or what the key may have */
  const char* default_material; /**< NULL: "printer-paper" */
  const char* hrtf;             /**< binaural: "structural", "kemar" or one the daemon offers; NULL: the daemon's */
  const rustle_sheet* sheets;   /**< [sheet_count]; more may follow by rustle_add_sheet() */
  size_t sheet_count;
} rustle_session_options;

/** Returns when the daemon takes the session's stream and its answers are heard: nothing is lost at the start. `options` may
 * be NULL. Free with rustle_detach() or rustle_free_session().
 * Errors: the daemon's, such as an unknown material, TIMED_OUT, INVALID_ARGUMENT. */
RUSTLE_API rustle_status rustle_attach(rustle_connection* connection, const rustle_session_options* options,
                                       rustle_session** session);
/** Ends the session at the daemon where that is not yet done; what was sent is still rendered. NULL is left alone. */
RUSTLE_API void rustle_free_session(rustle_session* session);
/** Ends the session at the daemon; rustle_statistics() then has its last figures. `discard`: what was not yet rendered is
 * dropped. It has still to be freed. */
RUSTLE_API rustle_status rustle_detach(rustle_session* session, int32_t discard);

/** Valid as long as the session. */
RUSTLE_API const char* rustle_session_id(const rustle_session* session);
/** As settled by the daemon: 48000 unless told otherwise. */
RUSTLE_API uint32_t rustle_session_rate_hz(const rustle_session* session);
/** 10 s unless set. */
RUSTLE_API rustle_status rustle_set_send_timeout(rustle_session* session, double timeout_s);

RUSTLE_API rustle_status rustle_add_sheet(rustle_session* session, const rustle_sheet* sheet);

/** The triangles of one or several sheets; immutable once sent. */
typedef struct rustle_topology {
  uint64_t id;
  uint32_t vertex_count;             /**< V */
  const uint32_t* triangles;         /**< [T,3] below V, counter-clockwise seen from where the normals point to */
  size_t triangle_count;             /**< T */
  const float* material_coordinates; /**< [V,2] the flat sheet before it was ever bent; NULL: unknown */
  const float* rest_positions;       /**< [V,3] the sheet at rest; NULL: unknown */
} rustle_topology;

/** A mesh that changed is a topology with another id; simulators that remesh give material coordinates. */
RUSTLE_API rustle_status rustle_add_topology(rustle_session* session, const rustle_topology* topology);

typedef struct rustle_contact_partner {
  int32_t is_sheet; /**< 1: a sheet; 0: an obstacle */
  uint32_t id;
} rustle_contact_partner;

/** Contacts that the simulator knows, one entry each in parallel arrays; none at all: the sheet touches nothing. */
typedef struct rustle_contacts {
  size_t count;             /**< C */
  const uint32_t* vertices; /**< [C] below V */
  const uint32_t* partners; /**< [C] into partner_table */
  const rustle_contact_partner* partner_table;
  size_t partner_count;
  const float* slip_velocities; /**< [C,3] units per second; NULL: from the motion */
  const float* normal_forces;   /**< [C] newtons: what is pressed is louder; NULL: its own weight */
} rustle_contacts;

typedef struct rustle_tear_tip {
  uint32_t id;
  double position[3];
  double speed;          /**< units per second */
  int32_t has_direction; /**< 1: `direction` holds */
  double direction[3];
} rustle_tear_tip;

/** The simulator's own partition of the sheet into developable regions, in place of what the geometry shows. */
typedef struct rustle_partition {
  const uint32_t*
      triangle_regions; /**< [triangle_count] below region_count, as many as the topology has; 0xffffffff: none */
  size_t triangle_count;
  const uint8_t* region_curved; /**< [region_count] 1: curved, 0: flat */
  size_t region_count;
  const float* rulings;           /**< [ruling_count,6] both ends of each */
  const uint32_t* ruling_regions; /**< [ruling_count] */
  size_t ruling_count;
  const float* singular_points;      /**< [singular_count,3] */
  const uint8_t* singular_on_border; /**< [singular_count] 1: on the sheet's border; NULL: inside, all of them */
  size_t singular_count;
} rustle_partition;

typedef struct rustle_mesh_frame {
  uint32_t sheet_id;
  uint64_t topology_id;
  double time_s;                    /**< later than the sheet's frame before */
  const float* positions;           /**< [V,3] of the topology, which must have been added */
  const float* velocities;          /**< [V,3] units per second; NULL: from the motion */
  const uint8_t* anchored;          /**< [V] 1 where a hand or a pin holds the sheet; NULL: nowhere */
  int32_t reset_history;            /**< 1: the sheet jumped here; this is no motion */
  const rustle_contacts* contacts;  /**< replace what proximity finds; NULL: proximity */
  const rustle_tear_tip* tear_tips; /**< [tear_tip_count]; NULL: none, or found in the mesh */
  size_t tear_tip_count;
  const rustle_partition* partition; /**< NULL: as the geometry shows */
} rustle_mesh_frame;

/** Errors: INVALID_ARGUMENT (no such topology), see also the session. */
RUSTLE_API rustle_status rustle_frame(rustle_session* session, const rustle_mesh_frame* frame);

typedef struct rustle_pose {
  double position[3];
  double orientation[4]; /**< w, x, y, z; all 0: not turned */
} rustle_pose;

typedef enum rustle_shape RUSTLE_ENUM {
  RUSTLE_PLANE = 0,   /**< through the pose's origin: solid below, `normal` up */
  RUSTLE_BOX = 1,     /**< `half_extents` */
  RUSTLE_SPHERE = 2,  /**< `radius` */
  RUSTLE_CAPSULE = 3, /**< along z from -`half_length` to +`half_length`, caps of `radius` beyond */
  RUSTLE_MESH = 4     /**< `triangles`, `vertices` */
} rustle_shape;

typedef struct rustle_obstacle {
  uint32_t id;
  rustle_shape shape;
  rustle_pose pose;
  const char* name;
  const char* surface_material;  /**< NULL: the sheet's touched_surface */
  int32_t reflecting;            /**< planes only: 1: sound is reflected */
  double reflection_coefficient; /**< of reflecting planes; 0: 1 */
  double normal[3];              /**< of a plane, any length; all 0: the z axis */
  double half_extents[3];        /**< of a box */
  double radius;                 /**< of a sphere or capsule */
  double half_length;            /**< of a capsule */
  const uint32_t* triangles;     /**< [triangle_count,3] of a mesh */
  size_t triangle_count;
  const float* vertices; /**< [vertex_count,3] of a mesh */
  size_t vertex_count;
} rustle_obstacle;

/** Creates obstacles, or replaces those with the same ids, from this time on. */
RUSTLE_API rustle_status rustle_set_obstacles(rustle_session* session, double time_s, const rustle_obstacle* obstacles,
                                              size_t count);
RUSTLE_API rustle_status rustle_move_obstacle(rustle_session* session, double time_s, uint32_t id, const rustle_pose* pose);
/** vertices: [vertex_count,3] of a mesh obstacle, as many as it was created with. */
RUSTLE_API rustle_status rustle_deform_obstacle(rustle_session* session, double time_s, uint32_t id, const float* vertices,
                                                size_t vertex_count);
RUSTLE_API rustle_status rustle_remove_obstacle(rustle_session* session, double time_s, uint32_t id);

/** Where sound is heard. `forward` NULL: toward the sheets; `up` NULL: the up axis. */
RUSTLE_API rustle_status rustle_set_listener(rustle_session* session, double time_s, const double position[3],
                                             const double forward[3], const double up[3]);
/** Tear tips between frames. */
RUSTLE_API rustle_status rustle_tear_tips(rustle_session* session, uint32_t sheet_id, double time_s,
                                          const rustle_tear_tip* tips, size_t count);
/** Sound up to this time may be rendered, whatever is still to come. */
RUSTLE_API rustle_status rustle_advance(rustle_session* session, double time_s);
/** The last message; sound ends at this time and with its tails. `time_s` NULL: the newest time sent. */
RUSTLE_API rustle_status rustle_end(rustle_session* session, const double* time_s);
/** A serialized rustle.v1.StreamMessage, such as one of a capture; it is numbered and addressed anew.
 * Error: INVALID_ARGUMENT, where it is none. */
RUSTLE_API rustle_status rustle_send_raw(rustle_session* session, const void* message, size_t bytes);

/** Waits until everything sent was acknowledged. SIMULATION clock; at once on the LIVE clock. */
RUSTLE_API rustle_status rustle_drain(rustle_session* session, double timeout_s);

typedef enum rustle_notice_level RUSTLE_ENUM { RUSTLE_INFO = 0, RUSTLE_WARNING = 1, RUSTLE_ERROR = 2 } rustle_notice_level;

/** What the daemon says about a message it was sent. */
typedef struct rustle_notice {
  rustle_notice_level level;
  const char* code; /**< such as "unknown_topology" */
  const char* field;
  const char* message;
  const char* remedy;
  uint64_t sequence; /**< of the message; 0: of none */
  uint64_t count;    /**< how often since the last notice of this code */
} rustle_notice;

/** The oldest notice not yet told, as far as the session's calls have heard. Does not wait. NOTHING: there is none. Texts
 * are valid until this is called again with the same session. */
RUSTLE_API rustle_status rustle_next_notice(rustle_session* session, rustle_notice* notice);

typedef struct rustle_progress {
  uint64_t sent_messages;
  uint64_t dropped_messages;      /**< LIVE clock */
  uint64_t next_sequence;         /**< number of the next message; the first is 1 */
  uint64_t acknowledged_sequence; /**< SIMULATION clock: up to here the daemon has taken all */
  uint64_t stored_sequence;       /**< up to here what is recorded is on the daemon's disk */
  uint64_t reattached;            /**< how often it attached again, to a daemon that came back without it */
  int32_t connected;              /**< 0 while the daemon is away and waited for */
} rustle_progress;

/** At once, as far as the session's calls have heard. */
RUSTLE_API rustle_status rustle_get_progress(const rustle_session* session, rustle_progress* progress);

typedef struct rustle_figure {
  const char* name; /**< as proto/rustle/v1/session.proto has it in Statistics, such as "frames_analysed"; drops as
                         "frames_dropped.CAUSE" */
  double value;
} rustle_figure;

/** All figures that the daemon has of the session; of one that was detached, its last. Valid until this is called again with
 * the same session. */
RUSTLE_API rustle_status rustle_statistics(rustle_session* session, const rustle_figure** figures, size_t* count);
/** The figure of this name among them; 0 where it is not. */
RUSTLE_API double rustle_figure_named(const rustle_figure* figures, size_t count, const char* name);

typedef struct rustle_gain {
  double gain_db;       /**< -200 to 24, or -infinity: silence */
  int32_t of_one_sheet; /**< 1: of `sheet_id`; 0: of every sheet */
  uint32_t sheet_id;
  rustle_sound_kind kind;
  const char* material; /**< NULL: every material */
} rustle_gain;

/** Changes gains while the session sounds, within 20 ms. A sound's level is the product of all gains that concern it; each
 * takes the place of the one for the same sheet, kind and material, 0 dB takes it away, the others stay. */
RUSTLE_API rustle_status rustle_set_gains(rustle_session* session, const rustle_gain* gains, size_t count);
/** The sheet gets another pack while it sounds. NULL: as it is. */
RUSTLE_API rustle_status rustle_change_pack(rustle_session* session, uint32_t sheet_id, const char* material,
                                            const char* touched_surface);
/** Records from now on in the daemon's recording folder, under this plain name; NULL: one that the daemon chooses. */
RUSTLE_API rustle_status rustle_start_recording(rustle_session* session, const char* file_name);
/** Returns when the file is closed. */
RUSTLE_API rustle_status rustle_stop_recording(rustle_session* session);
/** Where the session is recorded; empty: nowhere. Valid until the session's next call. */
RUSTLE_API const char* rustle_recording_file_name(const rustle_session* session);

/* ---- sound */

/** A session's sound, as it comes. */
typedef struct rustle_reader rustle_reader;

typedef enum rustle_content RUSTLE_ENUM {
  RUSTLE_MIX = 0,
  RUSTLE_STEM = 1, /**< `stem_sheet_id`'s sound of `stem_kind`: its part of the mix before the limiter */
  /** Dry sound per emitter with its position, for engines that spatialize themselves: mono, as heard at 1 m on the emitter's
   * normal. An emitter radiates as a dipole: |cos a| / R times that in the distance R at the angle a from its normal. */
  RUSTLE_EMITTERS = 2
} rustle_content;

typedef enum rustle_format RUSTLE_ENUM {
  RUSTLE_F32 = 0,
  RUSTLE_S16 = 1,
  RUSTLE_OPUS = 2 /**< 64 kbit/s a channel in packets of 20 ms, at 8, 12, 16, 24 and 48 kHz */
} rustle_format;

typedef struct rustle_listen_options {
  rustle_content content;
  uint32_t stem_sheet_id;
  rustle_sound_kind stem_kind;
  rustle_format format;   /**< on the wire; blocks hold floats either way */
  int32_t blocks;         /**< in one message, 1 to 4: fewer come sooner; 0: 4 */
  int32_t queue_messages; /**< that wait here to be read, later ones are lost to this reader; -1: no limit; 0: no limit on
                             the SIMULATION clock, else 4096 */
} rustle_listen_options;

typedef struct rustle_emitter {
  uint64_t id; /**< may come again after its last block */
  uint32_t sheet_id;
  rustle_sound_kind kind;
  double position[3]; /**< at the block's first sample; metres, session's axes */
  double normal[3];
  int32_t last; /**< 1: nothing follows from it; such a block may hold no samples */
} rustle_emitter;

typedef struct rustle_block {
  const float* interleaved; /**< [samples, channels] */
  uint32_t samples;         /**< per channel */
  uint32_t channels;
  uint32_t rate_hz;
  int32_t restarted;        /**< 1: the first of a daemon that was started anew: first_sample counts from 0 again */
  int64_t first_sample;     /**< 0 is the session's time origin */
  uint64_t missing_samples; /**< lost before this block, of its emitter where it has one */
  double time_s;            /**< simulation time of the first sample */
  int32_t has_emitter;      /**< 1: `emitter` holds */
  rustle_emitter emitter;
} rustle_block;

typedef struct rustle_gap {
  uint64_t first; /**< of the sound's samples */
  uint64_t samples;
} rustle_gap;

typedef struct rustle_sound {
  const float* interleaved; /**< [samples, channels], silence in gaps */
  size_t samples;           /**< per channel */
  uint32_t channels;
  uint32_t rate_hz;
  int64_t first_sample;
  const rustle_gap* gaps; /**< [gap_count] */
  size_t gap_count;
} rustle_sound;

/** Returns when that is in force: what is sent to the session afterwards is heard whole. `options` may be NULL: the mix.
 * Does as the session does when the daemon goes away. Free with rustle_free_reader(). */
RUSTLE_API rustle_status rustle_listen(rustle_session* session, const rustle_listen_options* options,
                                       rustle_reader** reader);
/** The same of a session by its id: the name it was attached with, unless that was taken. It need not exist yet. `reconnect`
 * 1: a daemon that goes is waited for. */
RUSTLE_API rustle_status rustle_listen_to(rustle_connection* connection, const char* session_id,
                                          const rustle_listen_options* options, int32_t reconnect, rustle_reader** reader);
/** NULL is left alone. */
RUSTLE_API void rustle_free_reader(rustle_reader* reader);

/** The next block; its samples are valid until the reader's next call. NOTHING: none came in time. COMPLETE: the sound has
 * ended; `first_sample` is its length. Error: UNREACHABLE: the daemon has gone, and is not waited for. */
RUSTLE_API rustle_status rustle_next_block(rustle_reader* reader, double timeout_s, rustle_block* block);
/** All that is left until the sound's end, valid until the reader's next call.
 * Errors: TIMED_OUT, UNREACHABLE, INVALID_ARGUMENT (emitters, which are many sounds). */
RUSTLE_API rustle_status rustle_read_all(rustle_reader* reader, double timeout_s, rustle_sound* sound);
/** In all gaps so far. */
RUSTLE_API uint64_t rustle_missing_samples(const rustle_reader* reader);

/* ---- what the daemon sees */

/** A session's observations as they come. One thread at a time. */
typedef struct rustle_observer rustle_observer;

/** A part of the sheet that sounds by itself. */
typedef struct rustle_resonator {
  int32_t constrained;
  int32_t coarse;              /**< 1: the mesh is too coarse there for the promised accuracy */
  double ruling_length_m;      /**< l_r */
  double free_border_length_m; /**< l_c */
  double area_m2;
} rustle_resonator;

typedef struct rustle_crumpling_event {
  uint64_t event_id;
  uint64_t continues_event_id; /**< 0: none */
  double time_s;               /**< when the curvature passed zero */
  double amplitude_m;
  double area_m2;
  double position[3];
  const rustle_resonator* resonators; /**< [resonator_count] */
  size_t resonator_count;
} rustle_crumpling_event;

typedef struct rustle_friction_contact {
  uint64_t event_id; /**< stays for the whole episode */
  double speed_m_per_s;
  double area_m2;
  double position[3];
  const char* touched_surface;
  const rustle_resonator* resonators; /**< [resonator_count] */
  size_t resonator_count;
} rustle_friction_contact;

/** What the daemon saw in one frame. Metres, session's axes. */
typedef struct rustle_observation {
  uint32_t sheet_id;
  double time_s;
  const rustle_crumpling_event* crumpling; /**< [crumpling_count] */
  size_t crumpling_count;
  const rustle_friction_contact* friction; /**< [friction_count] */
  size_t friction_count;
} rustle_observation;

/** Returns when that is in force. Does as the session does when the daemon goes away. Free with rustle_free_observer(). */
RUSTLE_API rustle_status rustle_observe(rustle_session* session, rustle_observer** observer);
/** NULL is left alone. */
RUSTLE_API void rustle_free_observer(rustle_observer* observer);
/** The next frame in which something happened; what it points to is valid until this is called again with the same observer.
 * NOTHING: none came in time. Error: UNREACHABLE: the daemon has gone, and is not waited for. */
RUSTLE_API rustle_status rustle_next_observation(rustle_observer* observer, double timeout_s,
                                                 rustle_observation* observation);

#ifdef __cplusplus
}
#endif

#endif
