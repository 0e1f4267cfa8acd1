#include "server/os/core_isolation.h"

#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <future>
#include <string>
#include <thread>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

cpu_set_t set_of(const std::vector<int>& cores) {
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int core : cores) CPU_SET(core, &set);
  return set;
}

// A thread that waits, of this process: moved as the kernel's are.
class Waiting {
 public:
  explicit Waiting(const std::vector<int>& cores) {
    std::promise<pid_t> id;
    thread_ = std::thread([this, &id, set = set_of(cores)] {
      sched_setaffinity(0, sizeof set, &set);
      id.set_value(gettid());
      ends_.get_future().wait();
    });
    id_ = id.get_future().get();
  }
  ~Waiting() { end(); }
  void end() {
    if (!thread_.joinable()) return;
    ends_.set_value();
    thread_.join();
  }
  pid_t id() const { return id_; }
  std::vector<int> cores() const {
    cpu_set_t set;
    std::vector<int> found;
    if (sched_getaffinity(id_, sizeof set, &set) == 0)
      for (int i = 0; i < CPU_SETSIZE; ++i)
        if (CPU_ISSET(i, &set)) found.push_back(i);
    return found;
  }
  void move(const std::vector<int>& cores) const {
    const cpu_set_t set = set_of(cores);
    sched_setaffinity(id_, sizeof set, &set);
  }

 private:
  std::promise<void> ends_;
  pid_t id_ = 0;
  std::thread thread_;
};

TEST(CoreIsolation, KeepsThreadsOffWhileItLivesAndGivesTheirCoresBack) {
  const std::vector<int> all = process_cores();
  if (all.size() < 2) GTEST_SKIP() << "one core: there is nowhere to go";
  const int core = all.back();
  const std::vector<int> others(all.begin(), all.end() - 1);
  const Waiting anywhere(all), bound({core}), elsewhere({all.front()}), moved_on(all);
  Waiting ends(all);
  {
    const CoreIsolation quiet(core, {anywhere.id(), bound.id(), elsewhere.id(), moved_on.id(), ends.id()});
    EXPECT_TRUE(quiet.grant().granted) << quiet.grant().detail;
    EXPECT_EQ(anywhere.cores(), others);
    EXPECT_EQ(bound.cores(), std::vector<int>{core});  // may run on no other
    EXPECT_EQ(elsewhere.cores(), std::vector<int>{all.front()});
    moved_on.move({core});  // somebody else's wish
    ends.end();
  }
  EXPECT_EQ(anywhere.cores(), all);
  EXPECT_EQ(bound.cores(), std::vector<int>{core});
  EXPECT_EQ(elsewhere.cores(), std::vector<int>{all.front()});
  EXPECT_EQ(moved_on.cores(), std::vector<int>{core});
}

TEST(CoreIsolation, FindsThreadsOfTheKernelOnlyAndNoneOfTheirsThatIsBound) {
  for (const pid_t thread : movable_kernel_threads()) {
    EXPECT_NE(thread, getpid());
    std::ifstream in("/proc/" + std::to_string(thread) + "/cmdline");
    EXPECT_EQ(in.get(), EOF) << thread;  // the kernel's have none
    std::string name;
    std::getline(std::ifstream("/proc/" + std::to_string(thread) + "/comm"), name);
    EXPECT_EQ(name.find("migration/"), std::string::npos) << name;
    EXPECT_EQ(name.find("ksoftirqd/"), std::string::npos) << name;
  }
}

TEST(CoreIsolation, ARefusalIsAGrantThatSaysTheWayOutAndMovesNothing) {
  const std::vector<int> all = process_cores();
  if (all.size() < 2) GTEST_SKIP() << "one core: there is nowhere to go";
  if (geteuid() != 0) GTEST_SKIP() << "nobody else's thread to be refused";
  constexpr long nobody = 65534;
  const Waiting roots(all);
  std::thread([&] {
    // The system call itself: the library's changes every thread of the process.
    ASSERT_EQ(syscall(SYS_setresuid, nobody, nobody, nobody), 0);
    const CoreIsolation quiet(all.back(), {roots.id()});
    EXPECT_FALSE(quiet.grant().granted);
    EXPECT_EQ(quiet.grant().what, "kernel threads off core " + std::to_string(all.back()));
    EXPECT_NE(quiet.grant().detail.find("CAP_SYS_NICE"), std::string::npos);
    EXPECT_EQ(roots.cores(), all);
  }).join();
}

}  // namespace
}  // namespace hapticd
