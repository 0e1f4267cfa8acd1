// A recording on the page: the motion is the recording's, what the tissue does is computed again, in virtual
// time.
//
// A recording holds poses and pedals, not the tissue; offline_replay.h plays them to the scene in a thread of
// its own, faster than they were made, and a frame of each second step (25 a second) is kept. Playing begins
// with the first frame; the timeline ends where the computing has come to. Viewers share one timeline. Texts
// understood:
//   {"timeline": {"playing": true}}   {"timeline": {"seek": 3.5}}   {"timeline": {"speed": 0.5}}
// and it says, beside the scene's messages (scene.h), status, health/0 and operation as a live daemon's, and
//   timeline   JSON: t, duration, ready [s], playing, speed, name, done, failure
// Memory: about 20 kB a frame of the published lens; recordings above ten minutes are refused.
// Thread safety: one thread. Errors: InputError for a recording or scene that cannot be read, UsageError for
// one that is too long; a scene that breaks while it is computed ends the timeline there and is said in it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/view/outbox.h"

namespace hapticd {

class Playback {
 public:
  Playback(const std::string& recording, const std::string& topic, const std::string& scene);
  ~Playback();

  std::vector<SharedMessage> poll();
  void hear(const std::string& text);
  bool failed() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace hapticd
