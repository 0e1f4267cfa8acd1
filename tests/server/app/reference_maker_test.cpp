// Reference factors made on a thread of their own: handed back whole, also where making them fails.
#include "server/app/reference_maker.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>

namespace hapticd {
namespace {

struct Fake final : ReferenceFactor {
  explicit Fake(std::function<void()> work) : work_(std::move(work)) {}
  void make() override { work_(); }
  std::function<void()> work_;
};

ReferenceJob job(int body, std::function<void()> work) {
  return {body, std::make_unique<Fake>(std::move(work)), false};
}

// Waits as the simulation does, by asking again.
ReferenceJob await(ReferenceMaker& maker) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (std::chrono::steady_clock::now() < end) {
    if (std::optional<ReferenceJob> done = maker.take()) return std::move(*done);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  ADD_FAILURE() << "no base came back";
  return {};
}

TEST(ReferenceMaker, MakesInOrderOnItsOwnThread) {
  ReferenceMaker maker;
  maker.start();
  std::atomic<std::thread::id> where;
  maker.give(job(3, [&] { where = std::this_thread::get_id(); }));
  maker.give(job(5, [] {}));
  EXPECT_EQ(await(maker).body, 3);
  const ReferenceJob second = await(maker);
  EXPECT_EQ(second.body, 5);
  EXPECT_FALSE(second.failed);
  EXPECT_NE(where.load(), std::this_thread::get_id());
  EXPECT_FALSE(maker.take());
  EXPECT_EQ(maker.make_time().snapshot().count, 2u);
}

TEST(ReferenceMaker, AFailureComesBackAsOneAndTheNextIsMade) {
  ReferenceMaker maker;
  maker.start();
  maker.give(job(0, [] { throw std::runtime_error("not positive definite"); }));
  maker.give(job(1, [] {}));
  EXPECT_TRUE(await(maker).failed);
  EXPECT_FALSE(await(maker).failed);
}

TEST(ReferenceMaker, StopsWithWorkWaiting) {
  ReferenceMaker maker;
  std::atomic<int> made = 0;
  maker.start();
  for (int i = 0; i < 3; ++i)
    maker.give(job(i, [&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      ++made;
    }));
  while (made == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  maker.stop();
  EXPECT_LT(made, 3);
  maker.stop();  // again does nothing
  ReferenceMaker never_started;
}

}  // namespace
}  // namespace hapticd
