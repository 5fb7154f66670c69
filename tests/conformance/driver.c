/* The C SDK, driven line by line: driver.py says how. */
#include <rustle.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "command.h"

enum { MOST_SHEETS = 8, MOST_CONTACTS = 1024 };

static rustle_connection* connection;
static rustle_session* session;
static rustle_reader* reader;
static rustle_observer* observer;

static const char* const kKinds[] = {"", "crumpling", "friction", "tearing"};

/* What a call came to; true where it is no error. */
static bool answer(rustle_status status) {
  static const char* const names[] = {"ok", "dropped", "nothing", "complete"};
  static const char* const errors[] = {"",        "invalid_argument", "unreachable", "timed_out",
                                       "refused", "session_lost",     "closed",      "other"};
  begin_answer(status < 0 ? errors[-status] : names[status]);
  if (status >= 0) return true;
  const rustle_error* error = rustle_last_error();
  answer_number("code", error->code);
  answer_text("code_name", error->code_name);
  answer_text("field", error->field);
  answer_text("message", error->message);
  answer_text("remedy", error->remedy);
  return false;
}

static uint32_t whole(const command* given, const char* name) {
  return (uint32_t)number(given, name, 0);
}

static rustle_sound_kind sound_kind(const command* given) {
  for (int kind = RUSTLE_CRUMPLING; kind <= RUSTLE_TEARING; ++kind)
    if (is_word(given, "kind", kKinds[kind])) return (rustle_sound_kind)kind;
  return RUSTLE_EVERY_KIND;
}

static void do_connect(const command* given) {
  const rustle_endpoints endpoints = {
      .control = word(given, "control"), .keys_folder = word(given, "keys"), .timeout_s = number(given, "timeout", 30)};
  answer(rustle_connect(&endpoints, &connection));
}

static void do_check(const command* given) {
  const bool gone = word(given, "gone") != NULL;
  const double until = now_s() + number(given, "timeout", 30);
  rustle_status status = rustle_check(connection);
  for (; (status < 0) != gone && now_s() < until; status = rustle_check(connection)) wait_s(0.01);
  answer(status);
}

static void do_attach(const command* given) {
  rustle_sheet sheets[MOST_SHEETS] = {{.id = 1}};
  for (uint32_t k = 0; k < MOST_SHEETS; ++k) sheets[k].id = k + 1;
  rustle_session_options options = {
      .name = word(given, "name"),
      .clock = is_word(given, "clock", "simulation") ? RUSTLE_CLOCK_SIMULATION : RUSTLE_CLOCK_LIVE,
      .channels = is_word(given, "channels", "mono") ? RUSTLE_MONO : RUSTLE_STEREO,
      .seed = whole(given, "seed"),
      .default_material = word(given, "material"),
      .sheets = sheets,
      .sheet_count = whole(given, "sheets")};
  if (is_word(given, "reconnect", "always")) options.reconnect = RUSTLE_RECONNECT_ALWAYS;
  if (is_word(given, "reconnect", "never")) options.reconnect = RUSTLE_RECONNECT_NEVER;
  if (!answer(rustle_attach(connection, &options, &session))) return;
  answer_text("session", rustle_session_id(session));
  answer_number("rate_hz", rustle_session_rate_hz(session));
}

static void do_add_sheet(const command* given) {
  const rustle_sheet sheet = {.id = whole(given, "id"), .material = word(given, "material")};
  answer(rustle_add_sheet(session, &sheet));
}

static void do_add_topology(const command* given) {
  size_t bytes, ignored;
  rustle_topology topology = {.id = whole(given, "id"), .vertex_count = whole(given, "vertices")};
  topology.triangles = file(given, "triangles", &bytes);
  topology.triangle_count = bytes / (3 * sizeof(uint32_t));
  topology.material_coordinates = file(given, "material", &ignored);
  answer(rustle_add_topology(session, &topology));
}

static void do_frames(const command* given) {
  static uint32_t partners[MOST_CONTACTS];
  static float slips[MOST_CONTACTS][3], forces[MOST_CONTACTS];
  size_t bytes, contact_bytes;
  const float* positions = file(given, "positions", &bytes);
  const size_t floats = 3 * (size_t)whole(given, "vertices"), first = whole(given, "first");
  const double start = number(given, "start", 0), fps = number(given, "fps", 60);
  const size_t count = (size_t)number(given, "count", (double)(bytes / sizeof(float) / floats - first));
  const rustle_contact_partner partner = {.id = whole(given, "partner")};
  const uint32_t* vertices = file(given, "contacts", &contact_bytes);
  const rustle_contacts contacts = {.count = contact_bytes / sizeof(uint32_t),
                                    .vertices = vertices,
                                    .partners = partners,
                                    .partner_table = &partner,
                                    .partner_count = 1,
                                    .slip_velocities = slips[0],
                                    .normal_forces = forces};
  static const uint8_t curved = 1;
  static const uint32_t region = 0;
  static const float ruling[6] = {0, 0, 0, 1, 0, 0}, point[3] = {0, 0, 0};
  size_t region_bytes;
  const uint32_t* regions = file(given, "regions", &region_bytes);
  const rustle_partition partition = {.triangle_regions = regions,
                                      .triangle_count = region_bytes / sizeof(uint32_t),
                                      .region_curved = &curved,
                                      .region_count = 1,
                                      .rulings = ruling,
                                      .ruling_regions = &region,
                                      .ruling_count = 1,
                                      .singular_points = point,
                                      .singular_count = 1};
  double slip[3] = {0, 0, 0};
  vector(given, "slip", slip);
  if (contacts.count > MOST_CONTACTS) give_up(given, "too many contacts");
  for (size_t k = 0; k < contacts.count; ++k) {
    for (int axis = 0; axis < 3; ++axis) slips[k][axis] = (float)slip[axis];
    forces[k] = (float)number(given, "force", 0);
  }
  rustle_status status = RUSTLE_OK;
  for (size_t k = 0; k < count * (size_t)number(given, "repeat", 1) && status >= 0; ++k) {
    const rustle_mesh_frame frame = {.sheet_id = whole(given, "sheet"),
                                     .topology_id = whole(given, "topology"),
                                     .time_s = start + (double)k / fps,
                                     .positions = positions + (first + k % count) * floats,
                                     .contacts = vertices == NULL ? NULL : &contacts,
                                     .partition = regions == NULL ? NULL : &partition};
    status = rustle_frame(session, &frame);
  }
  answer(status);
}

static void do_frames_until_reattached(const command* given) {
  size_t bytes;
  const float* positions = file(given, "positions", &bytes);
  const size_t floats = 3 * (size_t)whole(given, "vertices"), count = bytes / sizeof(float) / floats;
  const double until = now_s() + number(given, "timeout", 30);
  rustle_progress progress = {0};
  for (size_t k = 0; progress.reattached == 0 || !progress.connected; k = (k + 1) % count) {
    const rustle_mesh_frame frame = {.sheet_id = whole(given, "sheet"),
                                     .topology_id = whole(given, "topology"),
                                     .time_s = now_s(),
                                     .positions = positions + k * floats};
    const rustle_status status = now_s() > until ? RUSTLE_NOTHING : rustle_frame(session, &frame);
    if (status < 0 || status == RUSTLE_NOTHING) {
      answer(status);
      return;
    }
    rustle_get_progress(session, &progress);
    wait_s(0.01);
  }
  answer(RUSTLE_OK);
}

static void do_obstacle(const command* given) {
  static const char* const shapes[] = {"plane", "box", "sphere", "capsule", "mesh"};
  const double size = number(given, "size", 1);
  size_t bytes;
  rustle_obstacle obstacle = {.id = whole(given, "id"), .radius = size, .half_length = number(given, "length", 1)};
  for (int shape = RUSTLE_PLANE; shape <= RUSTLE_MESH; ++shape)
    if (is_word(given, "shape", shapes[shape])) obstacle.shape = (rustle_shape)shape;
  for (int axis = 0; axis < 3; ++axis) obstacle.half_extents[axis] = size;
  vector(given, "position", obstacle.pose.position);
  obstacle.triangles = file(given, "triangles", &bytes);
  obstacle.triangle_count = bytes / (3 * sizeof(uint32_t));
  obstacle.vertices = file(given, "vertices", &bytes);
  obstacle.vertex_count = bytes / (3 * sizeof(float));
  answer(rustle_set_obstacles(session, number(given, "time", 0), &obstacle, 1));
}

static void do_move_obstacle(const command* given) {
  rustle_pose pose = {{0}, {0}};
  vector(given, "position", pose.position);
  answer(rustle_move_obstacle(session, number(given, "time", 0), whole(given, "id"), &pose));
}

static void do_remove_obstacle(const command* given) {
  answer(rustle_remove_obstacle(session, number(given, "time", 0), whole(given, "id")));
}

static void do_listener(const command* given) {
  double position[3], forward[3];
  vector(given, "position", position);
  const bool looks = vector(given, "forward", forward);
  answer(rustle_set_listener(session, number(given, "time", 0), position, looks ? forward : NULL, NULL));
}

static void do_tear_tips(const command* given) {
  rustle_tear_tip tip = {.id = 1, .speed = number(given, "speed", 0)};
  vector(given, "position", tip.position);
  answer(rustle_tear_tips(session, whole(given, "sheet"), number(given, "time", 0), &tip, 1));
}

static void do_advance(const command* given) {
  answer(rustle_advance(session, number(given, "time", 0)));
}

static void do_end(const command* given) {
  const double time_s = number(given, "time", 0);
  answer(rustle_end(session, word(given, "time") == NULL ? NULL : &time_s));
}

static void do_raw(const command* given) {
  size_t bytes;
  const void* message = file(given, "message", &bytes);
  answer(rustle_send_raw(session, message, bytes));
}

static void do_drain(const command* given) {
  answer(rustle_drain(session, number(given, "timeout", 0)));
}

static void do_send_timeout(const command* given) {
  answer(rustle_set_send_timeout(session, number(given, "seconds", 0)));
}

static void do_notice(const command* given) {
  static const char* const levels[] = {"info", "warning", "error"};
  rustle_notice notice;
  rustle_status status = rustle_next_notice(session, &notice);
  for (const double until = now_s() + number(given, "timeout", 20); status == RUSTLE_NOTHING && now_s() < until;) {
    wait_s(0.005);
    status = rustle_next_notice(session, &notice);
  }
  if (!answer(status) || status == RUSTLE_NOTHING) return;
  answer_text("level", levels[notice.level]);
  answer_text("code", notice.code);
  answer_text("field", notice.field);
  answer_text("message", notice.message);
  answer_text("remedy", notice.remedy);
  answer_number("sequence", (double)notice.sequence);
}

static void answer_figures(const command* given, const rustle_figure* figures, size_t count) {
  char names[512] = "";
  strncat(names, word(given, "figures"), sizeof(names) - 1);
  for (char* name = strtok(names, ","); name != NULL; name = strtok(NULL, ","))
    answer_number(name, rustle_figure_named(figures, count, name));
}

static void do_progress(const command* given) {
  rustle_progress progress;
  if (!answer(rustle_get_progress(session, &progress))) return;
  const rustle_figure figures[] = {
      {"sent", (double)progress.sent_messages},    {"dropped", (double)progress.dropped_messages},
      {"next", (double)progress.next_sequence},    {"acknowledged", (double)progress.acknowledged_sequence},
      {"reattached", (double)progress.reattached}, {"connected", progress.connected}};
  answer_figures(given, figures, sizeof(figures) / sizeof(figures[0]));
}

static void do_statistics(const command* given) {
  const rustle_figure* figures;
  size_t count;
  if (answer(rustle_statistics(session, &figures, &count))) answer_figures(given, figures, count);
}

static void do_gain(const command* given) {
  const rustle_gain gain = {.gain_db = number(given, "db", 0),
                            .of_one_sheet = word(given, "sheet") != NULL,
                            .sheet_id = whole(given, "sheet"),
                            .kind = sound_kind(given)};
  answer(rustle_set_gains(session, &gain, 1));
}

static void do_listen(const command* given) {
  rustle_listen_options options = {
      .stem_sheet_id = whole(given, "sheet"), .stem_kind = sound_kind(given), .blocks = (int32_t)number(given, "blocks", 0)};
  if (is_word(given, "content", "stem")) options.content = RUSTLE_STEM;
  if (is_word(given, "content", "emitters")) options.content = RUSTLE_EMITTERS;
  if (is_word(given, "format", "s16")) options.format = RUSTLE_S16;
  if (is_word(given, "format", "opus")) options.format = RUSTLE_OPUS;
  answer(rustle_listen(session, &options, &reader));
}

static void do_read_all(const command* given) {
  rustle_sound sound;
  if (!answer(rustle_read_all(reader, number(given, "timeout", 60), &sound))) return;
  write_file(given, "to", sound.interleaved, sizeof(float) * sound.channels * sound.samples, true);
  answer_number("samples", (double)sound.samples);
  answer_number("channels", sound.channels);
  answer_number("rate_hz", sound.rate_hz);
  answer_number("first_sample", (double)sound.first_sample);
  answer_number("gaps", (double)sound.gap_count);
}

static void write_place(const command* given, const rustle_block* block, bool fresh) {
  char line[320];
  int length = snprintf(line, sizeof(line), "%lld %u ", (long long)block->first_sample, (unsigned)block->samples);
  if (block->has_emitter) {
    const rustle_emitter* e = &block->emitter;
    length += snprintf(line + length, sizeof(line) - (size_t)length, "%llu %u %s %d %.9g %.9g %.9g %.9g %.9g %.9g",
                       (unsigned long long)e->id, (unsigned)e->sheet_id, kKinds[e->kind], (int)e->last, e->position[0],
                       e->position[1], e->position[2], e->normal[0], e->normal[1], e->normal[2]);
  }
  line[length++] = '\n';
  write_file(given, "places", line, (size_t)length, fresh);
}

static void do_blocks(const command* given) {
  rustle_block block;
  rustle_status status = RUSTLE_NOTHING;
  bool fresh = true;
  for (const double until = now_s() + number(given, "timeout", 60); now_s() < until;) {
    status = rustle_next_block(reader, 0.2, &block);
    if (status < 0 || status == RUSTLE_COMPLETE) break;
    if (status == RUSTLE_NOTHING) continue;
    write_file(given, "to", block.interleaved, sizeof(float) * block.channels * block.samples, fresh);
    write_place(given, &block, fresh);
    fresh = false;
  }
  if (answer(status)) answer_number("missing", (double)rustle_missing_samples(reader));
}

static void do_block(const command* given) {
  const bool any = word(given, "restarted") == NULL;
  rustle_block block;
  rustle_status status = RUSTLE_NOTHING;
  for (const double until = now_s() + number(given, "timeout", 30); now_s() < until;) {
    status = rustle_next_block(reader, 0.2, &block);
    if (status == RUSTLE_OK && (any || block.restarted)) break;
    status = RUSTLE_NOTHING;
  }
  answer(status);
}

static void do_observe(const command* given) {
  (void)given;
  answer(rustle_observe(session, &observer));
}

/* Text that grows; what does not fit is lost, and differs from the others'. */
static char seen_text[1 << 20];
static size_t seen_length;

static void see(const char* format, ...) {
  va_list values;
  va_start(values, format);
  const int length = vsnprintf(seen_text + seen_length, sizeof(seen_text) - seen_length, format, values);
  va_end(values);
  if (length > 0 && seen_length + (size_t)length < sizeof(seen_text)) seen_length += (size_t)length;
}

static void see_figures(const double* figures, size_t count, const rustle_resonator* resonators, size_t resonator_count) {
  for (size_t k = 0; k < count; ++k) see(" %.9g", figures[k]);
  for (const rustle_resonator* r = resonators; r != resonators + resonator_count; ++r)
    see(" %d %d %.9g %.9g %.9g", (int)r->constrained, (int)r->coarse, r->ruling_length_m, r->free_border_length_m,
        r->area_m2);
  see("\n");
}

static void see_observation(const rustle_observation* seen) {
  see("sheet %u %.9g\n", (unsigned)seen->sheet_id, seen->time_s);
  for (const rustle_crumpling_event* e = seen->crumpling; e != seen->crumpling + seen->crumpling_count; ++e) {
    const double figures[] = {e->time_s, e->amplitude_m, e->area_m2, e->position[0], e->position[1], e->position[2]};
    see("crumpling %llu %llu", (unsigned long long)e->event_id, (unsigned long long)e->continues_event_id);
    see_figures(figures, 6, e->resonators, e->resonator_count);
  }
  for (const rustle_friction_contact* c = seen->friction; c != seen->friction + seen->friction_count; ++c) {
    const double figures[] = {c->speed_m_per_s, c->area_m2, c->position[0], c->position[1], c->position[2]};
    see("friction %llu %s", (unsigned long long)c->event_id, c->touched_surface);
    see_figures(figures, 5, c->resonators, c->resonator_count);
  }
}

static void do_observations(const command* given) {
  const double until = now_s() + number(given, "timeout", 60);
  rustle_status status = RUSTLE_OK;
  seen_length = 0;
  for (uint32_t k = 0; k < whole(given, "count") && status == RUSTLE_OK; ++k) {
    rustle_observation seen;
    status = rustle_next_observation(observer, until - now_s(), &seen);
    if (status == RUSTLE_OK) see_observation(&seen);
  }
  write_file(given, "to", seen_text, seen_length, true);
  answer(status);
}

static void do_detach(const command* given) {
  (void)given;
  answer(rustle_detach(session, 0));
}

static void free_all(void) {
  rustle_free_reader(reader);
  rustle_free_observer(observer);
  rustle_free_session(session);
  rustle_disconnect(connection);
  reader = NULL;
  observer = NULL;
  session = NULL;
  connection = NULL;
}

static void do_close(const command* given) {
  (void)given;
  free_all();
  answer(RUSTLE_OK);
}

static const struct {
  const char* name;
  void (*act)(const command* given);
} kVerbs[] = {
    {"connect", do_connect},
    {"check", do_check},
    {"attach", do_attach},
    {"add_sheet", do_add_sheet},
    {"add_topology", do_add_topology},
    {"frames", do_frames},
    {"frames_until_reattached", do_frames_until_reattached},
    {"obstacle", do_obstacle},
    {"move_obstacle", do_move_obstacle},
    {"remove_obstacle", do_remove_obstacle},
    {"listener", do_listener},
    {"tear_tips", do_tear_tips},
    {"advance", do_advance},
    {"end", do_end},
    {"raw", do_raw},
    {"drain", do_drain},
    {"send_timeout", do_send_timeout},
    {"notice", do_notice},
    {"progress", do_progress},
    {"statistics", do_statistics},
    {"gain", do_gain},
    {"listen", do_listen},
    {"read_all", do_read_all},
    {"blocks", do_blocks},
    {"block", do_block},
    {"observe", do_observe},
    {"observations", do_observations},
    {"detach", do_detach},
    {"close", do_close},
};

int main(void) {
  for (command given; read_command(&given);) {
    size_t k = 0;
    while (k < sizeof(kVerbs) / sizeof(kVerbs[0]) && !is_verb(&given, kVerbs[k].name)) ++k;
    if (k == sizeof(kVerbs) / sizeof(kVerbs[0])) give_up(&given, "no such command");
    kVerbs[k].act(&given);
    end_answer();
  }
  free_all();
  return 0;
}
