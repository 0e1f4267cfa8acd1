#include "tools/robustness/packet_attack.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <string>

#include "haptic/clock.h"
#include "server/files/paths.h"

namespace hapticd {
namespace {

constexpr std::size_t header_size = 20;  // of a message: "RTPS", version, vendor, GUID prefix
constexpr int participants_at_most = 33, per_stranger = 40;
enum : std::uint8_t { acknack = 0x06, heartbeat = 0x07, info_destination = 0x0e, data = 0x15 };
enum : std::uint16_t { pid_user_locator = 0x31, pid_discovery_locator = 0x32, pid_domain_id = 0x0f };

std::uint32_t word(const Packet& p, std::size_t at) {
  std::uint32_t w = 0;
  std::memcpy(&w, p.data() + at, sizeof w);
  return w;
}
void set_word(Packet& p, std::size_t at, std::uint32_t w) { std::memcpy(p.data() + at, &w, sizeof w); }
std::uint16_t half(const Packet& p, std::size_t at) {
  return static_cast<std::uint16_t>(p[at] | p[at + 1] << 8);
}

// Calls f(kind, offset, size with its header) for each submessage; captured ones are little-endian.
template <typename F>
void each_submessage(const Packet& p, F&& f) {
  for (std::size_t at = header_size; at + 4 <= p.size();) {
    const std::size_t length = half(p, at + 2);
    const std::size_t size = length == 0 ? p.size() - at : std::min(4 + length, p.size() - at);
    f(p[at], at, size);
    at += size;
  }
}

GuidPrefix prefix_of(const Packet& p) {
  GuidPrefix prefix{};
  std::copy_n(p.begin() + 8, prefix.size(), prefix.begin());
  return prefix;
}

void replace(Packet& p, const GuidPrefix& from, const GuidPrefix& to) {
  for (auto at = p.begin(); (at = std::search(at, p.end(), from.begin(), from.end())) != p.end();)
    at = std::copy(to.begin(), to.end(), at);
}

// Where a parameter of this id begins in the message, by its looks: aligned, of this length.
std::size_t parameter(const Packet& p, std::uint16_t id, std::uint16_t length) {
  for (std::size_t at = header_size; at + 4 + length <= p.size(); at += 4)
    if (half(p, at) == id && half(p, at + 2) == length) return at + 4;
  return 0;
}

struct Victim {
  GuidPrefix prefix{};
  std::array<std::uint16_t, 2> ports{};  // discovery, data
};

class Stranger {
 public:
  explicit Stranger(const PacketAttack& options)
      : options_(options),
        captured_(wanted(read_packets(config_file("dds/packets.hex")), options.samples)),
        random_(options.seed) {
    for (const Packet& p : captured_)
      if (std::find(speakers_.begin(), speakers_.end(), prefix_of(p)) == speakers_.end())
        speakers_.push_back(prefix_of(p));
    socket_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in own = loopback(0);
    socklen_t size = sizeof own;
    if (socket_ < 0 || bind(socket_, reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0 ||
        getsockname(socket_, reinterpret_cast<sockaddr*>(&own), &size) != 0)
      throw std::runtime_error("no UDP socket on loopback");
    own_port_ = ntohs(own.sin_port);
  }
  ~Stranger() { close(socket_); }
  Stranger(const Stranger&) = delete;
  Stranger& operator=(const Stranger&) = delete;

  PacketCount run() {
    const std::int64_t begun = monotonic_ns(),
                       end = begun + static_cast<std::int64_t>(1e9 * options_.seconds);
    find_victims();
    PacketCount count{0, static_cast<int>(victims_.size())};
    if (victims_.empty()) return count;
    const std::int64_t sending = monotonic_ns();
    for (; count.sent < options_.packets && monotonic_ns() < end; ++count.sent) {
      if (count.sent % per_stranger == 0) become_another();
      send_one();
      const auto next =
          sending + static_cast<std::int64_t>(1e9 * static_cast<double>(count.sent) / options_.rate);
      if (const std::int64_t left = next - monotonic_ns(); left > 1'000'000)
        usleep(static_cast<useconds_t>(left / 1000));
    }
    return count;
  }

 private:
  static std::vector<Packet> wanted(std::vector<Packet> packets, bool samples) {
    if (!samples)
      std::erase_if(packets, [](const Packet& p) {
        bool has_sample = false;
        each_submessage(p, [&](std::uint8_t kind, std::size_t at, std::size_t size) {
          // The two highest bits of a writer's kind: built in.
          has_sample = has_sample || (kind == data && size >= 16 && (p[at + 15] & 0xc0) == 0);
        });
        return has_sample;
      });
    return packets;
  }
  static sockaddr_in loopback(std::uint16_t port) {
    sockaddr_in a{};
    a.sin_family = AF_INET;
    a.sin_port = htons(port);
    a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return a;
  }
  std::uint64_t below(std::uint64_t n) { return random_() % n; }
  std::uint16_t discovery_port(int participant) const {
    const int first =
        options_.first_port ? options_.first_port : 7410 + 250 * static_cast<int>(options_.domain);
    return static_cast<std::uint16_t>(first + 2 * participant);
  }
  void send(const Packet& p, std::uint16_t port) {
    const sockaddr_in to = loopback(port);
    sendto(socket_, p.data(), p.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }
  bool announces(const Packet& p) const { return parameter(p, pid_discovery_locator, 24) != 0; }

  // Announces itself on every port of the domain; who answers with an announcement is a victim.
  void find_victims() {
    for (int round = 0; round < 80 && (victims_.empty() || round < 3); ++round) {
      become_another();
      for (Packet p : captured_)
        if (announces(p)) {
          address(p, {});
          for (int i = 0; i < participants_at_most; ++i) send(p, discovery_port(i));
        }
      pollfd wait{socket_, POLLIN, 0};
      // Who is there does not fall silent: a round has its time.
      for (const std::int64_t until = monotonic_ns() + 50'000'000;
           monotonic_ns() < until && poll(&wait, 1, 20) >= 0;) {
        Packet p(65536);
        const ssize_t n = recv(socket_, p.data(), p.size(), MSG_DONTWAIT);
        if (n < static_cast<ssize_t>(header_size)) continue;
        p.resize(static_cast<std::size_t>(n));
        add_victim(p);
      }
    }
  }
  void add_victim(const Packet& p) {
    const std::size_t discovery = parameter(p, pid_discovery_locator, 24),
                      user = parameter(p, pid_user_locator, 24);
    const GuidPrefix prefix = prefix_of(p);
    const auto same = [&](const Victim& v) { return v.prefix == prefix; };
    if (!discovery || !user || std::any_of(victims_.begin(), victims_.end(), same)) return;
    victims_.push_back({prefix,
                        {static_cast<std::uint16_t>(word(p, discovery + 4)),
                         static_cast<std::uint16_t>(word(p, user + 4))}});
  }

  // The next stranger: another GUID, which whoever spoke in the capture now has.
  void become_another() {
    for (std::uint8_t& byte : own_) byte = static_cast<std::uint8_t>(below(256));
    own_[0] = 0x01;
    own_[1] = 0x10;
    sequence_.clear();
    if (victims_.empty()) return;
    for (const Victim& v : victims_)
      for (Packet p : captured_)
        if (announces(p)) {
          address(p, v.prefix);
          if (options_.mutated && below(4) == 0) mutate(p, random_);
          send(p, v.ports[0]);
        }
    for (const Victim& v : victims_)
      for (Packet p : captured_) {
        bool says = false;
        each_submessage(
            p, [&](std::uint8_t kind, std::size_t, std::size_t) { says = says || kind == heartbeat; });
        if (!says) continue;
        address(p, v.prefix);
        promise(p);
        send(p, v.ports[0]);
      }
  }
  // Source, destination and locators as this attack needs them.
  void address(Packet& p, const GuidPrefix& to) {
    const GuidPrefix speaker = prefix_of(p);
    for (const GuidPrefix& other : speakers_)
      if (other != speaker) replace(p, other, to);
    replace(p, speaker, own_);
    each_submessage(p, [&](std::uint8_t kind, std::size_t at, std::size_t size) {
      if (kind == info_destination && size >= 16)
        std::copy(to.begin(), to.end(), p.begin() + static_cast<long>(at) + 4);
    });
    for (const std::uint16_t id : {pid_user_locator, pid_discovery_locator})
      if (const std::size_t at = parameter(p, id, 24)) set_word(p, at + 4, own_port_);
    if (const std::size_t at = parameter(p, pid_domain_id, 4)) set_word(p, at, options_.domain);
  }
  // Heartbeats: samples 1 to very many, to be had.
  static void promise(Packet& p) {
    each_submessage(p, [&](std::uint8_t kind, std::size_t at, std::size_t size) {
      if (kind != heartbeat || size < 32) return;
      const std::uint32_t numbers[] = {0, 1, 0, 1'000'000};
      for (std::size_t i = 0; i < 4; ++i) set_word(p, at + 12 + 4 * i, numbers[i]);
    });
  }
  // The number that the receiver waits for, per writer.
  void number(Packet& p) {
    each_submessage(p, [&](std::uint8_t kind, std::size_t at, std::size_t size) {
      if (kind != data || size < 24) return;
      const std::uint32_t writer = word(p, at + 12);
      const auto known =
          std::find_if(sequence_.begin(), sequence_.end(), [&](const auto& s) { return s.first == writer; });
      std::uint32_t& next =
          known != sequence_.end() ? known->second : sequence_.emplace_back(writer, 0u).second;
      set_word(p, at + 16, 0);
      set_word(p, at + 20, ++next);
    });
  }
  void send_one() {
    const Victim& v = victims_[below(victims_.size())];
    Packet p = captured_[below(captured_.size())];
    address(p, v.prefix);
    if (below(8) != 0) number(p);
    if (below(16) == 0) promise(p);
    if (options_.mutated && below(16) != 0) mutate(p, random_);
    const bool to_discovery = below(8) != 0;
    send(p, v.ports[to_discovery ? 0 : 1]);
  }

  const PacketAttack options_;
  const std::vector<Packet> captured_;
  std::mt19937_64 random_;
  std::vector<GuidPrefix> speakers_;
  int socket_ = -1;
  std::uint16_t own_port_ = 0;
  GuidPrefix own_{};
  std::vector<std::pair<std::uint32_t, std::uint32_t>> sequence_;
  std::vector<Victim> victims_;
};

}  // namespace

std::vector<Packet> read_packets(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error("cannot read " + file.string());
  std::vector<Packet> packets;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    Packet p;
    for (std::size_t i = 0; i + 1 < line.size(); i += 2)
      p.push_back(static_cast<std::uint8_t>(std::stoi(line.substr(i, 2), nullptr, 16)));
    if (p.size() > header_size) packets.push_back(p);
  }
  if (packets.empty()) throw std::runtime_error("no messages in " + file.string());
  return packets;
}

void mutate(Packet& p, std::mt19937_64& random) {
  const auto below = [&](std::uint64_t n) { return static_cast<std::size_t>(random() % n); };
  constexpr std::array<std::uint32_t, 14> words{0,          1,          2,          3,          4,
                                                0xff,       0xffff,     0x7fff,     0x7fffffff, 0x80000000,
                                                0xffffffff, 0xfffffffe, 0x7fffff00, 0x01000000};
  constexpr std::array<std::uint16_t, 20> parameters{0x00, 0x01, 0x05, 0x07, 0x0f, 0x15, 0x1a,
                                                     0x1d, 0x2c, 0x31, 0x32, 0x50, 0x58, 0x59,
                                                     0x5a, 0x70, 0x71, 0x73, 0x75, 0x77};
  for (std::size_t n = 1 + below(1 + below(8)); n > 0 && p.size() > header_size + 4; --n) {
    const std::size_t at = header_size + below(p.size() - header_size),
                      aligned = header_size + 4 * below((p.size() - header_size) / 4);
    switch (below(10)) {
      case 0:
        p[at] ^= static_cast<std::uint8_t>(1u << below(8));
        break;
      case 1:
        p[at] = static_cast<std::uint8_t>(below(256));
        break;
      case 2:
      case 3:
        set_word(p, aligned, words[below(words.size())]);
        break;
      case 4:
        set_word(p, aligned, static_cast<std::uint32_t>(random()));
        break;
      case 5: {  // a length, or the low half of a word
        const std::size_t length = aligned + 2;
        const std::uint16_t value = static_cast<std::uint16_t>(half(p, length) + 4 * below(9) - 16);
        p[length] = static_cast<std::uint8_t>(value);
        p[length + 1] = static_cast<std::uint8_t>(value >> 8);
        break;
      }
      case 6: {
        const std::uint16_t id = parameters[below(parameters.size())];
        p[aligned] = static_cast<std::uint8_t>(id);
        p[aligned + 1] = static_cast<std::uint8_t>(id >> 8);
        break;
      }
      case 7:
        p.resize(below(4) ? aligned : at);
        break;
      case 8: {  // a piece of it, over another place
        const std::size_t from = header_size + 4 * below((p.size() - header_size) / 4),
                          length = std::min({4 * (1 + below(16)), p.size() - from, p.size() - aligned});
        const Packet piece(p.begin() + static_cast<long>(from), p.begin() + static_cast<long>(from + length));
        std::copy(piece.begin(), piece.end(), p.begin() + static_cast<long>(aligned));
        break;
      }
      default: {  // a piece of it, twice
        const std::size_t length = std::min(4 * (1 + below(16)), p.size() - aligned);
        const Packet piece(p.begin() + static_cast<long>(aligned),
                           p.begin() + static_cast<long>(aligned + length));
        if (p.size() + length < 8000)
          p.insert(p.begin() + static_cast<long>(aligned), piece.begin(), piece.end());
      }
    }
  }
}

PacketCount attack_with_packets(const PacketAttack& options) { return Stranger(options).run(); }

}  // namespace hapticd
