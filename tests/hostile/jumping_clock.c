// CLOCK_REALTIME as if somebody had set it, for one process: LD_PRELOAD this, and write the jump [ns, int64] to the
// file that JUMPING_CLOCK names, at any time.
//
// Whoever asks for the time is told the jumped one. Who waits until a time of that clock waits until the jumped clock
// shows it, as the kernel does it: after a jump back for longer, after a jump forth no more.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static const int64_t second = 1000000000, slice = 5000000;
static volatile const int64_t* jump;

__attribute__((constructor)) static void open_jump(void) {
  static const int64_t none = 0;
  jump = &none;
  const char* name = getenv("JUMPING_CLOCK");
  const int file = name ? open(name, O_RDONLY) : -1;
  if (file < 0) return;
  void* page = mmap(NULL, sizeof(int64_t), PROT_READ, MAP_SHARED, file, 0);
  if (page != MAP_FAILED) jump = page;
  close(file);
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static int64_t ns_of(const struct timespec* t) { return t->tv_sec * second + t->tv_nsec; }
static struct timespec of_ns(int64_t ns) { return (struct timespec){ns / second, ns % second}; }

int clock_gettime(clockid_t clock, struct timespec* t) {
  static __typeof__(&clock_gettime) real;
  if (!real) real = REAL(clock_gettime);
  const int code = real(clock, t);
  if (code == 0 && jump && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
    *t = of_ns(ns_of(t) + *jump);
  return code;
}

int gettimeofday(struct timeval* t, void* zone) {
  (void)zone;
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  t->tv_sec = now.tv_sec;
  t->tv_usec = now.tv_nsec / 1000;
  return 0;
}

time_t time(time_t* out) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (out) *out = now.tv_sec;
  return now.tv_sec;
}

// The one wait on that clock that the daemon's libraries use.
int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex, const struct timespec* until) {
  static int (*real)(pthread_cond_t*, pthread_mutex_t*, clockid_t, const struct timespec*);
  if (!real) *(void**)&real = dlsym(RTLD_NEXT, "pthread_cond_clockwait");
  for (;;) {
    struct timespec wall, monotonic;
    clock_gettime(CLOCK_REALTIME, &wall);
    const int64_t left = ns_of(until) - ns_of(&wall);
    if (left <= 0) return ETIMEDOUT;
    clock_gettime(CLOCK_MONOTONIC, &monotonic);
    const struct timespec end = of_ns(ns_of(&monotonic) + (left < slice ? left : slice));
    const int code = real(condition, mutex, CLOCK_MONOTONIC, &end);
    if (code != ETIMEDOUT) return code;
  }
}
