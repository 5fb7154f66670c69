// Makes a program's system fail on purpose: LD_PRELOAD it. All by files, so that faults begin and end while the program
// runs.
//   RUSTLE_FAULT_WRITE=FILE   while FILE is there, write() and fsync() of files called *.mcap fail with EIO
//   RUSTLE_FAULT_CLOCK=FILE   the wall clock is off by as many seconds as FILE says
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static int present(const char* variable) {
  const char* file = getenv(variable);
  return file != NULL && access(file, F_OK) == 0;
}

static int is_capture(int descriptor) {
  char link[64], path[4096];
  snprintf(link, sizeof(link), "/proc/self/fd/%d", descriptor);
  const ssize_t length = readlink(link, path, sizeof(path) - 1);
  if (length < 5) return 0;
  path[length] = '\0';
  return strcmp(path + length - 5, ".mcap") == 0;
}

ssize_t write(int descriptor, const void* bytes, size_t count) {
  static ssize_t (*real)(int, const void*, size_t);
  if (real == NULL) real = (ssize_t(*)(int, const void*, size_t))dlsym(RTLD_NEXT, "write");
  if (present("RUSTLE_FAULT_WRITE") && is_capture(descriptor)) {
    errno = EIO;
    return -1;
  }
  return real(descriptor, bytes, count);
}

int fsync(int descriptor) {
  static int (*real)(int);
  if (real == NULL) real = (int (*)(int))dlsym(RTLD_NEXT, "fsync");
  if (present("RUSTLE_FAULT_WRITE") && is_capture(descriptor)) {
    errno = EIO;
    return -1;
  }
  return real(descriptor);
}

int fdatasync(int descriptor) {
  return fsync(descriptor);
}

int clock_gettime(clockid_t clock, struct timespec* now) {
  static int (*real)(clockid_t, struct timespec*);
  if (real == NULL) real = (int (*)(clockid_t, struct timespec*))dlsym(RTLD_NEXT, "clock_gettime");
  const int result = real(clock, now);
  const char* file = getenv("RUSTLE_FAULT_CLOCK");
  if (clock != CLOCK_REALTIME || file == NULL) return result;
  FILE* said = fopen(file, "r");
  long off = 0;
  if (said != NULL) {
    if (fscanf(said, "%ld", &off) == 1) now->tv_sec += off;
    fclose(said);
  }
  return result;
}
