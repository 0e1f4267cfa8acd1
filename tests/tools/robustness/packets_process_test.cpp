// The daemon under RTPS messages that no Cyclone would send: those that were found to abort it, and
// mutations.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <sstream>
#include <thread>

#include "server/dds/dds.h"
#include "tests/support/process.h"
#include "tests/tools/run_command.h"
#include "tools/robustness/packet_attack.h"

namespace hapticd {
namespace {

const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";

long from_environment(const char* name, long otherwise) {
  const char* value = std::getenv(name);
  return value ? std::atol(value) : otherwise;
}

class PacketsDaemon : public testing::Test {
 protected:
  void start(const std::vector<std::string>& options = {}) {
    std::vector<std::string> command{BIN_DIR "/hapticd",      cube,    "--domain",
                                     std::to_string(domain_), "--log", "json"};
    command.insert(command.end(), options.begin(), options.end());
    daemon_ = std::make_unique<ChildProcess>(command, log_);
    for (int i = 0; i < 400 && said().find("\"ready\"") == std::string::npos; ++i) usleep(50'000);
    ASSERT_NE(said().find("\"ready\""), std::string::npos) << said();
  }
  std::string said() const {
    std::stringstream text;
    text << std::ifstream(log_).rdbuf();
    return text.str();
  }
  std::string end_of_log() const {
    const std::string text = said();
    return text.substr(text.size() - std::min<std::size_t>(text.size(), 2000));
  }
  void ends_well() {
    daemon_->signal(SIGTERM);
    EXPECT_EQ(daemon_->wait(20'000), 0) << end_of_log();
  }
  void survives_mutations() {
    const long packets = from_environment("HAPTICD_PACKETS", 4'000),
               seeds = from_environment("HAPTICD_PACKET_SEEDS", 1);
    for (long seed = 1; seed <= seeds; ++seed) {
      const PacketCount count = attack_with_packets(
          {.domain = domain_, .seed = static_cast<std::uint64_t>(seed), .packets = packets});
      EXPECT_EQ(count.sent, packets);
      EXPECT_EQ(count.participants, 1);
      ASSERT_EQ(kill(daemon_->pid(), 0), 0);
      ASSERT_EQ(daemon_->wait(100), 1000) << "seed " << seed << " ended it: " << end_of_log();
    }
    ends_well();
  }

  const std::uint32_t domain_ = static_cast<std::uint32_t>(40 + getpid() % 60);
  ScratchDirectory scratch_;
  const std::string log_ = scratch_.file("daemon.log");
  std::unique_ptr<ChildProcess> daemon_;
};

// Each is sent to the discovery port of whoever may be there.
class Sender {
 public:
  explicit Sender(std::uint32_t domain) : first_port_(7410 + 250 * static_cast<int>(domain)) {}
  ~Sender() { close(socket_); }
  void send(const Packet& p) const {
    for (int participant = 0; participant < 33; ++participant) {
      sockaddr_in to{};
      to.sin_family = AF_INET;
      to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
      to.sin_port = htons(static_cast<std::uint16_t>(first_port_ + 2 * participant));
      sendto(socket_, p.data(), p.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
    }
  }

 private:
  const int first_port_, socket_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
};

// An announcement, a heartbeat, a subscription whose type is of a kind that there is not.
TEST_F(PacketsDaemon, ThreePacketsThatAbortCycloneDoNothing) {
  start();
  Packet announcement = read_packets(SOURCE_DIR "/tests/hostile/announce.hex").front();
  const Packet subscription = read_packets(SOURCE_DIR "/tests/hostile/subscribe.hex").front();
  const Packet domain_parameter{0x0f, 0x00, 0x04, 0x00};
  const auto at =
      std::search(announcement.begin(), announcement.end(), domain_parameter.begin(), domain_parameter.end());
  ASSERT_NE(at, announcement.end());
  *(at + 4) = static_cast<std::uint8_t>(domain_);
  // HEARTBEAT of the writer of subscriptions: sample 1 is to be had.
  Packet heartbeat(announcement.begin(), announcement.begin() + 20);
  const Packet says_one{0x07, 0x01, 0x1c, 0x00, 0x00, 0x00, 0x04, 0xc7, 0x00, 0x00, 0x04, 0xc2, 0, 0, 0, 0,
                        1,    0,    0,    0,    0,    0,    0,    0,    1,    0,    0,    0,    1, 0, 0, 0};
  heartbeat.insert(heartbeat.end(), says_one.begin(), says_one.end());
  const Sender sender(domain_);
  sender.send(announcement);
  usleep(300'000);
  sender.send(heartbeat);
  sender.send(subscription);
  EXPECT_EQ(daemon_->wait(1000), 1000) << end_of_log();
  ends_well();
}

// HAPTICD_PACKETS=60000 HAPTICD_PACKET_SEEDS=6: the long form.
TEST_F(PacketsDaemon, SurvivesMutatedPackets) {
  start();
  survives_mutations();
}

TEST_F(PacketsDaemon, SurvivesMutatedPacketsWithKeys) {
  if (std::string(DDS_PLUGINS).empty()) GTEST_SKIP() << "no DDS Security plugins here";
  const std::string keys = scratch_.file("keys");
  const CommandResult made = run_command(SOURCE_DIR "/config/dds/security/make_keys.sh " + keys + " 30");
  ASSERT_EQ(made.code, 0) << made.output;
  start({"--secure", keys});
  survives_mutations();
}

// Whoever should read the log does not: the device goes on, and the end comes in time.
TEST_F(PacketsDaemon, AFullPipeForALogHoldsNobody) {
  const std::string fifo = scratch_.file("log.fifo");
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);
  const int pipe = open(fifo.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  ASSERT_GE(pipe, 0);
  daemon_ = std::make_unique<ChildProcess>(std::vector<std::string>{BIN_DIR "/hapticd", cube, "--domain",
                                                                    std::to_string(domain_), "--log", "json"},
                                           fifo);
  std::string text;
  for (int i = 0; i < 400 && text.find("\"ready\"") == std::string::npos; ++i) {
    char part[4096];
    if (const ssize_t n = read(pipe, part, sizeof part); n > 0)
      text.append(part, static_cast<std::size_t>(n));
    usleep(50'000);
  }
  ASSERT_NE(text.find("\"ready\""), std::string::npos) << text;
  while (write(pipe, "full", 4) == 4) continue;

  // HEARTBEAT of samples 1 to -1: Cyclone says so each time.
  const Packet malformed{'R', 'T', 'P', 'S', 2,   1,   1,   16,  1,   2,    3,   4,   5, 6,    7, 8, 9, 10,
                         11,  12,  7,   1,   28,  0,   0,   3,   1,   0xc4, 0,   3,   1, 0xc3, 0, 0, 0, 0,
                         1,   0,   0,   0,   255, 255, 255, 255, 255, 255,  255, 255, 1, 0,    0, 0};
  std::atomic<bool> flooding{true};
  std::thread flood([&] {
    for (const Sender sender(domain_); flooding; usleep(500)) sender.send(malformed);
  });
  const CommandResult client =
      run_haptic("replay " SOURCE_DIR "/config/scenes/cube/press.csv --domain " + std::to_string(domain_) +
                 " --min-answered " + std::to_string(0.9 * answered_share()));
  EXPECT_EQ(client.code, 0) << client.output.substr(client.output.size() -
                                                    std::min<std::size_t>(client.output.size(), 1500));
  flooding = false;
  flood.join();
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(5'000), 0);
  close(pipe);
}

// Every line is the daemon's own, and few of them are Cyclone's.
TEST_F(PacketsDaemon, MalformedPacketsAreAFewLinesOfJson) {
  start();
  attack_with_packets({.domain = domain_, .packets = 3'000, .rate = 3'000});
  ends_well();
  std::istringstream lines(said());
  int of_dds = 0;
  for (std::string line; std::getline(lines, line);) {
    EXPECT_EQ(line.substr(0, 9), "{\"time\":\"") << line;
    of_dds += line.find("\"event\":\"dds\"") != std::string::npos;
  }
  EXPECT_GE(of_dds, 1);
  EXPECT_LE(of_dds, 33);
}

TEST_F(PacketsDaemon, NothingArrivesFromAnotherNetwork) {
  const CommandResult result =
      run_command(SOURCE_DIR "/tests/hostile/other_network " BIN_DIR "/hapticd " + cube);
  if (result.code == 77) GTEST_SKIP() << result.output;
  EXPECT_EQ(result.code, 0) << result.output;
}

}  // namespace
}  // namespace hapticd
