// haptic/channel.h itself, not a copy, under the Relacy model checker: every interleaving of a writer of
// six values and a reader of six takes, and every stale value that the C++ memory model lets an atomic
// load return. Checked: no data race (hence nothing torn), never backwards, the newest is seen in the end,
// and a value that the reader keeps stays as it is (every other take).
//
//   channel_relacy            the header as it is: must pass
//   channel_relacy WEAKENED   one half of one ordering dropped: must fail, or the half was not needed
//     publish-release, publish-acquire, acquire-release, acquire-acquire
// Exit code: 0 no execution is wrong, 1 one is, 2 wrong usage.
// Source: D. Vyukov's Relacy Race Detector. Wait-freedom needs no search: neither function has a loop.
#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <iostream>
#include <memory>
#include <streambuf>
#include <string>

#include <relacy/relacy.hpp>  // last: it redefines words of the language
#undef new
#undef delete
#undef malloc
#undef free
#undef memory_order_relaxed
#undef memory_order_acq_rel

namespace checked {

using namespace std;  // all but what is named below: qualified look-up finds those first

constexpr rl::memory_order memory_order_relaxed = rl::mo_relaxed;
constexpr rl::memory_order memory_order_acq_rel = rl::mo_acq_rel;

// Of the exchanges by thread: 0 publishes, 1 acquires.
inline rl::memory_order exchange_order[2] = {rl::mo_acq_rel, rl::mo_acq_rel};

template <typename T>
class atomic {
 public:
  static constexpr bool is_always_lock_free = true;
  atomic(T initial) { value_.store(initial, rl::mo_relaxed, $); }
  T load(rl::memory_order order) const { return value_.load(order, $); }
  T exchange(T next, rl::memory_order order) {
    const rl::memory_order weakened = exchange_order[rl::ctx().threadx_->index_ == 0 ? 0 : 1];
    return value_.exchange(next, order == rl::mo_acq_rel ? weakened : order, $);
  }

 private:
  rl::atomic<T> value_;
};

}  // namespace checked

#define std checked
#include "haptic/channel.h"
#undef std

namespace {

constexpr int publishes = 6, takes = 6;

// Two words, so that a torn value would show even without the race that comes before it.
struct Payload {
  rl::var<int> first{0}, second{0};
};

struct ChannelModel : rl::test_suite<ChannelModel, 2> {
  std::unique_ptr<hapticd::Channel<Payload>> channel;
  std::unique_ptr<Payload> former;
  int seen = 0, kept = 0;

  void before() {
    channel = std::make_unique<hapticd::Channel<Payload>>();
    former = std::make_unique<Payload>();
  }

  void thread(unsigned index) {
    if (index == 0) {
      for (int n = 1; n <= publishes; ++n) {
        channel->back().first($) = n;
        channel->back().second($) = n;
        channel->publish();
      }
      return;
    }
    for (int k = 0; k < takes; ++k) {
      const bool keeps = k % 2 == 1, fresh = keeps ? channel->acquire(former) : channel->acquire();
      if (keeps && fresh) kept = seen;
      RL_ASSERT(former->first($) == kept && former->second($) == kept);
      Payload& p = const_cast<Payload&>(channel->front());
      const int first = p.first($), second = p.second($);
      RL_ASSERT(first == second);
      RL_ASSERT(fresh ? first > seen : first == seen);
      seen = first;
    }
  }

  // The reader's last word, the writer having ended.
  void after() {
    channel->acquire();
    RL_ASSERT(const_cast<Payload&>(channel->front()).first($) == publishes);
    channel.reset();
    former.reset();
  }
};

// Relacy's own output; a stream that allocates would do so from the heap under test.
struct Silence : std::streambuf {
  int overflow(int c) override { return c; }
};

bool weaken(const std::string& what) {
  if (what == "publish-release")
    checked::exchange_order[0] = rl::mo_acquire;
  else if (what == "publish-acquire")
    checked::exchange_order[0] = rl::mo_release;
  else if (what == "acquire-release")
    checked::exchange_order[1] = rl::mo_acquire;
  else if (what == "acquire-acquire")
    checked::exchange_order[1] = rl::mo_release;
  else
    return false;
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 2 || (argc == 2 && !weaken(argv[1]))) {
    std::cerr << "channel_relacy: usage: channel_relacy [publish-release | publish-acquire | "
                 "acquire-release | acquire-acquire]\n";
    return 2;
  }
  rl::test_params parameters;
  parameters.search_type = rl::fair_full_search_scheduler_type;
  Silence silence;
  std::ostream nowhere(&silence);
  parameters.output_stream = parameters.progress_stream = &nowhere;
  const bool good = rl::simulate<ChannelModel>(parameters);
  std::cout << (good ? "no execution is wrong" : rl::test_result_str(parameters.test_result)) << ", "
            << parameters.stop_iteration << " executions\n";
  return good ? 0 : 1;
}
