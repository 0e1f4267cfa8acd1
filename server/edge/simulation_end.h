// The simulation's end of the link to its edge: a thread that sends problems and hears hands.
//
//   copies → haptic/edge/problem        the newest problem, as long as an edge is heard
//   haptic/edge/hands → told            the edge's hands, in this machine's clock
//   own → haptic/edge/clock             the answer, with the hands of the loop beside the simulation
//
// `told` is what the simulation latches, or, where a haptic loop is beside it, what that has of them
// (remote_hand.h); only then there is an `own`.
//
// One edge at a time: the first heard keeps the world until it was silent for `edge_stays_ns`; hands of
// others are refused and counted. Hands that are not finite, not unit, not of this version, too many or too
// few, or whose number does not rise change nothing. Instruments are not there once no hands came for
// `hands_lost_ns`. Thread safety: start and stop belong to one thread; statistics may be read by any; the
// link's thread alone reads `copies` and `own` and writes `told`. Errors: the constructor throws
// std::runtime_error with Cyclone's reason.
#pragma once

#include <atomic>
#include <nlohmann/json_fwd.hpp>

#include "haptic/channel.h"
#include "haptic/haptic_step.h"
#include "haptic/histogram.h"
#include "server/edge/edge_hands.h"
#include "server/edge/edge_problem.h"
#include "server/edge/edge_topics.h"
#include "server/edge/link_settings.h"

namespace hapticd {

class SimulationEnd {
 public:
  SimulationEnd(const Participant& participant, const LinkSettings& settings,
                Channel<CondensedProblem>& copies, Channel<InstrumentInputs>& told,
                Channel<InstrumentInputs>* own = nullptr);
  ~SimulationEnd();
  SimulationEnd(const SimulationEnd&) = delete;
  SimulationEnd& operator=(const SimulationEnd&) = delete;

  void start();
  void stop() noexcept;

  // problems_sent, bytes_sent, mbit_per_s, patches ({nodes, samples, bytes}, the largest of each number of
  // nodes), hands_taken, hands_refused, other_edges, edges.
  nlohmann::json summary() const;
  std::uint64_t turns() const noexcept { return turns_.load(std::memory_order_relaxed); }

 private:
  void run();
  void hear(std::int64_t now_ns);
  bool admit(const hapticd_msg_EdgeHands& hands, dds_instance_handle_t writer, std::int64_t now_ns);
  void tell(const hapticd_msg_EdgeHands& hands, std::int64_t now_ns);
  void answer(std::int64_t now_ns);
  void lose_hands();
  void send();

  const LinkSettings settings_;
  const std::uint64_t simulation_;  // this start's number
  Channel<CondensedProblem>& copies_;
  Channel<InstrumentInputs>& told_;
  Channel<InstrumentInputs>* const own_;
  Reader<hapticd_msg_EdgeHands> hands_;
  Writer<hapticd_msg_EdgeProblem> problems_;
  Writer<hapticd_msg_EdgeClock> clock_;
  LinkWait wait_;
  PackedProblem packed_;
  dds_instance_handle_t writer_ = 0;  // the edge's; 0: none
  std::uint64_t edge_ = 0, newest_number_ = 0, answers_ = 0;
  std::uint64_t newest_step_ = 0, number_base_ = 0;  // of problems
  std::int64_t asked_ns_ = 0;                        // by the edge's clock, when it sent what was heard last
  std::int64_t heard_ns_ = 0, clock_ns_ = 0, other_said_ns_ = 0;
  bool present_ = false;  // some instrument, as told last

  std::atomic<std::uint64_t> turns_{0}, sent_{0}, bytes_{0}, taken_{0}, refused_{0}, others_{0}, edges_{0};
  std::atomic<std::int64_t> first_sent_ns_{0}, last_sent_ns_{0};
  struct PatchSize {
    std::atomic<std::uint32_t> samples{0}, bytes{0}, count{0};
  };
  std::array<PatchSize, max_patch_nodes / 10 + 1> sizes_;  // by tens of nodes
  LinkThread thread_;
};

}  // namespace hapticd
