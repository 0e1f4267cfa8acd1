// The control of the thread sanitizer: haptic/channel.h with its exchanges relaxed, hammered as
// channel_test.cpp hammers the real one. Built under TSan this must be reported as a race; if it is not,
// the silence of Channel.MillionsOfPublishes… proves nothing.
#include <atomic>
#include <memory>
#include <thread>

#define memory_order_acq_rel memory_order_relaxed
#include "haptic/channel.h"

int main() {
  constexpr int publishes = 200'000;
  hapticd::Channel<std::array<int, 16>> channel;
  std::thread reader([&] {
    for (int last = 0; last < publishes;)
      if (channel.acquire()) last = channel.front().back();
  });
  for (int n = 1; n <= publishes; ++n) {
    channel.back().fill(n);
    channel.publish();
  }
  reader.join();
}
