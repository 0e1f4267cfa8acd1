// Whom a browser may believe to be talking to.
#include "server/os/host_name.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

TEST(HostName, LoopbackIsLocalhostAndItsAddresses) {
  for (const char* host :
       {"localhost", "LocalHost:8080", "127.0.0.1", "127.0.0.1:1", "127.8.9.10", "[::1]", "[::1]:80"})
    EXPECT_TRUE(is_loopback_host(host)) << host;
  for (const char* host : {"", "evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "10.0.0.1",
                           "[::2]", "0.0.0.0", "[::1", "127.1", "localhost@evil.example"})
    EXPECT_FALSE(is_loopback_host(host)) << host;
}

TEST(HostName, AnAddressCannotBeReboundANameCan) {
  for (const char* host : {"10.0.0.1:8080", "[fe80::1]:80", "localhost"})
    EXPECT_TRUE(is_address_host(host)) << host;
  for (const char* host : {"evil.example", "10.0.0.1.evil.example", "", "[]", "[evil]"})
    EXPECT_FALSE(is_address_host(host)) << host;
}

TEST(HostName, TheHostOfAnOrigin) {
  EXPECT_EQ(host_of_origin("http://localhost:8080"), "localhost:8080");
  EXPECT_EQ(host_of_origin("https://a.example"), "a.example");
  EXPECT_EQ(host_of_origin("null"), "");
  EXPECT_EQ(host_of_origin("file://"), "");
}

}  // namespace
}  // namespace hapticd
