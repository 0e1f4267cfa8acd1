// A simulated hand and device as the source of a client's poses: the loop closed over DDS.
//
// Between slots the hand (hand_model.h) is integrated in `substeps` equal parts of a millisecond, under each
// force from the instant at which it arrived, plus the delay. A skipped slot is integrated all the same, so a
// late client loses messages, not time. The pose sent is the encoder's.
// Guarantee: `at` does not allocate. Figures are for after the run.
#pragma once

#include <Eigen/Geometry>
#include <functional>

#include "tools/client/client.h"
#include "tools/client/hand_model.h"

namespace hapticd {

// Where the hand wants to be t seconds into the run.
struct HandScript {
  std::function<HandTarget(double)> target;
  std::function<DeviceCommand(double)> command;  // orientation and buttons; its position is not used
  double rest_from = 0, rest_to = 0;             // in which it should be at rest [s]
};

struct HandFigures {
  double force_square_sum = 0;  // of the applied force, per substep [N²]
  double error_square_sum = 0;  // of x − x_target, per substep [m²]
  double error_max = 0;         // [m]
  double force_max = 0;         // applied [N]
  Eigen::AlignedBox3d rest;     // of x while the script has it at rest [m]
  std::int64_t substeps = 0;
  PassivityObserver passivity;
};

class HandSource final : public SlotSource {
 public:
  // Throws std::invalid_argument as `check(hand)` does, and for fewer than one substep.
  HandSource(const HandSettings& hand, HandScript script, int substeps);

  DeviceCommand first() const noexcept override { return measured(); }
  DeviceCommand at(std::int64_t k, std::int64_t now_ns, const NewestForce& newest,
                   bool fresh) noexcept override;

  const HandFigures& figures() const noexcept { return figures_; }
  const HandState& state() const noexcept { return state_; }

 private:
  DeviceCommand measured() const noexcept;
  void advance_one_slot(std::int64_t slot_ns) noexcept;

  HandSettings hand_;
  HandScript script_;
  int substeps_;
  HandState state_;
  ForceDelay delay_;
  HandFigures figures_;
  std::int64_t reached_ = 0;  // slot that state_ belongs to
  std::int64_t zero_ns_ = 0;  // client's clock at slot 0; 0: not begun
};

}  // namespace hapticd
