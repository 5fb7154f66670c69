/* What the drivers in C and C++ have in common: a command is a verb and NAME=VALUE words on a line of standard input, its
 * answer a JSON object on a line of standard output. The list of commands is in driver.py. */
#ifndef RUSTLE_TESTS_CONFORMANCE_COMMAND_H
#define RUSTLE_TESTS_CONFORMANCE_COMMAND_H

#include <stdbool.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { MOST_WORDS = 32, LONGEST_LINE = 4096 };

typedef struct command {
  char line[LONGEST_LINE];
  const char* verb;
  const char* names[MOST_WORDS];
  const char* values[MOST_WORDS];
  int count;
} command;

/* False at the end of the input. */
bool read_command(command* out);
bool is_verb(const command* given, const char* verb);
/* NULL where there is none. */
const char* word(const command* given, const char* name);
bool is_word(const command* given, const char* name, const char* value);
double number(const command* given, const char* name, double otherwise);
/* X,Y,Z; false where there is none. */
bool vector(const command* given, const char* name, double out[3]);
/* The file that the word names, kept until the program ends; NULL where there is none. */
const void* file(const command* given, const char* name, size_t* bytes);
/* Appends to, or with `fresh` writes, the file that the word names; nothing where there is none. */
void write_file(const command* given, const char* name, const void* data, size_t bytes, bool fresh);

void begin_answer(const char* status);
void answer_text(const char* name, const char* value);
void answer_number(const char* name, double value);
void end_answer(void);

/* Of the clock on the wall. */
double now_s(void);
void wait_s(double seconds);
/* Says what is wrong with the command, and ends the program. */
void give_up(const command* given, const char* why);

#ifdef __cplusplus
}
#endif

#endif
