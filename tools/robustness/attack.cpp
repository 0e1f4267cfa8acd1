#include "tools/robustness/attack.h"

#include <unistd.h>

#include <functional>
#include <limits>
#include <map>
#include <stdexcept>

#include "haptic/clock.h"
#include "server/dds/dds.h"
#include "tools/robustness/packet_attack.h"

namespace hapticd {
namespace {

using State = hapticd_msg_DeviceState;

constexpr double touching_z = 0.0215;  // in the cube scene
constexpr int crowd_size = 200, crowd_at_a_time = 20;

State valid(std::uint32_t device) {
  State s{};
  s.device_id = device;
  s.orientation[3] = 1;
  s.position[2] = touching_z;
  s.enable = true;
  return s;
}

// Calls f(i) at `rate` until the time is over.
void pace(double rate, double seconds, const std::function<void(long)>& f) {
  const std::int64_t begun = monotonic_ns();
  for (long i = 0; monotonic_ns() - begun < static_cast<std::int64_t>(1e9 * seconds); ++i) {
    f(i);
    const auto next = begun + static_cast<std::int64_t>(1e9 * static_cast<double>(i + 1) / rate);
    if (const std::int64_t left = next - monotonic_ns(); left > 0)
      usleep(static_cast<useconds_t>(left / 1000));
  }
}

void lies(const Domain& domain, const AttackTarget& target, double seconds) {
  const Participant participant(domain);
  Writer<State> writer(participant);
  State s = valid(target.own);
  pace(1000, seconds, [&](long i) {
    ++s.number;
    s.enable = i % 200 >= 20;  // arms again after each latch
    State sent = s;
    if (i % 200 >= 150) {
      const double nan = std::numeric_limits<double>::quiet_NaN(),
                   inf = std::numeric_limits<double>::infinity();
      if (i % 3 == 0) sent.position[i % 2] = nan;
      if (i % 3 == 1) sent.position[2] = i % 2 ? inf : -inf;
      if (i % 3 == 2) sent.orientation[3] = 0;
    }
    writer.write(sent);
  });
}

void backwards(const Domain& domain, const AttackTarget& target, double seconds) {
  const Participant participant(domain);
  Writer<State> writer(participant);
  State s = valid(target.own);
  pace(1000, seconds, [&](long i) {
    s.number = static_cast<std::uint64_t>(i % 100 < 50 ? 1'000'000 + i : 1'000'000 - i);
    s.enable = i % 100 >= 10;
    writer.write(s);
  });
}

void flood(const Domain& domain, const AttackTarget& target, double seconds) {
  const Participant participant(domain);
  Writer<State> writer(participant);
  State own = valid(target.own), other = valid(target.behaving);
  pace(10'000, seconds, [&](long) {
    ++own.number;
    ++other.number;
    writer.write(own);
    writer.write(other);
  });
}

void crowd(const Domain& domain, const AttackTarget& target, double seconds) {
  struct Member {
    Participant participant;
    Writer<State> writer;
    explicit Member(const Domain& d) : participant(d), writer(participant) {}
  };
  constexpr int rounds = crowd_size / crowd_at_a_time;
  for (int round = 0; round < rounds; ++round) {
    std::vector<std::unique_ptr<Member>> members;
    for (int i = 0; i < crowd_at_a_time; ++i) members.push_back(std::make_unique<Member>(domain));
    State s = valid(target.behaving);
    pace(200, seconds / rounds, [&](long) {
      ++s.number;
      for (const auto& member : members) member->writer.write(s);
    });
  }
}

void doubles(const Domain& domain, const AttackTarget& target, double seconds) {
  const Participant participant(domain);
  Writer<State> writer(participant);
  State s = valid(target.behaving);
  s.number = 1'000'000'000'000;
  pace(1000, seconds, [&](long i) {
    ++s.number;
    s.position[0] = i % 2 ? 0.05 : -0.05;
    s.enable = i % 10 != 0;
    writer.write(s);
  });
}

void types(const Domain& domain, const AttackTarget&, double seconds) {
  // The very name, another content; without type information there is nothing by which the reader could
  // refuse.
  const dds_topic_descriptor_t& other = hapticd_msg_ForceCommand_desc;
  const dds_topic_descriptor_t disguised{
      .m_size = other.m_size,
      .m_align = other.m_align,
      .m_flagset = other.m_flagset & ~std::uint32_t{DDS_TOPIC_XTYPES_METADATA},
      .m_nkeys = other.m_nkeys,
      .m_typename = hapticd_msg_DeviceState_desc.m_typename,
      .m_keys = other.m_keys,
      .m_nops = other.m_nops,
      .m_ops = other.m_ops,
      .m_meta = other.m_meta,
      .type_information = {nullptr, 0},
      .type_mapping = {nullptr, 0},
      .restrict_data_representation = other.restrict_data_representation};
  struct Liar {
    Participant participant;
    DdsEntity topic, writer;
    Liar(const Domain& d, const dds_topic_descriptor_t& type)
        : participant(d),
          topic(require(
              dds_create_topic(participant.handle(), &type, TopicTraits<State>::name, nullptr, nullptr),
              "a topic of another type")),
          writer(
              require(dds_create_writer(participant.handle(), topic.handle(), realtime_qos(1).get(), nullptr),
                      "a writer of another type")) {}
  };
  const Liar named(domain, hapticd_msg_ForceCommand_desc), masked(domain, disguised);
  hapticd_msg_ForceCommand m{};
  m.force[0] = m.torque[0] = std::numeric_limits<double>::quiet_NaN();
  pace(1000, seconds, [&](long) {
    ++m.number;
    dds_write(named.writer.handle(), &m);
    dds_write(masked.writer.handle(), &m);
  });
}

void dying(const Domain& domain, const AttackTarget& target, double seconds) {
  const Participant participant(domain);
  Writer<State> writer(participant);
  State s = valid(target.own);
  s.number = static_cast<std::uint64_t>(monotonic_ns());
  pace(1000, seconds, [&](long) {
    ++s.number;
    writer.write(s);
  });
  _exit(0);  // nothing disposed of, nobody told
}

// RTPS by hand, to every participant there is.
void packets(const Domain& domain, const AttackTarget&, double seconds) {
  PacketAttack options;
  options.domain = domain.id();
  options.seconds = seconds;
  options.packets = std::numeric_limits<long>::max();
  options.rate = 1000;      // `flood` is another attack
  options.samples = false;  // as are `doubles` and `lies`
  attack_with_packets(options);
}

const std::map<std::string, void (*)(const Domain&, const AttackTarget&, double)>& table() {
  static const std::map<std::string, void (*)(const Domain&, const AttackTarget&, double)> attacks{
      {"lies", lies},       {"backwards", backwards}, {"flood", flood}, {"crowd", crowd},
      {"doubles", doubles}, {"types", types},         {"dying", dying}, {"packets", packets}};
  return attacks;
}

}  // namespace

const std::vector<std::string>& attacks() {
  static const std::vector<std::string> names{"lies",    "backwards", "flood", "crowd",
                                              "doubles", "types",     "dying", "packets"};
  return names;
}

void attack(const std::string& name, double seconds, const AttackTarget& target) {
  const auto found = table().find(name);
  if (found == table().end()) throw std::invalid_argument("no such attack: " + name);
  const Domain own(target.domain, read_dds_profile("loopback"));
  found->second(own, target, seconds);
}

}  // namespace hapticd
