/* The least that a program in C does to be heard: attaches to a running rustled, bends a sheet of paper to and fro for two
 * seconds, and writes what it heard to a WAV file.
 *
 *   rustled &
 *   cc minimal.c $(pkg-config --cflags --libs rustle-client-c) -lm -o minimal && ./minimal heard.wav
 *
 * usage: minimal [WAV [CONTROL_ENDPOINT]] */
#include <math.h>
#include <rustle.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { COLUMNS = 12, ROWS = 17, VERTICES = (COLUMNS + 1) * (ROWS + 1), TRIANGLES = 2 * COLUMNS * ROWS, FRAMES = 120 };

static const double kWidth_m = 0.21, kHeight_m = 0.297, kFrame_s = 1.0 / 60;

/* Ends the program where a call failed. */
static void check(rustle_status status) {
  if (status >= 0) return;
  const rustle_error* error = rustle_last_error();
  fprintf(stderr, "minimal: %s: %s %s\n", error->code_name, error->message, error->remedy);
  exit(1);
}

/* The flat sheet and its triangles. */
static void make_sheet(float flat[][2], uint32_t triangles[][3]) {
  for (uint32_t v = 0; v < VERTICES; ++v) {
    flat[v][0] = (float)(kWidth_m * (v % (COLUMNS + 1)) / COLUMNS);
    flat[v][1] = (float)(kHeight_m * (v / (COLUMNS + 1)) / ROWS);
  }
  for (uint32_t row = 0, t = 0; row < ROWS; ++row) {
    for (uint32_t column = 0; column < COLUMNS; ++column, t += 2) {
      const uint32_t a = row * (COLUMNS + 1) + column, b = a + COLUMNS + 1;
      const uint32_t two[2][3] = {{a, a + 1, b + 1}, {a, b + 1, b}};
      memcpy(triangles[t], two, sizeof(two));
    }
  }
}

/* Your simulator: here the sheet is an arc across its width, in metres, z up. */
static void simulate(double t, float flat[][2], float positions[][3]) {
  const double curvature_per_m = 12 * sin(25 * t) + 1e-6;
  for (uint32_t v = 0; v < VERTICES; ++v) {
    const double angle = curvature_per_m * (flat[v][0] - kWidth_m / 2);
    positions[v][0] = (float)(sin(angle) / curvature_per_m);
    positions[v][1] = flat[v][1];
    positions[v][2] = (float)(0.3 + (cos(angle) - 1) / curvature_per_m);
  }
}

static void put(FILE* file, uint32_t value, int bytes) {
  for (int k = 0; k < bytes; ++k) fputc((int)(value >> 8 * k & 0xff), file);
}

/* 32-bit floats. */
static void write_wav(const char* path, const rustle_sound* sound) {
  const uint32_t frame = 4 * sound->channels, bytes = (uint32_t)sound->samples * frame;
  FILE* file = fopen(path, "wb");
  if (file == NULL) {
    perror(path);
    exit(1);
  }
  fputs("RIFF", file);
  put(file, 36 + bytes, 4);
  fputs("WAVEfmt ", file);
  put(file, 16, 4);
  put(file, 3, 2);
  put(file, sound->channels, 2);
  put(file, sound->rate_hz, 4);
  put(file, sound->rate_hz * frame, 4);
  put(file, frame, 2);
  put(file, 32, 2);
  fputs("data", file);
  put(file, bytes, 4);
  fwrite(sound->interleaved, frame, sound->samples, file);
  if (fclose(file) != 0) {
    perror(path);
    exit(1);
  }
}

int main(int argc, char** argv) {
  static float flat[VERTICES][2], positions[VERTICES][3];
  static uint32_t triangles[TRIANGLES][3];
  const rustle_endpoints endpoints = {.control = argc > 2 ? argv[2] : NULL};
  const rustle_sheet sheet = {.id = 1};
  const rustle_session_options options = {
      .name = "minimal", .clock = RUSTLE_CLOCK_SIMULATION, .sheets = &sheet, .sheet_count = 1};
  rustle_topology topology = {.id = 1, .vertex_count = VERTICES, .triangle_count = TRIANGLES};
  rustle_connection* daemon;
  rustle_session* session;
  rustle_reader* reader;
  rustle_sound sound;
  const rustle_figure* figures;
  size_t count;

  make_sheet(flat, triangles);
  topology.triangles = triangles[0];
  topology.material_coordinates = flat[0];
  check(rustle_connect(&endpoints, &daemon));
  check(rustle_attach(daemon, &options, &session));
  check(rustle_listen(session, NULL, &reader));
  check(rustle_add_topology(session, &topology));
  for (int k = 0; k < FRAMES; ++k) {
    const rustle_mesh_frame frame = {.sheet_id = 1, .topology_id = 1, .time_s = k * kFrame_s, .positions = positions[0]};
    simulate(frame.time_s, flat, positions);
    check(rustle_frame(session, &frame));
  }
  check(rustle_end(session, NULL));
  check(rustle_read_all(reader, 60, &sound));
  write_wav(argc > 1 ? argv[1] : "heard.wav", &sound);
  check(rustle_detach(session, 0));
  check(rustle_statistics(session, &figures, &count));
  printf("%g frames, %g crumpling events, %zu samples at %u Hz\n", rustle_figure_named(figures, count, "frames_analysed"),
         rustle_figure_named(figures, count, "crumpling_events"), sound.samples, (unsigned)sound.rate_hz);
  rustle_free_reader(reader);
  rustle_free_session(session);
  rustle_disconnect(daemon);
  return 0;
}
