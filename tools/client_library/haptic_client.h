/* libhaptic_client: a haptic device on hapticd, in C.
 *
 *   haptic_open → every millisecond: haptic_next_slot, read your device, haptic_exchange, write your device
 *   haptic_open → haptic_start: the library's own 1 kHz thread calls you, or takes poses and keeps the newest force
 *
 * Units: m, N, N·m; the device's own frame, quaternions x, y, z, w. Errors are results below zero, and then the
 * force is zero: write it to the device. No signals, no exceptions, no output; a handle is all there is (DDS domains
 * alone belong to the process, and libddsc's received packets are checked for all its users).
 * Threads: any may call; exchange belongs to one at a time, and another is answered HAPTIC_WRONG_THREAD.
 * Structures begin with their size: fill them from the HAPTIC_…_INIT of the header you compile with.
 */
#ifndef HAPTIC_CLIENT_H
#define HAPTIC_CLIENT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum haptic_result {
  HAPTIC_OK = 0,
  HAPTIC_CONNECTING = 1, /* no force yet, and not yet 150 ms of waiting; the force is zero */
  HAPTIC_STOPPED = 2,    /* the library's thread does not run; the force is zero */
  /* These pass by themselves: go on. */
  HAPTIC_NO_DAEMON = -1,     /* none was heard for 150 ms: wrong domain, other keys, none there */
  HAPTIC_SILENT = -2,        /* no force for 7 ms: the daemon died or is held up */
  HAPTIC_SECOND_DAEMON = -3, /* another one writes for this device: zero until it is gone and `enable` was 0 once */
  HAPTIC_OTHER_CLIENT = -4,  /* the daemon serves another client of this device */
  HAPTIC_BAD_POSE = -5,      /* not finite, or no unit quaternion: it was not sent */
  HAPTIC_WRONG_THREAD = -6,  /* another thread exchanges, or the library's own does */
  /* These do not. */
  HAPTIC_BAD_ARGUMENT = -7,
  HAPTIC_BAD_DEVICE = -8, /* the device's file of limits, or the keys: file, line and key are in haptic_error */
  HAPTIC_NO_DDS = -9,     /* Cyclone DDS refuses: its reason is the message */
  HAPTIC_NO_MEMORY = -10,
  HAPTIC_CALLBACK = -11 /* a callback threw: the thread has ended, at zero */
} haptic_result;

typedef struct haptic_client haptic_client;

enum { HAPTIC_OPEN_NETWORK = 1, HAPTIC_ORDINARY_PRIORITY = 2 };

typedef struct haptic_options {
  uint32_t size;
  uint32_t flags;     /* HAPTIC_OPEN_NETWORK: a profile that names an interface is used without keys.
                         HAPTIC_ORDINARY_PRIORITY: the library's thread does not ask for SCHED_FIFO 50 */
  const char* device; /* whose limits hold: a name of config/devices ("touch"), or a file. Required */
  const char* keys;   /* folder of keys for a daemon with --secure; NULL: none */
  uint32_t domain;    /* the daemon's --domain */
  uint32_t device_id;
  const char* station; /* the daemon's --station; NULL: none. Since the structure has 40 bytes */
} haptic_options;
#define HAPTIC_OPTIONS_INIT {sizeof(haptic_options), 0, NULL, NULL, 0, 0, NULL}

typedef struct haptic_error {
  uint32_t size;
  int32_t line; /* 0: none */
  char file[256];
  char key[64];
  char message[1024];
} haptic_error;
#define HAPTIC_ERROR_INIT {sizeof(haptic_error), 0, "", "", ""}

typedef struct haptic_pose {
  uint32_t size;
  uint32_t buttons; /* bit 0: phaco pedal, bit 1: aspiration */
  double position[3];
  double orientation[4];
  int32_t enable; /* 0: no force is asked for (a dead man's switch). After a latch: 0 once, then 1 */
  int32_t reserved;
} haptic_pose;
#define HAPTIC_POSE_INIT {sizeof(haptic_pose), 0, {0, 0, 0}, {0, 0, 0, 1}, 1, 0}

typedef struct haptic_force {
  uint32_t size;
  uint32_t status;  /* bits of idl/README.md; 0: armed and well */
  double force[3];  /* on the hand, within the device's max_force and max_force_rate */
  double torque[3]; /* on the hand */
  int32_t answered; /* 1: this force answers the pose that was sent last */
  int32_t result;   /* of the exchange that it came with */
} haptic_force;
#define HAPTIC_FORCE_INIT {sizeof(haptic_force), 0, {0, 0, 0}, {0, 0, 0}, 0, 0}

typedef struct haptic_state {
  uint32_t size;
  int32_t result; /* of the newest exchange */
  uint64_t sent, answered;
  uint64_t silences;       /* times that no force had come for 7 ms, after the first one */
  uint64_t strange_forces; /* of a second daemon: not felt */
  double longest_silence_ms;
  int32_t realtime; /* of the library's thread: 1 SCHED_FIFO granted, -1 refused, 0 not asked for */
  int32_t reserved;
} haptic_state;
#define HAPTIC_STATE_INIT {sizeof(haptic_state), 0, 0, 0, 0, 0, 0, 0, 0}

typedef struct haptic_callbacks {
  uint32_t size;
  uint32_t reserved;
  int (*read)(void* user, haptic_pose* pose); /* your device's pose; not 0: it is lost, the thread ends */
  void (*write)(void* user, const haptic_force* force); /* once or twice a slot, at once; zero is the last */
  void* user;
} haptic_callbacks;
#define HAPTIC_CALLBACKS_INIT {sizeof(haptic_callbacks), 0, NULL, NULL, NULL}

/* Makes a client; says nothing to the daemon yet. error may be NULL. *client is NULL unless HAPTIC_OK. */
haptic_result haptic_open(const haptic_options* options, haptic_client** client, haptic_error* error);

/* Sleeps until the next millisecond of the client's own grid, which keeps a little before the daemon's tick. */
haptic_result haptic_next_slot(haptic_client* client);

/* Sends the pose and awaits its answer, for 0.9 ms at most. force is always filled in. */
haptic_result haptic_exchange(haptic_client* client, const haptic_pose* pose, haptic_force* force);

/* Starts the library's 1 kHz thread. With callbacks it calls them; with NULL it sends what haptic_set_pose said
   last (from the first one on), without `enable` where that is older than 100 ms. */
haptic_result haptic_start(haptic_client* client, const haptic_callbacks* callbacks);
haptic_result haptic_set_pose(haptic_client* client, const haptic_pose* pose);
/* Ends that thread, at zero. Not from a callback. */
haptic_result haptic_stop(haptic_client* client);

/* The newest force, and the counts so far; returns the force's result. Any thread, in either way of working. */
haptic_result haptic_get_force(haptic_client* client, haptic_force* force);
haptic_result haptic_get_state(haptic_client* client, haptic_state* state);

/* What a result means here, with domain and profile: at most size bytes, the last one 0. client may be NULL. */
void haptic_explain(const haptic_client* client, haptic_result result, char* text, size_t size);

/* Stops, tells the daemon, frees. NULL is allowed. No other thread may be in a call with this client. */
haptic_result haptic_close(haptic_client* client);

#ifdef __cplusplus
}
#endif

#endif
