// What a client that behaves saw of one stage of the abuse, and whether its device was served throughout.
//
// Kept: every force finite and within `maximum` [N], no two consecutive ones further apart than `step` [N]
// (zeros at once apart), and of what was sent in slots that no stall of the machine struck (stall_watch.h)
// 99 % answered; nothing latched, but where the simulation was held. What the client could not send, and what
// a stall took, is in the figures beside it. Pure.
#pragma once

#include "tools/cli/report.h"
#include "tools/client/session.h"

namespace hapticd {

struct Stage {
  std::string name;
  std::int64_t begin_ns = 0, end_ns = 0;
  bool held = false;  // the simulation was: less force is right then
};

// What the well-behaved client saw of one stage.
struct StageFigures {
  std::int64_t scheduled = 0, sent = 0, answered = 0, longest_unanswered = 0;
  SlotCount between;  // stalls of the machine
  double force_min = 0, force_max = 0,
         step_max = 0;  // [N]; step: between consecutive ticks, zeros at once apart
  std::uint32_t status = 0;
  bool finite = true;

  double answered_of_sent() const noexcept;
  double answered_between_stalls() const noexcept;
  bool kept(bool held, double maximum, double step) const noexcept;
};

StageFigures figures_of(const DeviceClient& client, const Stage& stage, const Stalls& stalls);

nlohmann::ordered_json to_json(const Stage& stage, const StageFigures& figures, bool kept);
std::string to_text(const StageFigures& figures);

}  // namespace hapticd
