// A link between two network namespaces with delay, jitter, loss and reordering, where the kernel has no
// netem.
//
//   network_link NETNS_A NETNS_B --delay MS [--jitter MS] [--loss SHARE] [--seed N]
//
// It makes a TUN device `link0` in each namespace and carries packets between them: each is held for delay +
// a uniform part of ±jitter (what overtakes is reordered), or lost. It says `ready` when both are there; ends
// with SIGTERM, or when nobody reads its output. Needs root and /dev/net/tun. Times are CLOCK_MONOTONIC.
#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

struct Options {
  std::array<std::string, 2> namespaces;
  double delay_ms = 0, jitter_ms = 0, loss = 0;
  unsigned seed = 1;
};

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

std::int64_t now_ns() {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

// A TUN device in another network namespace; this process comes back to its own.
int device_in(const std::string& name) {
  const int own = open("/proc/self/ns/net", O_RDONLY | O_CLOEXEC);
  const int other = open(("/run/netns/" + name).c_str(), O_RDONLY | O_CLOEXEC);
  if (own < 0 || other < 0) fail("network namespace " + name);
  if (setns(other, CLONE_NEWNET) != 0) fail("entering " + name);
  const int device = open("/dev/net/tun", O_RDWR | O_CLOEXEC | O_NONBLOCK);
  if (device < 0) fail("/dev/net/tun");
  ifreq request{};
  request.ifr_flags = IFF_TUN | IFF_NO_PI;
  std::strcpy(request.ifr_name, "link0");
  if (ioctl(device, TUNSETIFF, &request) != 0) fail("a TUN device in " + name);
  if (setns(own, CLONE_NEWNET) != 0) fail("coming back");
  close(own);
  close(other);
  return device;
}

struct Packet {
  int to;
  std::vector<char> bytes;
};

void carry(const Options& o) {
  const std::array<int, 2> device{device_in(o.namespaces[0]), device_in(o.namespaces[1])};
  sched_param realtime{};
  realtime.sched_priority = 85;  // a cable does not wait for a processor
  sched_setscheduler(0, SCHED_FIFO, &realtime);
  std::puts("ready");
  std::fflush(stdout);
  std::mt19937_64 random(o.seed);
  std::uniform_real_distribution<double> share(0, 1), part(-1, 1);
  std::multimap<std::int64_t, Packet> under_way;
  std::array<char, 65536> buffer;
  for (;;) {
    std::array<pollfd, 2> waits{pollfd{device[0], POLLIN, 0}, pollfd{device[1], POLLIN, 0}};
    timespec left{1, 0};
    if (!under_way.empty()) {
      const std::int64_t ns = std::max<std::int64_t>(under_way.begin()->first - now_ns(), 0);
      left = {ns / 1'000'000'000, ns % 1'000'000'000};
    }
    ppoll(waits.data(), waits.size(), &left, nullptr);
    for (int from = 0; from < 2; ++from)
      for (ssize_t n; (n = read(device[static_cast<std::size_t>(from)], buffer.data(), buffer.size())) > 0;) {
        if (share(random) < o.loss) continue;
        const double held_ms = std::max(0.0, o.delay_ms + o.jitter_ms * part(random));
        under_way.emplace(
            now_ns() + static_cast<std::int64_t>(1e6 * held_ms),
            Packet{device[static_cast<std::size_t>(1 - from)], {buffer.data(), buffer.data() + n}});
      }
    while (!under_way.empty() && under_way.begin()->first <= now_ns()) {
      const Packet& packet = under_way.begin()->second;
      // A device that is down or full loses it, as a cable that is pulled does.
      if (write(packet.to, packet.bytes.data(), packet.bytes.size()) < 0) errno = 0;
      under_way.erase(under_way.begin());
    }
  }
}

Options read_options(int argc, char** argv) {
  Options o;
  if (argc < 3)
    throw std::runtime_error("usage: network_link NETNS_A NETNS_B --delay MS [--jitter MS] [--loss SHARE]");
  o.namespaces = {argv[1], argv[2]};
  for (int i = 3; i + 1 < argc; i += 2) {
    const std::string name = argv[i];
    const double value = std::atof(argv[i + 1]);
    if (name == "--delay")
      o.delay_ms = value;
    else if (name == "--jitter")
      o.jitter_ms = value;
    else if (name == "--loss")
      o.loss = value;
    else if (name == "--seed")
      o.seed = static_cast<unsigned>(value);
    else
      throw std::runtime_error("no such option: " + name);
  }
  return o;
}

}  // namespace

int main(int argc, char** argv) {
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  try {
    carry(read_options(argc, argv));
  } catch (const std::exception& e) {
    std::fprintf(stderr, "network_link: %s\n", e.what());
    return 1;
  }
}
