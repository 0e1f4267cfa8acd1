#include "haptic/channel.h"

#include <thread>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

// A value whose words betray a tear: each is derived from the number, and a checksum closes it.
struct Payload {
  std::uint64_t number = 0;
  std::array<std::uint64_t, 14> word{};
  std::uint64_t checksum = 0;

  void fill(std::uint64_t n) noexcept {
    number = n;
    checksum = n;
    for (std::size_t i = 0; i < word.size(); ++i) checksum ^= word[i] = (n + i) * 0x9e3779b97f4a7c15u;
  }
  bool whole() const noexcept {
    std::uint64_t sum = number;
    for (std::size_t i = 0; i < word.size(); ++i) {
      if (word[i] != (number + i) * 0x9e3779b97f4a7c15u && number) return false;
      sum ^= word[i];
    }
    return sum == checksum;
  }
};

TEST(Channel, MillionsOfPublishesNoneTornNoneGoingBack) {
  constexpr std::uint64_t publishes = 2'500'000;
  Channel<Payload> channel;
  std::uint64_t torn = 0, back = 0, taken = 0, last = 0;
  std::thread reader([&] {
    while (last < publishes) {
      if (!channel.acquire()) continue;
      const Payload& p = channel.front();
      torn += !p.whole();
      back += p.number <= last;
      last = p.number;
      ++taken;
    }
  });
  for (std::uint64_t n = 1; n <= publishes; ++n) {
    channel.back().fill(n);
    channel.publish();
  }
  reader.join();
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(back, 0u);
  EXPECT_EQ(last, publishes);  // the last publication is never lost
  EXPECT_GT(taken, 1u);
}

// The value that was looked at before stays as it was, however much is published meanwhile.
TEST(Channel, AFormerValueThatIsKeptIsNeverWritten) {
  constexpr std::uint64_t publishes = 1'000'000;
  Channel<Payload> channel;
  std::uint64_t torn = 0, strange = 0, last = 0;
  std::thread reader([&] {
    auto former = std::make_unique<Payload>();
    while (last < publishes) {
      const bool keeps = last % 3 != 0;
      const std::uint64_t kept = keeps ? last : former->number;
      if (!(keeps ? channel.acquire(former) : channel.acquire())) continue;
      torn += !channel.front().whole() + !former->whole();
      strange += former->number != kept;
      last = channel.front().number;
    }
  });
  for (std::uint64_t n = 1; n <= publishes; ++n) {
    channel.back().fill(n);
    channel.publish();
  }
  reader.join();
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(strange, 0u);
}

TEST(Channel, NothingNewLeavesTheSpareAlone) {
  Channel<int> channel;
  auto spare = std::make_unique<int>(7);
  EXPECT_FALSE(channel.acquire(spare));
  EXPECT_EQ(*spare, 7);
}

TEST(Channel, ReaderGetsTheNewestOnceAndKeepsIt) {
  Channel<int> channel;
  EXPECT_FALSE(channel.acquire());
  for (int i = 1; i <= 5; ++i) {
    channel.back() = i;
    channel.publish();
  }
  EXPECT_TRUE(channel.acquire());
  EXPECT_EQ(channel.front(), 5);
  EXPECT_FALSE(channel.acquire());
  EXPECT_EQ(channel.front(), 5);
}

}  // namespace
}  // namespace hapticd
