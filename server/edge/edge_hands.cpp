#include "server/edge/edge_hands.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double quaternion_tolerance = 1e-3;
constexpr double farthest = 1e3;  // [m] a hand in the scene

bool is_sound(const hapticd_msg_EdgeHand& h) noexcept {
  double squares = 0;
  for (const double q : h.orientation) squares += q * q;
  for (const double p : h.position)
    if (!(std::abs(p) <= farthest)) return false;
  return std::abs(std::sqrt(squares) - 1) <= quaternion_tolerance && h.vacuum >= 0 && std::isfinite(h.vacuum);
}

}  // namespace

bool are_hands(std::span<const hapticd_msg_EdgeHand> hands, int instruments) noexcept {
  return (hands.empty() || hands.size() == static_cast<std::size_t>(instruments)) &&
         std::all_of(hands.begin(), hands.end(), is_sound);
}

InstrumentInputs read_hands(std::span<const hapticd_msg_EdgeHand> hands, std::int64_t clock_ns,
                            std::int64_t now_ns) noexcept {
  InstrumentInputs all;
  for (std::size_t i = 0; i < hands.size(); ++i) {
    const hapticd_msg_EdgeHand& h = hands[i];
    const std::int64_t oldest = now_ns - hands_oldest_ns, received = h.received_ns + clock_ns;
    InstrumentInput& in = all[static_cast<int>(i)];
    in.X.p = Vec3(h.position[0], h.position[1], h.position[2]);
    in.X.q = Quat(h.orientation[3], h.orientation[0], h.orientation[1], h.orientation[2]).normalized();
    // What cannot be is not extrapolated from.
    in.received_ns = std::clamp(received, oldest, now_ns);
    in.present = h.present && received > oldest;
    in.sequence = h.state_number;
    in.buttons = in.present ? h.buttons : 0;
    in.vacuum = in.present ? h.vacuum : 0;
  }
  return all;
}

hapticd_msg_EdgeHand hand_message(const InstrumentInput& in, bool here, std::int64_t clock_ns,
                                  std::int64_t now_ns) noexcept {
  hapticd_msg_EdgeHand h{};
  h.present = here && in.present && now_ns - in.received_ns < hands_lost_ns;
  for (int k = 0; k < 3; ++k) h.position[k] = in.X.p[k];
  for (int k = 0; k < 4; ++k) h.orientation[k] = in.X.q.coeffs()[k];
  h.buttons = in.buttons;
  h.state_number = in.sequence;
  h.received_ns = in.received_ns - clock_ns;
  h.vacuum = in.vacuum;
  return h;
}

}  // namespace hapticd
