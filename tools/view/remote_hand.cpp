#include "tools/view/remote_hand.h"

#include <atomic>
#include <cmath>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "haptic/channel.h"
#include "haptic/clock.h"
#include "tools/client/hand_source.h"

namespace hapticd {
namespace {

constexpr std::int64_t longest_ms = 300'000;  // every slot is kept in memory
constexpr std::int64_t silence_ns = 2'000'000'000;
constexpr double margin = 0.95;  // of the workspace

struct Wanted {
  Vec3 target = Vec3::Zero();
  std::uint32_t buttons = 0;
};

// What client and viewer share while a hand is held.
struct Held {
  Channel<Wanted> wanted;
  double radius = 0;
  Vec3 now = Vec3::Zero();  // the client's thread
  double reached = 0;
};

HandScript follow(const std::shared_ptr<Held>& held) {
  HandScript script;
  script.target = [held](double t) {
    held->wanted.acquire();
    const double dt = t - std::exchange(held->reached, t);
    const Vec3 before = held->now;
    held->now = bounded_target(before, held->wanted.front().target, held->radius, dt);
    return HandTarget{held->now, dt > 0 ? Vec3((held->now - before) / dt) : Vec3::Zero()};
  };
  script.command = [held](double) {
    DeviceCommand command;
    command.buttons = held->wanted.front().buttons;
    return command;
  };
  return script;
}

}  // namespace

Vec3 bounded_target(const Vec3& now, const Vec3& wanted, double radius, double dt) noexcept {
  if (!wanted.allFinite()) return now;
  const double far = wanted.norm();
  const Vec3 inside = far > radius ? Vec3(radius / far * wanted) : wanted;
  const Vec3 way = inside - now;
  const double length = way.norm(), most = hand_speed * std::max(dt, 0.0);
  return length > most ? Vec3(now + most / length * way) : inside;
}

struct RemoteHand::State {
  const Participant& participant;
  const std::uint32_t device_id;
  std::uint64_t viewer = 0;  // 0: nobody
  std::int64_t heard_ns = 0;
  bool wants = false;  // a hand that could not begin yet: the device is not known
  Wanted first;
  std::shared_ptr<Held> held;
  std::unique_ptr<DeviceClient> client;
  std::thread thread;
  std::atomic<bool> running{false}, armed{false};
  std::mutex mutex;
  std::string failure;  // under mutex
  std::string said;

  State(const Participant& p, std::uint32_t id) : participant(p), device_id(id) {}

  void begin(const nlohmann::json& health) {
    held = std::make_shared<Held>();
    held->radius = margin * health.value("workspace", 0.0);
    held->now = bounded_target(Vec3::Zero(), first.target, held->radius, 1e9);
    held->wanted.back() = first;
    held->wanted.publish();
    held->wanted.acquire();
    HandSettings hand;
    hand.saturation = health.value("max_force", 0.0);
    ClientSettings settings;
    settings.device_id = device_id;
    settings.match_timeout = settings.arm_timeout = 3;
    client = std::make_unique<DeviceClient>(participant, settings, longest_ms);
    running = true;
    armed = false;
    wants = false;
    set_failure("");
    thread = std::thread([this, hand] {
      try {
        HandSource source(hand, follow(held), 10);
        client->run(source, [this](std::int64_t reached) { armed = reached >= 0; });
      } catch (const std::exception& e) {
        set_failure(e.what());
      }
      running = false;
    });
  }
  void end() {
    if (client) client->leave();
    if (thread.joinable()) thread.join();
    client.reset();
    held.reset();
    viewer = 0;
    wants = false;
    armed = false;
  }
  void set_failure(const std::string& text) {
    const std::lock_guard lock(mutex);
    failure = text;
  }
  std::string state() const {
    if (wants || (running && !armed)) return "arming";
    return running ? "holding" : "off";
  }
};

RemoteHand::RemoteHand(const Participant& participant, std::uint32_t device_id)
    : state_(std::make_unique<State>(participant, device_id)) {}

RemoteHand::~RemoteHand() { state_->end(); }

void RemoteHand::hear(std::uint64_t viewer, const std::string& text) {
  State& s = *state_;
  if (text.empty()) {
    if (viewer == s.viewer) s.end();
    return;
  }
  const nlohmann::json said = nlohmann::json::parse(text, nullptr, false);
  if (!said.is_object() || !said.contains("hand") || !said["hand"].is_object()) return;
  const nlohmann::json& hand = said["hand"];
  if (s.viewer != 0 && s.viewer != viewer) return;
  try {
    if (!hand.value("active", false)) {
      if (viewer == s.viewer) s.end();
      return;
    }
    Wanted wanted;
    const auto target = hand.at("target").get<std::array<double, 3>>();
    wanted.target = {target[0], target[1], target[2]};
    wanted.buttons = hand.value("buttons", 0u) & (pedal_phaco | pedal_aspiration);
    if (!wanted.target.allFinite()) return;
    s.heard_ns = monotonic_ns();
    if (s.viewer == 0) {
      s.viewer = viewer;
      s.wants = true;
    }
    if (s.wants) s.first = wanted;
    if (!s.held) return;
    s.held->wanted.back() = wanted;
    s.held->wanted.publish();
  } catch (const nlohmann::json::exception&) {
    // Not a text of ours.
  }
}

SharedMessage RemoteHand::poll(const nlohmann::json* health) {
  State& s = *state_;
  if (s.viewer != 0 && monotonic_ns() - s.heard_ns > silence_ns) s.end();
  if (s.viewer != 0 && !s.wants && !s.running) s.end();  // it ended by itself: failed, or its time was over
  if (s.wants && health) s.begin(*health);
  nlohmann::json json{{"kind", "hand"}, {"device", s.device_id}, {"viewer", s.viewer}, {"state", s.state()}};
  {
    const std::lock_guard lock(s.mutex);
    json["failure"] = s.failure;
  }
  std::string text = json.dump();
  if (text == s.said) return nullptr;
  s.said = text;
  return std::make_shared<const ViewMessage>(ViewMessage{"hand", false, std::move(text)});
}

}  // namespace hapticd
