// A writer's numbers, as messages written by hand have them.
#include "server/dds/rtps_numbers.h"

#include <gtest/gtest.h>

#include <vector>

namespace hapticd {
namespace {

using Packet = std::vector<std::uint8_t>;
constexpr std::int64_t ms = 1'000'000;

void word(Packet& p, std::uint64_t value, bool little) {
  for (int i = 0; i < 4; ++i) p.push_back(static_cast<std::uint8_t>(value >> 8 * (little ? i : 3 - i)));
}
void number(Packet& p, std::int64_t value, bool little = true) {
  word(p, static_cast<std::uint64_t>(value) >> 32, little);
  word(p, static_cast<std::uint64_t>(value) & 0xffffffff, little);
}
Packet header(std::uint8_t client = 1) {
  Packet p = {'R', 'T', 'P', 'S', 2, 1, 1, 16};
  p.insert(p.end(), 12, client);
  return p;
}
void append(Packet& p, std::uint8_t kind, const Packet& body, bool little = true) {
  const auto size = static_cast<std::uint8_t>(body.size());
  const std::uint8_t none = 0;
  p.insert(p.end(), {kind, static_cast<std::uint8_t>(little), little ? size : none, little ? none : size});
  p.insert(p.end(), body.begin(), body.end());
}
Packet data(std::int64_t n, std::uint8_t client = 1, std::uint8_t entity = 0x02, bool little = true) {
  Packet body = {0, 0, 16, 0, 0, 0, 0, 0, 0, 0, 8, entity};
  number(body, n, little);
  Packet p = header(client);
  append(p, 0x15, body, little);
  return p;
}
// GAP up to n, or HEARTBEAT from n on.
Packet leading(std::uint8_t kind, std::int64_t n) {
  Packet body = {0, 0, 0, 0, 0, 0, 8, 2};
  number(body, kind == 0x08 ? 1 : n);
  number(body, n);
  Packet p = header();
  append(p, kind, body);
  return p;
}

TEST(RtpsNumbers, WhatRisesOrComesLateIsTaken) {
  RtpsNumbers numbers;
  for (std::int64_t n = 1; n < 5000; ++n) EXPECT_TRUE(numbers.take(data(n), n * ms));
  EXPECT_TRUE(numbers.take(data(10), 5000 * ms));
  EXPECT_TRUE(numbers.take(data(5000 + RtpsNumbers::farthest - 1), 5001 * ms));
}

// One message in a client's name: the client's own are taken before and after.
TEST(RtpsNumbers, ALeapIsRefusedAndForgotten) {
  RtpsNumbers numbers;
  ASSERT_TRUE(numbers.take(data(1000), 1000 * ms));
  for (const std::int64_t far : {std::int64_t{1} << 40, std::int64_t{INT64_MAX}, std::int64_t{1001 + 2000}}) {
    EXPECT_FALSE(numbers.take(data(far), 1000 * ms)) << far;
    EXPECT_FALSE(numbers.take(data(far, 1, 0x02, false), 1000 * ms)) << far;
    EXPECT_FALSE(numbers.take(leading(0x08, far), 1000 * ms)) << far;
    EXPECT_FALSE(numbers.take(leading(0x07, far), 1000 * ms)) << far;
  }
  EXPECT_TRUE(numbers.take(data(1001), 1001 * ms));
  EXPECT_FALSE(numbers.take(data(9000), 1001 * ms));
}

TEST(RtpsNumbers, AWriterThatIsHeardOfAgainMayBeAnywhere) {
  RtpsNumbers numbers;
  ASSERT_TRUE(numbers.take(data(1000), 1000 * ms));
  EXPECT_FALSE(numbers.take(data(90'000), 1999 * ms));
  EXPECT_TRUE(numbers.take(data(90'000), 2001 * ms));
  EXPECT_TRUE(numbers.take(data(90'001), 2002 * ms));
}

// Cyclone drops what is numbered below 1. It must neither be remembered nor subtracted.
TEST(RtpsNumbers, WhatNoWriterCountsIsLeftToOthers) {
  RtpsNumbers numbers;
  EXPECT_TRUE(numbers.take(data(INT64_MIN), ms));
  ASSERT_TRUE(numbers.take(data(1000), ms));
  for (const std::int64_t n : {std::int64_t{INT64_MIN}, std::int64_t{-1}, std::int64_t{0}})
    EXPECT_TRUE(numbers.take(data(n), 2 * ms));
  EXPECT_FALSE(numbers.take(data(INT64_MAX), 3 * ms));
  EXPECT_TRUE(numbers.take(data(1001), 3 * ms));
}

TEST(RtpsNumbers, WritersAreApart) {
  RtpsNumbers numbers;
  ASSERT_TRUE(numbers.take(data(1), ms));
  EXPECT_TRUE(numbers.take(data(90'000, 2), ms));
  EXPECT_TRUE(numbers.take(data(90'000, 1, 0xc2), ms));  // discovery's
  // In another's name by INFO_SRC.
  Packet body(8, 0), p = header(2);
  body.insert(body.end(), 12, 1);
  append(p, 0x0c, body);
  const Packet forged = data(90'000);
  p.insert(p.end(), forged.begin() + 20, forged.end());
  EXPECT_FALSE(numbers.take(p, 2 * ms));
}

TEST(RtpsNumbers, WhatIsCutIsLeftToOthers) {
  RtpsNumbers numbers;
  ASSERT_TRUE(numbers.take(data(1), ms));
  const Packet whole = data(90'000);
  for (std::size_t size = 0; size < whole.size(); ++size)
    numbers.take({whole.data(), size}, ms);  // within its bounds: the address sanitizer
  EXPECT_TRUE(numbers.take(data(2), 2 * ms));
}

}  // namespace
}  // namespace hapticd
