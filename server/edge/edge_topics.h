// The topics of a daemon whose halves are two processes (idl/edge.idl).
//
//   haptic/edge/problem         reliable, volatile, writer keep last 1: sent again until it is outdated
//   haptic/edge/hands, /clock   best effort, volatile, writer keep last 1
//
// Readers keep the last 8, so that one writer cannot hide what another wrote.
#pragma once

#include "idl/edge.h"  // generated from idl/edge.idl
#include "server/dds/dds.h"

namespace hapticd {

inline constexpr std::uint16_t edge_version = 3;  // of the types in idl/edge.idl

Qos edge_problem_qos(int depth);

template <>
struct TopicTraits<hapticd_msg_EdgeProblem> {
  static constexpr const char* name = "haptic/edge/problem";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_EdgeProblem_desc; }
  static Qos reader_qos() { return edge_problem_qos(state_reader_depth); }
  static Qos writer_qos() { return edge_problem_qos(1); }
};
template <>
struct TopicTraits<hapticd_msg_EdgeHands> {
  static constexpr const char* name = "haptic/edge/hands";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_EdgeHands_desc; }
  static Qos reader_qos() { return realtime_qos(state_reader_depth); }
  static Qos writer_qos() { return realtime_qos(1); }
};
template <>
struct TopicTraits<hapticd_msg_EdgeClock> {
  static constexpr const char* name = "haptic/edge/clock";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_EdgeClock_desc; }
  static Qos reader_qos() { return realtime_qos(state_reader_depth); }
  static Qos writer_qos() { return realtime_qos(1); }
};

}  // namespace hapticd
