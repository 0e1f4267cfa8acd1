// The thread that makes compliance reference factors while the simulation goes on with the old ones.
//
//   simulation thread: give(job) → make() on the maker's thread → take() between two steps → World::adopt
//
// Nothing waits: `give` and `take` hold a lock only to move a pointer, and a job that is not done is not
// there to be taken. A job whose `make` throws comes back `failed`.
// Thread safety: start and stop belong to one thread, give and take to another (or the same).
// A job under way when `stop` is called is finished first, at most some seconds for a body of 20 000 nodes.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "haptic/histogram.h"
#include "physics/simulation/world.h"

namespace hapticd {

class ReferenceMaker {
 public:
  ReferenceMaker() = default;
  ~ReferenceMaker();
  ReferenceMaker(const ReferenceMaker&) = delete;
  ReferenceMaker& operator=(const ReferenceMaker&) = delete;

  // on_thread runs on the new thread first: the place for priority and affinity.
  void start(std::function<void()> on_thread = {});
  void stop() noexcept;

  void give(ReferenceJob job);
  std::optional<ReferenceJob> take();

  const Histogram& make_time() const noexcept { return make_time_; }

 private:
  void run();

  std::mutex mutex_;
  std::condition_variable given_;
  std::deque<ReferenceJob> waiting_;
  std::deque<ReferenceJob> done_;
  bool stopping_ = false;
  Histogram make_time_;
  std::thread thread_;
};

}  // namespace hapticd
