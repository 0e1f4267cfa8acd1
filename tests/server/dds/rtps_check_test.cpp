// What is given to Cyclone, by messages written by hand or captured, and by what was found to abort it.
#include "server/dds/rtps_check.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "server/files/paths.h"
#include "tools/robustness/packet_attack.h"

namespace hapticd {
namespace {

Packet from_hex(const std::string& hex) {
  Packet p;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    p.push_back(static_cast<std::uint8_t>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  return p;
}

const std::string header =
    "52545053"
    "0201"
    "0110"
    "000102030405060708090a0b";
const std::string hash(28, '7');

struct Type {
  std::string minimal = "f1", complete = "f2";
  std::string count = "00000000", length = "00000000", list_size = "04000000";
  // With code 4: header, size, size of the type, size of the hash, hash, its object's size, dependencies.
  std::string member(const std::string& id, const std::string& kind) const {
    return id +
           "28000000"
           "24000000"
           "14000000" +
           kind + hash +
           "00"
           "f8000000" +
           count + list_size + length;
  }
  std::string text() const { return "60000000" + member("01100040", minimal) + member("02100040", complete); }
};

// DATA of the writer of subscriptions (SEDP), little-endian, with one parameter and the sentinel.
Packet announcement(const std::string& type, const std::string& pid = "7500",
                    const std::string& writer = "000004c2") {
  char length[9];
  std::snprintf(length, sizeof length, "%02x%02x", static_cast<unsigned>(type.size() / 2 % 256),
                static_cast<unsigned>(type.size() / 512));
  const std::string body =
      "00001000"
      "00000000" +
      writer +
      "00000000"
      "01000000"
      "00030000" +
      pid + length + type + "01000000";
  char size[9];
  std::snprintf(size, sizeof size, "%02x%02x", static_cast<unsigned>(body.size() / 2 % 256),
                static_cast<unsigned>(body.size() / 512));
  return from_hex(header + "1505" + size + body);
}

TEST(RtpsCheck, ATypeOfTwoHashesIsSafe) { EXPECT_TRUE(rtps_is_safe(announcement(Type{}.text()))); }

TEST(RtpsCheck, ATypeOfAnotherKindIsNot) {
  for (int kind = 0; kind < 256; ++kind) {
    char text[3];
    std::snprintf(text, sizeof text, "%02x", static_cast<unsigned>(kind));
    Type minimal, complete;
    minimal.minimal = complete.complete = text;
    EXPECT_EQ(rtps_is_safe(announcement(minimal.text())), kind == 0xf1) << text;
    EXPECT_EQ(rtps_is_safe(announcement(complete.text())), kind == 0xf2) << text;
  }
}

TEST(RtpsCheck, SizesAndCountsMustFit) {
  const std::vector<std::function<void(Type&)>> changes = {
      [](Type& t) { t.list_size = "ffffff7f"; }, [](Type& t) { t.list_size = "00000000"; },
      [](Type& t) { t.length = "01000000"; }, [](Type& t) { t.length = "ffffffff"; },
      [](Type& t) { t.count = "feffffff"; }};
  for (std::size_t i = 0; i < changes.size(); ++i) {
    Type t;
    changes[i](t);
    EXPECT_FALSE(rtps_is_safe(announcement(t.text()))) << i;
  }
  Type unknown_count;
  unknown_count.count = "ffffffff";
  EXPECT_TRUE(rtps_is_safe(announcement(unknown_count.text())));
}

TEST(RtpsCheck, NoWordOfATypeMayBeAnother) {
  const Packet good = announcement(Type{}.text());
  // Up to the hash: parameter, sizes and kind.
  const std::size_t first = good.size() - 4 - Type{}.text().size() / 2;
  for (const std::size_t word : {0u, 4u, 8u, 12u, 16u}) {
    Packet p = good;
    for (std::size_t i = 0; i < 4; ++i) p[first + word + i] = 0xff;
    EXPECT_FALSE(rtps_is_safe(p)) << word;
  }
}

// The flag "must be understood" and the other byte order do not hide it; another parameter is no type.
TEST(RtpsCheck, ATypeIsFoundHoweverItIsAnnounced) {
  Type bad;
  bad.minimal = "ff";
  EXPECT_FALSE(rtps_is_safe(announcement(bad.text(), "7540")));
  EXPECT_FALSE(rtps_is_safe(announcement(bad.text(), "7500", "00000102")));
  EXPECT_TRUE(rtps_is_safe(announcement(bad.text(), "7600")));
}

TEST(RtpsCheck, WholeTypesAndDiscoveryInPiecesAreRefused) {
  EXPECT_FALSE(rtps_is_safe(announcement(Type{}.text(), "7500", "000300c3")));
  EXPECT_FALSE(rtps_is_safe(announcement(Type{}.text(), "7500", "000301c3")));
  Packet piece = announcement(Type{}.text());
  piece[20] = 0x16;
  EXPECT_FALSE(rtps_is_safe(piece));
  Packet of_data = announcement(Type{}.text(), "7500", "00000102");
  of_data[20] = 0x16;
  EXPECT_TRUE(rtps_is_safe(of_data));
}

TEST(RtpsCheck, AListWithoutAnEndIsRefused) {
  Packet p = announcement(Type{}.text());
  p[p.size() - 4] = 0x02;
  EXPECT_FALSE(rtps_is_safe(p));
}

// The messages that were found to abort Cyclone: the type's kind is ff ff ff 7f.
TEST(RtpsCheck, WhatAbortedCycloneIsRefused) {
  const Packet subscription = from_hex(
      "52545053020101100110661eaaa9e27cbfdb6151090108005d97036b89fcee53150518010000100000000000000004c2000000"
      "000100"
      "00000003000005001c00150000006861707469632f7365727665722f73746174757300000000070020001b0000006861707469"
      "636"
      "43a3a6d73673a3a536572766572537461747573"
      "00001d000400010000001a000c0002000000000000009a99991973000800020000000000020075006400600000000110004028"
      "0000"
      "002400000014000000ffffff7ffccfde8e9fff690c28826200f800000000000000040000000000000002100040280000002400"
      "000"
      "014000000f2ca222d07a2b1be3f087d433d2d7300e601000000000000040000000000000015000400020100001600040001100"
      "0005"
      "a0010000110661eaaa9e27cbfdb6151000002070c8004000100000001000000");
  EXPECT_FALSE(rtps_is_safe(subscription));
  Packet mended = subscription;
  const std::string broken = "ffffff7f";
  const Packet kind = from_hex(broken);
  const auto at = std::search(mended.begin(), mended.end(), kind.begin(), kind.end());
  ASSERT_NE(at, mended.end());
  *at = 0xf1;
  EXPECT_TRUE(rtps_is_safe(mended));
}

TEST(RtpsCheck, WhatOurOwnSayIsSafe) {
  for (const Packet& p : read_packets(config_file("dds/packets.hex"))) EXPECT_TRUE(rtps_is_safe(p));
}

TEST(RtpsCheck, EveryBeginningIsReadWithinItsBounds) {
  for (const Packet& p : read_packets(config_file("dds/packets.hex")))
    for (std::size_t n = 0; n <= p.size(); ++n) {
      const Packet beginning(p.begin(), p.begin() + static_cast<long>(n));  // the sanitizer watches its end
      rtps_is_safe(beginning);
    }
  std::mt19937_64 random(1);
  for (int i = 0; i < 20'000; ++i)
    for (Packet p : {announcement(Type{}.text())}) {
      mutate(p, random);
      rtps_is_safe(p);
    }
}

}  // namespace
}  // namespace hapticd
