// The edge's end of the link to its simulation: a thread that hears problems and sends hands.
//
//   haptic/edge/problem → problems        checked (edge_problem.h), its time in this machine's clock, newest
//   first instruments → haptic/edge/hands       each millisecond
//   haptic/edge/clock → clock_offset.h, others  hands that are answered beside the simulation
//
// A problem's age therefore counts the network's delay. Not passed on: what read_problem refuses, another
// scene's, what is for another edge, an older number than the newest, and a time that is not over yet; the
// safety table then goes by the age of the last. The simulation heard first is kept until it was silent for
// `edge_stays_ns`; another one is refused until then, and a rival, as a second daemon is, while both are
// heard. Problems of a simulation that starts again count on. Thread safety: start and stop belong to one
// thread; `rival`, `turns` and `summary` may be called by any; the link's thread alone writes `problems` and
// `others`, and reads `instruments`. Errors: the constructor throws std::runtime_error.
#pragma once

#include <atomic>
#include <nlohmann/json_fwd.hpp>

#include "haptic/channel.h"
#include "haptic/haptic_step.h"
#include "haptic/histogram.h"
#include "server/edge/clock_offset.h"
#include "server/edge/edge_hands.h"
#include "server/edge/edge_problem.h"
#include "server/edge/edge_topics.h"
#include "server/edge/link_settings.h"

namespace hapticd {

class EdgeEnd {
 public:
  EdgeEnd(const Participant& participant, const LinkSettings& settings,
          Channel<InstrumentInputs>& instruments, Channel<CondensedProblem>& problems,
          Channel<InstrumentInputs>* others = nullptr);
  ~EdgeEnd();
  EdgeEnd(const EdgeEnd&) = delete;
  EdgeEnd& operator=(const EdgeEnd&) = delete;

  void start();
  void stop() noexcept;

  // Whether a second simulation's problem came within the last half second. Wait-free.
  bool rival(std::int64_t now_ns) const noexcept;
  std::uint64_t turns() const noexcept { return turns_.load(std::memory_order_relaxed); }
  // problems_taken, problems_refused by reason, link_delay_ms (of problems: p50, p99, max), clock
  // ({known, offset_ms, error_ms, round_trip_ms}), simulations, hands_sent.
  nlohmann::json summary() const;

 private:
  // Why a problem is not passed on.
  enum class Refusal : std::uint8_t {
    version,
    counts,
    unsound,
    scene,
    other_edge,
    number,
    clock,
    rival,
    reasons
  };

  void run();
  void hear_clock(std::int64_t now_ns);
  void hear_others(const hapticd_msg_EdgeClock& m, std::int64_t now_ns);
  void hear_problems(std::int64_t now_ns);
  bool keep(std::uint64_t simulation, dds_instance_handle_t writer, std::int64_t now_ns);
  std::optional<Refusal> take(const hapticd_msg_EdgeProblem& m, std::int64_t now_ns);
  void refuse(Refusal why, std::int64_t now_ns);
  void send_hands(std::int64_t now_ns);

  const LinkSettings settings_;
  const std::uint64_t edge_;  // this start's number
  Channel<InstrumentInputs>& instruments_;
  Channel<CondensedProblem>& problems_;
  Channel<InstrumentInputs>* const others_;
  Reader<hapticd_msg_EdgeProblem> problem_reader_;
  Reader<hapticd_msg_EdgeClock> clock_reader_;
  Writer<hapticd_msg_EdgeHands> hands_;
  LinkWait wait_;
  ClockOffset clock_;
  dds_instance_handle_t writer_ = 0;  // of the simulation that is kept; 0: none
  std::uint64_t simulation_ = 0, newest_number_ = 0, passed_on_ = 0, hands_number_ = 0, newest_answer_ = 0;
  std::int64_t heard_ns_ = 0;
  std::array<std::int64_t, static_cast<std::size_t>(Refusal::reasons)> said_ns_{};

  std::atomic<std::uint64_t> turns_{0}, taken_{0}, sent_{0}, simulations_{0};
  std::array<std::atomic<std::uint64_t>, static_cast<std::size_t>(Refusal::reasons)> refused_{};
  std::atomic<std::int64_t> rival_ns_{0};  // 0: never
  std::atomic<bool> clock_known_{false};
  std::atomic<std::int64_t> offset_ns_{0}, error_ns_{0}, round_trip_ns_{0};
  Histogram delay_;  // from publication to here
  LinkThread thread_;
};

}  // namespace hapticd
