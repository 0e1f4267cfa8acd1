#include "server/app/reference_maker.h"

#include "haptic/clock.h"

namespace hapticd {

ReferenceMaker::~ReferenceMaker() { stop(); }

void ReferenceMaker::start(std::function<void()> on_thread) {
  stopping_ = false;
  thread_ = std::thread([this, on_thread = std::move(on_thread)] {
    if (on_thread) on_thread();
    run();
  });
}

void ReferenceMaker::stop() noexcept {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  given_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void ReferenceMaker::give(ReferenceJob job) {
  {
    const std::lock_guard lock(mutex_);
    waiting_.push_back(std::move(job));
  }
  given_.notify_one();
}

std::optional<ReferenceJob> ReferenceMaker::take() {
  const std::lock_guard lock(mutex_);
  if (done_.empty()) return std::nullopt;
  ReferenceJob job = std::move(done_.front());
  done_.pop_front();
  return job;
}

void ReferenceMaker::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    given_.wait(lock, [this] { return stopping_ || !waiting_.empty(); });
    if (stopping_) return;
    ReferenceJob job = std::move(waiting_.front());
    waiting_.pop_front();
    lock.unlock();
    const std::int64_t begin = monotonic_ns();
    try {
      job.reference->make();
    } catch (const std::exception&) {
      job.failed =
          true;  // the body goes on with its old reference factor, and its report says how far that is off
    }
    make_time_.record(monotonic_ns() - begin);
    lock.lock();
    done_.push_back(std::move(job));
  }
}

}  // namespace hapticd
