// The JSON of Haply's Inverse service: what comes as state, and the force that goes.
//
// Source: docs.haply.co, Inverse SDK 3.1 to 3.5, "WebSocket Protocol" and "Control Commands". Units: m, N,
// quaternions with named parts. Frame: Haply's is the house's (x right, y forward, z up, right-handed).
// A VerseGrip's orientation is taken as it is sent; which way its shaft points is the scene's `mapping.tool`.
// Errors: a text that is no state, or whose numbers are missing or not finite, gives nothing.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/driver/driver.h"

namespace hapticd {

struct Inverse3State {
  std::string id;
  std::array<double, 3> position{};
  std::array<double, 4> orientation{0, 0, 0, 1};
  std::uint32_t buttons = 0;  // a VerseGrip's: a or the only one, b, c
  bool calibrated = true;
  bool ready = true;  // powered and started
  std::string side;   // "left", "right"; only in the first message
};

struct Inverse3Message {
  bool newer = false;  // from a service of 3.5 or later, which numbers its sessions
  std::vector<Inverse3State> devices;
  const Inverse3State* find(std::string_view id) const noexcept;  // empty: the first; null: none
};

std::optional<Inverse3Message> parse_inverse3(std::string_view text);

// newer: the service's. first: also tells the service who we are.
std::string inverse3_force(std::string_view id, const std::array<double, 3>& force, bool newer, bool first);

}  // namespace hapticd
