// What one of two hands feels, for whoever closes its loop (closed_loop.h), while the other does as it is
// told.
//
// The other holds its device at `at`, gripped as `grip` says, or, without a grip, rigidly. From `silent_from`
// on its client sends nothing, and the daemon takes its instrument out of the tissue. Time: since the first
// tick [s]. What the tissue took in at the other's port, its device's damping included, is `taken`: of both
// ports together nothing may be made. Units: SI, device frames. Errors: as World's.
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <vector>

#include "tools/client/hand_model.h"
#include "tools/offline/renderer.h"
#include "tools/stability/bench/hands_daemon.h"

namespace hapticd {

struct OtherHand {
  std::function<Vec3(double)> at;
  std::optional<HandSettings> grip;
  double silent_from = std::numeric_limits<double>::infinity();
};

class TwoHandRenderer final : public Renderer {
 public:
  // hand: 0 or 1, of a scene with two instruments.
  TwoHandRenderer(const Scene& scene, int hand, OtherHand other);

  ForceSample tick(const DeviceSample* arrived) override;

  // Since a time, and 0 before it.
  double taken_since(double t) const;
  // Of the other between two times: peak to peak of its height [m].
  double swing(double from, double to) const;

 private:
  void move_other(double t, const Vec3& answer);

  const int hand_;
  OtherHand other_;
  HandsDaemon daemon_;
  HandState state_;
  std::optional<ForceDelay> delay_;
  DeviceSample sample_;
  Vec3 held_;  // where it is at the end of a tick [m]
  double taken_ = 0;
  std::int64_t count_ = 0;
  struct Moment {
    double t, height, taken;
  };
  std::vector<Moment> past_;
};

}  // namespace hapticd
