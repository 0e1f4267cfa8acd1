#include "tools/device/inverse3_messages.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace hapticd {
namespace {

using nlohmann::json;

const json& at(const json& object, const char* key) {
  static const json none;
  if (!object.is_object()) return none;
  const auto found = object.find(key);
  return found == object.end() ? none : *found;
}

template <std::size_t n>
bool numbers(const json& object, const std::array<const char*, n>& keys, std::array<double, n>& out) {
  std::array<double, n> read;
  for (std::size_t i = 0; i < n; ++i) {
    const json& value = at(object, keys[i]);
    if (!value.is_number()) return false;
    read[i] = value.get<double>();
    if (!std::isfinite(read[i])) return false;
  }
  out = read;
  return true;
}

bool flag(const json& object, const char* key, bool without) {
  const json& value = at(object, key);
  return value.is_boolean() ? value.get<bool>() : without;
}

std::string text_of(const json& object, const char* key) {
  const json& value = at(object, key);
  return value.is_string() ? value.get<std::string>() : std::string();
}

// The first grip of the list, if any: what an Inverse3 carries.
void read_grip(const json& grips, Inverse3State& state) {
  if (!grips.is_array() || grips.empty()) return;
  const json& grip = at(grips[0], "state");
  std::array<double, 4> q{};
  if (numbers(at(grip, "orientation"), std::array{"x", "y", "z", "w"}, q)) {
    const double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (n > 0.5)
      for (std::size_t i = 0; i < 4; ++i) state.orientation[i] = q[i] / n;
  }
  const json& buttons = at(grip, "buttons");
  const std::array<bool, 3> pressed = {flag(buttons, "a", flag(grip, "button", false)),
                                       flag(buttons, "b", false), flag(buttons, "c", false)};
  for (std::size_t i = 0; i < pressed.size(); ++i)
    if (pressed[i]) state.buttons |= 1u << i;
}

}  // namespace

const Inverse3State* Inverse3Message::find(std::string_view id) const noexcept {
  for (const Inverse3State& device : devices)
    if (id.empty() || device.id == id) return &device;
  return nullptr;
}

std::optional<Inverse3Message> parse_inverse3(std::string_view text) {
  const json message = json::parse(text, nullptr, false);
  if (!message.is_object()) return {};
  Inverse3Message out;
  out.newer = message.contains("session_id");
  const json& devices = at(message, "inverse3");
  if (!devices.is_array()) return out;
  for (const json& device : devices) {
    Inverse3State state;
    state.id = text_of(device, "device_id");
    if (state.id.empty() ||
        !numbers(at(at(device, "state"), "cursor_position"), std::array{"x", "y", "z"}, state.position))
      continue;
    const json& status = at(device, "status");
    state.calibrated = flag(status, "calibrated", true);
    state.ready = flag(status, "ready", true) && flag(status, "power_supply", true);
    state.side = text_of(at(device, "config"), "handedness");
    const json& wireless = at(message, "wireless_verse_grip");
    read_grip(wireless.is_array() && !wireless.empty() ? wireless : at(message, "verse_grip"), state);
    out.devices.push_back(std::move(state));
  }
  return out;
}

std::string inverse3_force(std::string_view id, const std::array<double, 3>& force, bool newer, bool first) {
  json message;
  const json vector = {{"x", force[0]}, {"y", force[1]}, {"z", force[2]}};
  message["inverse3"] = json::array(
      {{{"device_id", id}, {"commands", {{"set_cursor_force", {{newer ? "vector" : "values", vector}}}}}}});
  if (first && newer) message["session"] = {{"configure", {{"profile", {{"name", "hapticd:device"}}}}}};
  return message.dump();
}

}  // namespace hapticd
