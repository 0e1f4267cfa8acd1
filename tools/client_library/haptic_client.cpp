// The C functions: results for exceptions, structures of older and newer headers, over a client (client.h).
#include "tools/client_library/haptic_client.h"

#include <algorithm>
#include <cstring>
#include <mutex>
#include <new>
#include <stdexcept>
#include <string>

#include "server/files/input_error.h"
#include "tools/client_library/client.h"

using namespace hapticd;

namespace {

// A structure of an older or newer header: what both know, the rest as `initial` has it.
template <typename T>
bool known(const T* theirs, std::size_t least) noexcept {
  return theirs && theirs->size >= least;
}
template <typename T>
T read_from(const T* theirs, T initial) noexcept {
  std::memcpy(&initial, theirs, std::min<std::size_t>(theirs->size, sizeof(T)));
  return initial;
}
template <typename T>
void write_to(T* theirs, T ours) noexcept {
  ours.size = theirs->size;
  std::memcpy(theirs, &ours, std::min<std::size_t>(theirs->size, sizeof(T)));
}

// The sizes that the first version had: a later one may only be longer.
constexpr std::size_t options_1 = 32, error_1 = 1352, pose_1 = 72, force_1 = 64, state_1 = 56,
                      callbacks_1 = 32;
static_assert(sizeof(haptic_options) >= options_1 && sizeof(haptic_error) >= error_1 &&
              sizeof(haptic_pose) >= pose_1 && sizeof(haptic_force) >= force_1 &&
              sizeof(haptic_state) >= state_1 && sizeof(haptic_callbacks) >= callbacks_1);

template <std::size_t N>
void copy(char (&to)[N], const std::string& from) noexcept {
  const std::size_t length = std::min(from.size(), N - 1);
  std::memcpy(to, from.data(), length);
  to[length] = 0;
}

haptic_result told(haptic_error* error, haptic_result result, const char* message,
                   const InputError* input) noexcept {
  if (!error) return result;
  haptic_error out = HAPTIC_ERROR_INIT;
  try {
    copy(out.message, message);
    if (input) {
      copy(out.file, input->file().string());
      copy(out.key, input->key());
      out.line = input->line();
    }
  } catch (...) {  // no memory for the text
  }
  write_to(error, out);
  return result;
}

const char* meaning(haptic_result result) noexcept {
  switch (result) {
    case HAPTIC_OK:
      return "all is well";
    case HAPTIC_CONNECTING:
      return "no force has come yet";
    case HAPTIC_STOPPED:
      return "the client's thread does not run";
    case HAPTIC_NO_DAEMON:
      return "no daemon answered: start one with `hapticd SCENE.yaml --domain N`, name its domain and "
             "device_id, or "
             "give the keys of one that runs with --secure";
    case HAPTIC_SILENT:
      return "the daemon has been silent for 7 ms or more: it died, it is held up, or one of both sides' "
             "keys "
             "have ended";
    case HAPTIC_SECOND_DAEMON:
      return "two daemons, or one and somebody who plays one, serve this device: stop one, then let the "
             "device go "
             "(enable 0) once";
    case HAPTIC_OTHER_CLIENT:
      return "the daemon serves another client of this device: end that one first";
    case HAPTIC_BAD_POSE:
      return "the pose is not finite or its orientation is no unit quaternion: it was not sent";
    case HAPTIC_WRONG_THREAD:
      return "another thread exchanges with this client, or the library's own does; it may not stop itself "
             "either";
    case HAPTIC_BAD_ARGUMENT:
      return "a required pointer is NULL, or a structure's size was not set (HAPTIC_..._INIT)";
    case HAPTIC_BAD_DEVICE:
      return "the device's file or the keys cannot be used";
    case HAPTIC_NO_DDS:
      return "Cyclone DDS refused";
    case HAPTIC_NO_MEMORY:
      return "no memory, or no thread";
    case HAPTIC_CALLBACK:
      return "a callback threw an exception: the client's thread has ended, at zero";
  }
  return "no result of this library";
}

}  // namespace

#pragma GCC visibility push(default)

haptic_result haptic_open(const haptic_options* options, haptic_client** client, haptic_error* error) try {
  if (client) *client = nullptr;
  if (error && !known(error, error_1)) return HAPTIC_BAD_ARGUMENT;
  if (!client || !known(options, options_1))
    return told(error, HAPTIC_BAD_ARGUMENT, meaning(HAPTIC_BAD_ARGUMENT), nullptr);
  *client = new haptic_client(read_from(options, haptic_options HAPTIC_OPTIONS_INIT));
  return HAPTIC_OK;
} catch (const InputError& e) {
  return told(error, HAPTIC_BAD_DEVICE, e.what(), &e);
} catch (const std::invalid_argument& e) {
  return told(error, HAPTIC_BAD_ARGUMENT, e.what(), nullptr);
} catch (const std::bad_alloc&) {
  return told(error, HAPTIC_NO_MEMORY, "no memory", nullptr);
} catch (const std::exception& e) {
  return told(error, HAPTIC_NO_DDS, e.what(), nullptr);
} catch (...) {
  return told(error, HAPTIC_NO_DDS, "unknown", nullptr);
}

haptic_result haptic_next_slot(haptic_client* client) {
  if (!client) return HAPTIC_BAD_ARGUMENT;
  if (!client->enter()) return HAPTIC_WRONG_THREAD;
  client->exchange.next_slot();
  client->leave();
  return HAPTIC_OK;
}

haptic_result haptic_exchange(haptic_client* client, const haptic_pose* pose, haptic_force* force) {
  if (!known(force, force_1)) return HAPTIC_BAD_ARGUMENT;
  haptic_force felt = HAPTIC_FORCE_INIT;
  felt.status = status_disarmed;
  if (!client || !known(pose, pose_1)) {
    felt.result = HAPTIC_BAD_ARGUMENT;
  } else if (!client->enter()) {
    felt.result = HAPTIC_WRONG_THREAD;
  } else {
    felt = client->swap(read_from(pose, haptic_pose HAPTIC_POSE_INIT), nullptr);
    client->leave();
  }
  write_to(force, felt);
  return static_cast<haptic_result>(felt.result);
}

haptic_result haptic_start(haptic_client* client, const haptic_callbacks* callbacks) try {
  if (!client) return HAPTIC_BAD_ARGUMENT;
  if (!callbacks) return client->start(nullptr);
  if (!known(callbacks, callbacks_1)) return HAPTIC_BAD_ARGUMENT;
  const haptic_callbacks own = read_from(callbacks, haptic_callbacks HAPTIC_CALLBACKS_INIT);
  return own.read && own.write ? client->start(&own) : HAPTIC_BAD_ARGUMENT;
} catch (...) {
  return HAPTIC_NO_MEMORY;
}

haptic_result haptic_set_pose(haptic_client* client, const haptic_pose* pose) try {
  if (!client || !known(pose, pose_1)) return HAPTIC_BAD_ARGUMENT;
  return client->set_pose(read_from(pose, haptic_pose HAPTIC_POSE_INIT));
} catch (...) {
  return HAPTIC_NO_MEMORY;
}

haptic_result haptic_get_force(haptic_client* client, haptic_force* force) try {
  if (!client || !known(force, force_1)) return HAPTIC_BAD_ARGUMENT;
  const std::lock_guard lock(client->getters);
  client->news.acquire();
  write_to(force, client->news.front().force);
  return static_cast<haptic_result>(client->news.front().force.result);
} catch (...) {
  return HAPTIC_NO_MEMORY;
}

haptic_result haptic_get_state(haptic_client* client, haptic_state* state) try {
  if (!client || !known(state, state_1)) return HAPTIC_BAD_ARGUMENT;
  const std::lock_guard lock(client->getters);
  client->news.acquire();
  write_to(state, client->news.front().state);
  return HAPTIC_OK;
} catch (...) {
  return HAPTIC_NO_MEMORY;
}

void haptic_explain(const haptic_client* client, haptic_result result, char* text, size_t size) {
  if (!text || size == 0) return;
  text[0] = 0;
  std::strncat(text, meaning(result), size - 1);
  if (!client) return;
  const auto add = [&](const char* more) { std::strncat(text, more, size - 1 - std::strlen(text)); };
  if (result == HAPTIC_OK || result == HAPTIC_BAD_POSE || result == HAPTIC_WRONG_THREAD) return;
  add(" (");
  add(client->exchange.place().c_str());
  add(")");
}

haptic_result haptic_stop(haptic_client* client) try {
  return client ? client->stop() : HAPTIC_BAD_ARGUMENT;
} catch (...) {
  return HAPTIC_NO_MEMORY;
}

haptic_result haptic_close(haptic_client* client) try {
  if (!client) return HAPTIC_OK;
  if (const haptic_result result = client->stop(); result != HAPTIC_OK) return result;
  delete client;
  return HAPTIC_OK;
} catch (...) {
  return HAPTIC_NO_MEMORY;
}

#pragma GCC visibility pop
