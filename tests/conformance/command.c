#define _POSIX_C_SOURCE 200809L
#include "command.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { MOST_FILES = 64 };

static struct {
  char path[256];
  void* data;
  size_t bytes;
} files[MOST_FILES];
static int file_count;

void give_up(const command* given, const char* why) {
  fprintf(stderr, "%s: %s\n", given->verb, why);
  exit(2);
}

bool read_command(command* out) {
  if (fgets(out->line, LONGEST_LINE, stdin) == NULL) return false;
  out->verb = strtok(out->line, " \n");
  out->count = 0;
  if (out->verb == NULL) out->verb = "";
  for (char* each = strtok(NULL, " \n"); each != NULL; each = strtok(NULL, " \n")) {
    char* equals = strchr(each, '=');
    if (equals == NULL || out->count == MOST_WORDS) give_up(out, each);
    *equals = 0;
    out->names[out->count] = each;
    out->values[out->count++] = equals + 1;
  }
  return true;
}

bool is_verb(const command* given, const char* verb) {
  return strcmp(given->verb, verb) == 0;
}

const char* word(const command* given, const char* name) {
  for (int k = 0; k < given->count; ++k)
    if (strcmp(given->names[k], name) == 0) return given->values[k];
  return NULL;
}

bool is_word(const command* given, const char* name, const char* value) {
  const char* found = word(given, name);
  return found != NULL && strcmp(found, value) == 0;
}

double number(const command* given, const char* name, double otherwise) {
  const char* found = word(given, name);
  return found == NULL ? otherwise : strtod(found, NULL);
}

bool vector(const command* given, const char* name, double out[3]) {
  const char* found = word(given, name);
  if (found == NULL) return false;
  if (sscanf(found, "%lf,%lf,%lf", &out[0], &out[1], &out[2]) != 3) give_up(given, found);
  return true;
}

const void* file(const command* given, const char* name, size_t* bytes) {
  const char* path = word(given, name);
  *bytes = 0;
  if (path == NULL) return NULL;
  for (int k = 0; k < file_count; ++k) {
    if (strcmp(files[k].path, path) != 0) continue;
    *bytes = files[k].bytes;
    return files[k].data;
  }
  FILE* in = fopen(path, "rb");
  if (in == NULL || file_count == MOST_FILES || strlen(path) >= sizeof(files[0].path)) give_up(given, path);
  fseek(in, 0, SEEK_END);
  *bytes = (size_t)ftell(in);
  rewind(in);
  void* data = malloc(*bytes + 1);
  if (data == NULL || fread(data, 1, *bytes, in) != *bytes) give_up(given, path);
  fclose(in);
  strcpy(files[file_count].path, path);
  files[file_count].data = data;
  files[file_count++].bytes = *bytes;
  return data;
}

void write_file(const command* given, const char* name, const void* data, size_t bytes, bool fresh) {
  const char* path = word(given, name);
  if (path == NULL) return;
  FILE* out = fopen(path, fresh ? "wb" : "ab");
  if (out == NULL || (bytes > 0 && fwrite(data, 1, bytes, out) != bytes) || fclose(out) != 0) give_up(given, path);
}

static void print_text(const char* text) {
  putchar('"');
  for (; *text != 0; ++text) {
    const unsigned char c = (unsigned char)*text;
    if (c == '"' || c == '\\')
      printf("\\%c", c);
    else if (c < ' ')
      printf("\\u%04x", c);
    else
      putchar(c);
  }
  putchar('"');
}

void begin_answer(const char* status) {
  printf("{\"status\": ");
  print_text(status);
}

void answer_text(const char* name, const char* value) {
  printf(", \"%s\": ", name);
  print_text(value);
}

void answer_number(const char* name, double value) {
  printf(", \"%s\": %.17g", name, value);
}

void end_answer(void) {
  puts("}");
  fflush(stdout);
}

double now_s(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void wait_s(double seconds) {
  const struct timespec pause = {(time_t)seconds, (long)(1e9 * (seconds - (double)(time_t)seconds))};
  nanosleep(&pause, NULL);
}
