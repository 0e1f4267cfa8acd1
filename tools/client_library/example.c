/* Presses 1.5 mm into the cube for ten seconds: haptic_press [DOMAIN] [KEYS]. Your device goes where the ramp is. */
#include <haptic_client.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char** argv) {
  haptic_options options = HAPTIC_OPTIONS_INIT;
  haptic_error error = HAPTIC_ERROR_INIT;
  haptic_pose pose = HAPTIC_POSE_INIT;
  haptic_force force = HAPTIC_FORCE_INIT;
  haptic_state before = HAPTIC_STATE_INIT, after = HAPTIC_STATE_INIT;
  haptic_client* client;
  options.device = "touch"; /* your device's limits: a name of config/devices, or a file */
  if (argc > 1) options.domain = (uint32_t)atoi(argv[1]);
  if (argc > 2) options.keys = argv[2];
  if (haptic_open(&options, &client, &error) != HAPTIC_OK) return fprintf(stderr, "%s\n", error.message), 1;
  double peak = 0;
  int slots = -1000; /* a second to be armed and to reach the cube, then ten that count */
  for (; slots < 10000; ++slots) {
    if (slots == 0) haptic_get_state(client, &before);
    haptic_next_slot(client);
    pose.position[2] = slots < 0 ? 0.0215 - 8.5e-6 * slots : 0.0215; /* your SDK: the pose, in metres */
    if (haptic_exchange(client, &pose, &force) == HAPTIC_NO_DAEMON) break;
    if (force.force[2] > peak) peak = force.force[2]; /* your SDK: the motors, in newtons */
  }
  haptic_get_state(client, &after);
  haptic_explain(client, (haptic_result)force.result, error.message, sizeof error.message);
  printf("%d slots, %d answered, peak force %.4f N: %s\n", slots, (int)(after.answered - before.answered), peak, error.message);
  haptic_close(client);
  return slots == 10000 ? 0 : 1;
}
