#include "server/app/notify.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

// A service manager's end.
class Manager {
 public:
  // name: begins with @ for the abstract space.
  explicit Manager(const std::string& name)
      : socket_(socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)), name_(name) {
    sockaddr_un a{};
    a.sun_family = AF_UNIX;
    std::memcpy(a.sun_path, name.data(), name.size());
    if (name[0] == '@') a.sun_path[0] = '\0';
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    if (bind(socket_, reinterpret_cast<sockaddr*>(&a), size) != 0) ADD_FAILURE() << name;
    setenv("NOTIFY_SOCKET", name.c_str(), 1);
  }
  ~Manager() {
    close(socket_);
    if (name_[0] == '/') unlink(name_.c_str());
    for (const char* v : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) unsetenv(v);
  }
  std::string heard() const {
    char text[256];
    const ssize_t n = recv(socket_, text, sizeof text, 0);
    return n > 0 ? std::string(text, static_cast<std::size_t>(n)) : "";
  }

 private:
  int socket_;
  std::string name_;
};

TEST(Notify, SaysWhatAManagerExpectsByPathAndByAbstractName) {
  for (const std::string& name :
       {"/tmp/hapticd-notify-" + std::to_string(getpid()), "@hapticd-" + std::to_string(getpid())}) {
    const Manager manager(name);
    const Notifier notifier;
    notifier.ready("ready, domain 0");
    EXPECT_EQ(manager.heard(), "READY=1\nSTATUS=ready, domain 0");
    notifier.reloading(5'000'000);
    EXPECT_EQ(manager.heard(), "RELOADING=1\nMONOTONIC_USEC=5000");
    notifier.ping();
    EXPECT_EQ(manager.heard(), "WATCHDOG=1");
    notifier.stopping();
    EXPECT_EQ(manager.heard(), "STOPPING=1");
    EXPECT_EQ(std::getenv("NOTIFY_SOCKET"), nullptr) << "not for children";
  }
}

TEST(Notify, TheWatchdogIsForTheProcessThatItNames) {
  const Manager manager("@hapticd-pid-" + std::to_string(getpid()));
  setenv("WATCHDOG_USEC", "2000000", 1);
  setenv("WATCHDOG_PID", std::to_string(getpid()).c_str(), 1);
  EXPECT_EQ(Notifier().watchdog_ns(), 2000 * ms);
  setenv("NOTIFY_SOCKET", "@x", 1);
  setenv("WATCHDOG_USEC", "2000000", 1);
  setenv("WATCHDOG_PID", "1", 1);
  EXPECT_EQ(Notifier().watchdog_ns(), 0);
}

TEST(Notify, WithoutAManagerNothingHappens) {
  const Notifier notifier;
  notifier.ready("");
  notifier.ping();
  EXPECT_EQ(notifier.watchdog_ns(), 0);
}

TEST(Notify, AnAddressThatIsTooLongIsNone) {
  setenv("NOTIFY_SOCKET", ("/" + std::string(200, 'x')).c_str(), 1);
  const Notifier notifier;
  notifier.ping();
}

// Of a watchdog of 100 ms: due after 50, and only if every count changed since the last.
TEST(WatchdogPings, AreDueOnlyWhileEveryLoopAdvances) {
  WatchdogPings pings(100 * ms);
  EXPECT_FALSE(pings.due(0, {1, 1}));
  EXPECT_FALSE(pings.due(40 * ms, {40, 3})) << "too soon";
  EXPECT_TRUE(pings.due(50 * ms, {50, 3}));
  EXPECT_FALSE(pings.due(100 * ms, {100, 3})) << "the second loop stands";
  EXPECT_FALSE(pings.due(500 * ms, {500, 3}));
  EXPECT_TRUE(pings.due(520 * ms, {520, 4})) << "it goes on";
  EXPECT_FALSE(pings.due(600 * ms, {520, 8})) << "the first loop stands";
  EXPECT_TRUE(pings.due(610 * ms, {530, 8}));
}

TEST(WatchdogPings, WithoutAWatchdogAreNeverDue) {
  WatchdogPings pings(0);
  EXPECT_FALSE(pings.due(0, {0}));
  EXPECT_FALSE(pings.due(1'000'000 * ms, {1}));
}

}  // namespace
}  // namespace hapticd
