#include "server/dds/command.h"

#include <chrono>
#include <random>
#include <thread>

#include "server/dds/network.h"

namespace hapticd {
namespace {

constexpr int commands_kept = 16;
constexpr auto look_every = std::chrono::milliseconds(5);

}  // namespace

Qos command_qos() {
  Qos qos(dds_create_qos(), &dds_delete_qos);
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, commands_kept);
  at_station(*qos);
  return qos;
}

std::optional<AskedCommand> CommandPort::take() {
  commands_.take_each([this](const hapticd_msg_ServerCommand& m, const dds_sample_info_t&) {
    if (m.command <= static_cast<std::uint8_t>(ServerCommand::reload) && asked_.size() < commands_kept)
      asked_.push_back({m.asker, static_cast<ServerCommand>(m.command)});
  });
  if (asked_.empty()) return {};
  const AskedCommand oldest = asked_.front();
  asked_.erase(asked_.begin());
  return oldest;
}

void CommandPort::reply(std::uint64_t asker, bool done, const std::string& message) {
  hapticd_msg_ServerReply m{};
  m.asker = asker;
  m.done = done;
  m.message = const_cast<char*>(message.c_str());
  replies_.write(m);
}

CommandReply ask_server(const Participant& participant, ServerCommand command, double seconds) {
  using Clock = std::chrono::steady_clock;
  Writer<hapticd_msg_ServerCommand> commands(participant);
  Reader<hapticd_msg_ServerReply> replies(participant);
  std::random_device random;
  hapticd_msg_ServerCommand m{};
  m.asker = std::uniform_int_distribution<std::uint64_t>(1)(random);
  m.command = static_cast<std::uint8_t>(command);
  CommandReply reply;
  bool asked = false;
  const auto until = Clock::now() + std::chrono::duration<double>(seconds);
  while (!reply.heard && Clock::now() < until) {
    // The reply's writer too: it is volatile.
    if (!asked && commands.matched() > 0 && replies.matched() > 0)
      asked = commands.write(m) == DDS_RETCODE_OK;
    replies.take_each([&](const hapticd_msg_ServerReply& r, const dds_sample_info_t&) {
      if (r.asker == m.asker) reply = {true, r.done, r.message ? r.message : ""};
    });
    std::this_thread::sleep_for(look_every);
  }
  return reply;
}

}  // namespace hapticd
