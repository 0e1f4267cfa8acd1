#include "tools/stability/two_hands/random_two_hands.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/client/hand_model.h"
#include "tools/stability/episodes.h"
#include "tools/stability/tissue_watch.h"
#include "tools/stability/two_hands/hands_daemon.h"
#include "tools/stability/two_hands/stray.h"

namespace hapticd {
namespace {

constexpr double tick_s = 1e-3;
constexpr int substeps = 4;
constexpr double peak_speed = 80e-3;     // of a tip in the scene: 4 mm in 100 ms, minimum jerk [m/s]
constexpr double energy_allowed = 1e-6;  // gained in a step, over the largest energy that a piece had
constexpr double small_energy = 1e-15;   // round-off of a piece at rest [J]
constexpr int looked_at = 15;            // ticks after a step has begun: it has ended, and no other has begun

Scene with_hands(Scene scene, int hands) {
  scene.instruments.resize(static_cast<std::size_t>(hands));
  return scene;
}

class Episode {
 public:
  Episode(const Scene& two_hands, int hands, const RandomSettings& settings, std::uint64_t seed,
          TwoHandsReport& report)
      : scene_(with_hands(two_hands, hands)),
        seed_(seed),
        report_(report),
        daemon_(scene_, settings.passivity_control),
        watch_(scene_, daemon_.world().bodies(), peak_speed) {
    for (int i = 0; i < hands; ++i) {
      hand_.emplace_back(seed + 1'000'003 * static_cast<std::uint64_t>(i),
                         over_lens(-1.5e-3 * i, -0.6e-3, -0.5e-3));
      connected_[i] = true;
      hand_.back().turned = on_device(i, hand_.back().stray.tip()).q;
      hand_.back().state.x = hand_.back().before = on_device(i, hand_.back().stray.tip()).p;
    }
    report_.farthest_allowed = watch_.bounds().farthest;
    report_.fastest_allowed = watch_.bounds().fastest;
  }

  void tick(std::int64_t k) {
    EachInstrument<DeviceSample> sample;
    EachInstrument<const DeviceSample*> arrived;
    std::vector<HandTarget> target;
    for (int i = 0; i < hands(); ++i) {
      Hand& hand = hand_[static_cast<std::size_t>(i)];
      const Pose there = on_device(i, hand.stray.tip());
      const bool lost = hand.stray.lost();
      sample[i].buttons = hand.stray.buttons();
      hand.stray.advance();
      target.push_back({there.p, (on_device(i, hand.stray.tip()).p - there.p) / tick_s});
      sample[i].sequence = static_cast<std::uint64_t>(k) + 1;
      sample[i].pose = {quantised(hand.state.x, settings(i).quantum), there.q};
      // Who has been disarmed asks again, wherever the tip is by then.
      sample[i].enable = k % 200 != 199 || (hand.last.status & (status_disarmed | status_latched)) == 0;
      if (!lost) arrived[i] = &sample[i];
    }
    const EachInstrument<ForceSample> answer = daemon_.tick(arrived, connected_);
    ++report_.ticks;
    int in_contact = 0;
    for (int i = 0; i < hands(); ++i) {
      judge(i, answer[i], k);
      in_contact += answer[i].active > 0;
      move(i, target[static_cast<std::size_t>(i)], answer[i]);
    }
    least_ = std::min(least_, energy_);
    report_.in_contact += in_contact > 0;
    report_.both_in_contact += in_contact > 1;
    report_.touching += touching();
    if (daemon_.world().steps() != steps_) ticks_of_step_ = 0;
    steps_ = daemon_.world().steps();
    if (++ticks_of_step_ == looked_at) look(k);
  }

  void finish() {
    report_.made = -least_;
    report_.absorbed = energy_;
    report_.removed = daemon_.world().removed();
  }

 private:
  struct Hand {
    Hand(std::uint64_t seed, const Vec3& begin) : stray(seed, begin) {}
    Stray stray;
    HandState state;
    Vec3 before = Vec3::Zero();
    Quat turned = Quat::Identity();
    ForceSample last;
  };

  int hands() const { return static_cast<int>(hand_.size()); }
  const DeviceSettings& device(int i) const { return scene_.instruments[static_cast<std::size_t>(i)].device; }
  HandSettings settings(int i) const {
    HandSettings hand;
    hand.quantum = 55e-6;
    hand.saturation = device(i).max_force;
    return hand;
  }
  Pose on_device(int i, const Vec3& tip) const {
    return to_device(device(i), {tip, i == 0 ? through_incision(tip) : through_side_port(tip)});
  }

  void move(int i, const HandTarget& target, const ForceSample& answer) {
    Hand& hand = hand_[static_cast<std::size_t>(i)];
    for (int k = 0; k < substeps; ++k)
      hand.state = advanced(settings(i), hand.state, {target.x + tick_s * k / substeps * target.v, target.v},
                            answer.force, tick_s / substeps);
    energy_ -= answer.force.dot(hand.state.x - hand.before);
    // Turned as told: the hand holds its stylus by its direction. The scene's devices have no torque, so what
    // turning puts in is counted by the torque that they would have.
    const DeviceState& rendered = daemon_.haptic().device[i];
    const Vec3 torque = rendered.render == Render::zero ? Vec3(Vec3::Zero()) : rendered.rendered.torque;
    const Quat turned = on_device(i, hand.stray.tip()).q;
    energy_ -= torque.dot(difference(Pose{Vec3::Zero(), turned}, Pose{Vec3::Zero(), hand.turned}).tail<3>());
    hand.turned = turned;
    hand.before = hand.state.x;
    hand.last = answer;
  }

  bool touching() const {
    const ContactScratch& scratch = daemon_.haptic().scratch;
    if (!daemon_.haptic().solved) return false;
    for (int r = 0; r < scratch.rows.contacts; ++r)
      if (scratch.rows.row[static_cast<std::size_t>(r)].other >= 0 &&
          scratch.lambda[static_cast<std::size_t>(scratch.rows.rows_per_contact * r)] > 0)
        return true;
    return false;
  }

  void judge(int i, const ForceSample& answer, std::int64_t k) {
    const Hand& hand = hand_[static_cast<std::size_t>(i)];
    report_.latched += (answer.status & status_latched) != 0;
    report_.saturated += (answer.status & status_saturated) != 0;
    report_.solver_caps += (answer.status & status_solver_cap) != 0;
    if (!answer.force.allFinite() || !answer.torque.allFinite() || !std::isfinite(answer.energy))
      fault(k, "force", 0, 0);
    const double size = answer.force.norm(), step = (answer.force - hand.last.force).norm();
    report_.force_max = std::max(report_.force_max, size);
    if (size > device(i).max_force * (1 + 1e-9)) fault(k, "force [N]", size, device(i).max_force);
    // What is put to zero at once is a safe state (haptic/README.md).
    constexpr std::uint32_t at_once = status_latched | status_disarmed;
    const double most = device(i).max_force_rate * tick_s;
    if (((answer.status | hand.last.status) & at_once) == 0 && step > most * (1 + 1e-9))
      fault(k, "slew [N/ms]", step, most);
  }

  void look(std::int64_t k) {
    const TissueExtremes seen = watch_.look(daemon_.world().bodies());
    ++report_.steps;
    report_.farthest = std::max(report_.farthest, seen.farthest);
    report_.fastest = std::max(report_.fastest, seen.fastest);
    report_.gained = std::max(report_.gained, seen.gained);
    report_.energy = std::max(report_.energy, seen.energy);
    if (!seen.finite) fault(k, "node", 0, 0);
    if (seen.farthest > watch_.bounds().farthest)
      fault(k, "node away [m]", seen.farthest, watch_.bounds().farthest);
    if (seen.fastest > watch_.bounds().fastest)
      fault(k, "node's speed [m/s]", seen.fastest, watch_.bounds().fastest);
    if (const double most = energy_allowed * report_.energy + small_energy; seen.gained > most)
      fault(k, "a piece's gain [J]", seen.gained, most);
  }

  void fault(std::int64_t k, const char* what, double value, double allowed) {
    if (++report_.faulty > 1) return;
    char text[160];
    std::snprintf(text, sizeof text, "seed %llu, tick %lld: %s %.4g, allowed %.4g",
                  static_cast<unsigned long long>(seed_), static_cast<long long>(k), what, value, allowed);
    report_.faults.emplace_back(text);
  }

  const Scene scene_;
  const std::uint64_t seed_;
  TwoHandsReport& report_;
  HandsDaemon daemon_;
  TissueWatch watch_;
  std::vector<Hand> hand_;
  EachInstrument<bool> connected_;
  double energy_ = 0, least_ = 0;
  std::uint64_t steps_ = 0;
  int ticks_of_step_ = 0;
};

void add(const TwoHandsReport& part, TwoHandsReport& sum) {
  sum.ticks += part.ticks;
  sum.steps += part.steps;
  sum.in_contact += part.in_contact;
  sum.both_in_contact += part.both_in_contact;
  sum.touching += part.touching;
  sum.latched += part.latched;
  sum.saturated += part.saturated;
  sum.solver_caps += part.solver_caps;
  sum.removed += part.removed;
  sum.force_max = std::max(sum.force_max, part.force_max);
  sum.made = std::max(sum.made, part.made);
  sum.made_by_episode += part.made;
  sum.absorbed += part.absorbed;
  sum.farthest = std::max(sum.farthest, part.farthest);
  sum.farthest_allowed = std::max(sum.farthest_allowed, part.farthest_allowed);
  sum.fastest = std::max(sum.fastest, part.fastest);
  sum.fastest_allowed = std::max(sum.fastest_allowed, part.fastest_allowed);
  sum.gained = std::max(sum.gained, part.gained);
  sum.energy = std::max(sum.energy, part.energy);
  sum.faulty += part.faulty;
  sum.faults.insert(sum.faults.end(), part.faults.begin(), part.faults.end());
}

}  // namespace

TwoHandsReport run_random_two(const Scene& two_hands, int hands, const RandomSettings& settings,
                              const std::function<bool(double)>& progress) {
  const auto run = [&](std::uint64_t seed, std::int64_t ticks, TwoHandsReport& part,
                       const std::function<bool(std::int64_t)>& done) {
    const auto episode = std::make_unique<Episode>(two_hands, hands, settings, seed, part);
    for (std::int64_t k = 0; k < ticks; ++k) {
      episode->tick(k);
      if (k % 256 == 0 && !done(256)) break;
    }
    episode->finish();
  };
  const std::vector<TwoHandsReport> parts =
      run_episodes<TwoHandsReport>(settings.ticks, settings.episode, settings.seed, run, progress);
  TwoHandsReport report;
  report.hands = hands;
  report.device_max = two_hands.first().device.max_force;
  for (const TwoHandsReport& part : parts) add(part, report);
  if (!parts.empty()) report.made_by_episode /= static_cast<double>(parts.size());
  return report;
}

}  // namespace hapticd
