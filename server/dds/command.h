// What a person asks of a running daemon over DDS, from both sides: the scene again from its start, or its
// file read again.
//
//   haptic/server/command, /reply      reliable, volatile: a daemon that starts later is asked nothing
//
// With security only the role `operator` may ask. Thread safety: one thread. Errors: constructors throw
// std::runtime_error with Cyclone's reason.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "idl/command.h"  // generated from idl/command.idl
#include "server/dds/dds.h"

namespace hapticd {

enum class ServerCommand : std::uint8_t { reset, reload };

Qos command_qos();
template <>
struct TopicTraits<hapticd_msg_ServerCommand> {
  static constexpr const char* name = "haptic/server/command";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_ServerCommand_desc; }
  static Qos reader_qos() { return command_qos(); }
  static Qos writer_qos() { return command_qos(); }
};
template <>
struct TopicTraits<hapticd_msg_ServerReply> {
  static constexpr const char* name = "haptic/server/reply";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_ServerReply_desc; }
  static Qos reader_qos() { return command_qos(); }
  static Qos writer_qos() { return command_qos(); }
};

struct AskedCommand {
  std::uint64_t asker = 0;
  ServerCommand command = ServerCommand::reset;
};

// The daemon's side.
class CommandPort {
 public:
  explicit CommandPort(const Participant& participant) : commands_(participant), replies_(participant) {}

  std::optional<AskedCommand> take();  // the oldest; what is none of the two is left out
  void reply(std::uint64_t asker, bool done, const std::string& message);

 private:
  Reader<hapticd_msg_ServerCommand> commands_;
  Writer<hapticd_msg_ServerReply> replies_;
  std::vector<AskedCommand> asked_;
};

struct CommandReply {
  bool heard = false;  // false: nobody answered in time
  bool done = false;
  std::string message;
};

// A client's side. Waits for a daemon and its answer, `seconds` at most for both.
CommandReply ask_server(const Participant& participant, ServerCommand command, double seconds);

}  // namespace hapticd
