// Which sockets a domain opens, and what of what arrives there Cyclone is given.
#include "server/dds/dds_sockets.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "server/dds/dds.h"

namespace hapticd {
namespace {

// Local addresses of this process's UDP sockets, as the kernel lists them.
std::vector<std::string> udp_addresses() {
  std::vector<std::string> own, found;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code gone;
    const std::string link = std::filesystem::read_symlink(entry, gone).string();
    if (!gone && link.rfind("socket:[", 0) == 0) own.push_back(link.substr(8, link.size() - 9));
  }
  for (const char* table : {"/proc/self/net/udp", "/proc/self/net/udp6"}) {
    std::ifstream in(table);
    std::string line;
    std::getline(in, line);
    while (std::getline(in, line)) {
      std::istringstream words(line);
      std::vector<std::string> word;
      for (std::string w; words >> w;) word.push_back(w);
      if (word.size() > 9 && std::find(own.begin(), own.end(), word[9]) != own.end())
        found.push_back(word[1].substr(0, word[1].find(':')));
    }
  }
  return found;
}

TEST(DdsSockets, AProfileOfLoopbackHasSocketsOfLoopbackAlone) {
  const Domain domain(static_cast<std::uint32_t>(getpid()) % 100 + 100, read_dds_profile("loopback"));
  const Participant first(domain), second(domain);
  const std::vector<std::string> addresses = udp_addresses();
  EXPECT_GE(addresses.size(), 2u);
  for (const std::string& a : addresses) EXPECT_EQ(a, "0100007F");
}

TEST(DdsSockets, WhichProfilesAreOfLoopbackAlone) {
  EXPECT_TRUE(names_loopback_alone(read_dds_profile("loopback")));
  EXPECT_TRUE(names_loopback_alone(read_dds_profile("loopback_realtime")));
  EXPECT_TRUE(names_loopback_alone("<NetworkInterface address='127.0.0.1'/>"));
  EXPECT_FALSE(names_loopback_alone(""));
  EXPECT_FALSE(names_loopback_alone("<!-- <NetworkInterface name=\"lo\"/> -->"));
  EXPECT_FALSE(names_loopback_alone("<NetworkInterface name=\"eth0\"/>"));
  EXPECT_FALSE(names_loopback_alone("<NetworkInterface autodetermine=\"true\"/>"));
  EXPECT_FALSE(names_loopback_alone("<NetworkInterface name=\"lo\"/><NetworkInterface name=\"eth0\"/>"));
  EXPECT_FALSE(names_loopback_alone("<NetworkInterface name=\"lo0\"/>"));
}

// Discovery on every interface: nobody gets this by mistake.
TEST(DdsSockets, AProfileBeyondThisMachineNeedsKeysOrAWord) {
  std::string xml = read_dds_profile("loopback");
  const std::string lo = "<NetworkInterface name=\"lo\" multicast=\"false\"/>";
  xml.replace(xml.find(lo), lo.size(), "<NetworkInterface autodetermine=\"true\"/>");
  const Domain domain(static_cast<std::uint32_t>(getpid()) % 100 + 101, xml);
  EXPECT_FALSE(domain.loopback_alone());
  try {
    const Participant participant(domain);
    FAIL() << "it was made";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("--secure"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("--open-network"), std::string::npos) << error.what();
  }
}

class Pair {
 public:
  Pair() {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    bind(in_, reinterpret_cast<const sockaddr*>(&to), sizeof to);
    socklen_t size = sizeof to;
    getsockname(in_, reinterpret_cast<sockaddr*>(&to), &size);
    connect(out_, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }
  ~Pair() {
    close(in_);
    close(out_);
  }
  std::string passed(const std::string& text) {
    send(out_, text.data(), text.size(), 0);
    std::string buffer(1000, '\0');
    iovec part{buffer.data(), buffer.size()};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    buffer.resize(static_cast<std::size_t>(std::max<ssize_t>(0, recvmsg(in_, &message, 0))));
    return buffer;
  }

 private:
  int in_ = socket(AF_INET, SOCK_DGRAM, 0), out_ = socket(AF_INET, SOCK_DGRAM, 0);
};

TEST(DdsSockets, WhatIsNotSafeLosesItsContentAndIsCounted) {
  Pair pair;
  const std::string header = std::string("RTPS\2\1\1\20", 8) + "twelve bytes";
  const std::string cut = header + std::string("\x15\5\xff\0", 4);  // says that 255 bytes follow
  const std::uint64_t before = packets_refused();
  EXPECT_EQ(pair.passed("anything else"), "anything else");
  EXPECT_EQ(pair.passed(header), header);
  EXPECT_EQ(packets_refused(), before);
  EXPECT_EQ(pair.passed(cut), header);
  EXPECT_EQ(packets_refused(), before + 1);
}

}  // namespace
}  // namespace hapticd
