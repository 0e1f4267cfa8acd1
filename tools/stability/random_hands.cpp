#include "tools/stability/random_hands.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "physics/cutting/mesh_check.h"
#include "tools/client/hand_model.h"
#include "tools/stability/bench/episodes.h"
#include "tools/stability/bench/hands_daemon.h"

namespace hapticd {
namespace {

constexpr double tick_s = 1e-3;
constexpr int substeps = 4;
constexpr int mesh_checked = 100;  // steps between

Scene with_hands(Scene scene, std::size_t hands) {
  scene.instruments.resize(hands);
  return scene;
}

class Episode {
 public:
  Episode(const Scene& scene, const std::vector<StrayingHand>& hands, const RandomSettings& settings,
          std::uint64_t seed, RandomReport& report)
      : scene_(with_hands(scene, hands.size())),
        seed_(seed),
        report_(report),
        daemon_(scene_, daemon_settings(settings, seed)),
        watch_(scene_, daemon_.world().bodies(), hands.front().peak_speed),
        nodes_(nodes_in_use()) {
    for (int i = 0; i < static_cast<int>(hands.size()); ++i) {
      hand_.emplace_back(seed + 1'000'003 * static_cast<std::uint64_t>(i),
                         hands[static_cast<std::size_t>(i)]);
      connected_[i] = true;
      hand_.back().turned = on_device(i).q;
      hand_.back().state.x = hand_.back().before = on_device(i).p;
    }
  }

  void tick(std::int64_t k) {
    EachInstrument<DeviceSample> sample;
    EachInstrument<const DeviceSample*> arrived;
    std::vector<HandTarget> target;
    for (int i = 0; i < hands(); ++i) {
      Hand& hand = hand_[static_cast<std::size_t>(i)];
      const Pose there = on_device(i);
      const bool lost = hand.stray.lost();
      sample[i].buttons = hand.stray.buttons();
      hand.stray.advance();
      target.push_back({there.p, (on_device(i).p - there.p) / tick_s});
      sample[i].sequence = static_cast<std::uint64_t>(k) + 1;
      sample[i].pose = {quantised(hand.state.x, settings(i).quantum), there.q};
      sample[i].enable = enables(k, hand.last);
      if (!lost) arrived[i] = &sample[i];
    }
    const EachInstrument<ForceSample> answer = daemon_.tick(arrived, connected_);
    ++report_.ticks;
    int in_contact = 0;
    for (int i = 0; i < hands(); ++i) {
      const Hand& hand = hand_[static_cast<std::size_t>(i)];
      if (const auto broken = judge(device(i), answer[i], hand.last, report_)) fault(k, *broken);
      in_contact += answer[i].active > 0;
      move(i, target[static_cast<std::size_t>(i)], answer[i]);
    }
    least_ = std::min(least_, energy_);
    least_by_force_ = std::min(least_by_force_, energy_by_force_);
    report_.in_contact += in_contact > 0;
    report_.both_in_contact += in_contact > 1;
    report_.touching += touching();
    if (!seen_) return;
    if (const auto broken = judge(*seen_, watch_.bounds(), report_)) fault(k, *broken);
    seen_.reset();
    if (report_.steps % mesh_checked == 0) check_meshes(k);
  }

  void finish() {
    check_meshes(report_.ticks);
    report_.cut_area = daemon_.world().cutting().area();
    report_.nodes_added = nodes_in_use() - nodes_;
    report_.out_of_room = daemon_.world().cutting().out_of_room();
    report_.made = report_.made_by_episode = -least_;
    report_.made_by_force = -least_by_force_;
    for (const Hand& hand : hand_) report_.made_at_hand = std::max(report_.made_at_hand, -hand.least_energy);
    report_.absorbed = energy_;
    report_.removed = daemon_.world().removed();
  }

 private:
  struct Hand {
    Hand(std::uint64_t seed, const StrayingHand& kind) : stray(seed, kind), at(kind.turned) {}
    Stray stray;
    std::function<Quat(const StrayPlace&)> at;
    HandState state;
    Vec3 before = Vec3::Zero();
    Quat turned = Quat::Identity();
    double energy = 0, least_energy = 0;  // by force
    ForceSample last;
  };

  HandsDaemonSettings daemon_settings(const RandomSettings& of, std::uint64_t seed) {
    HandsDaemonSettings settings;
    settings.passivity_control = of.passivity_control;
    settings.link = of.link;
    settings.at_simulation = of.at_simulation;
    settings.problem_old = of.problem_old;
    settings.begun = [this] { watch_.begin_step(daemon_.world().bodies()); };
    settings.published = [this] { seen_ = watch_.look(daemon_.world().bodies()); };
    if (settings.link) settings.link->seed = seed;
    if (of.late_steps > 0) settings.late.emplace(of.late_steps, seed);
    return settings;
  }

  int hands() const { return static_cast<int>(hand_.size()); }
  const DeviceSettings& device(int i) const { return scene_.instruments[static_cast<std::size_t>(i)].device; }
  HandSettings settings(int i) const {
    HandSettings hand;
    hand.quantum = 55e-6;
    hand.saturation = device(i).max_force;
    return hand;
  }
  // Where a hand is led to.
  Pose on_device(int i) const {
    const Hand& hand = hand_[static_cast<std::size_t>(i)];
    const StrayPlace place = hand.stray.place();
    return to_device(device(i), {place.tip, hand.at(place)});
  }

  int nodes_in_use() const {
    int nodes = 0;
    for (const Body& b : daemon_.world().bodies()) nodes += b.model.nodes_in_use;
    return nodes;
  }

  // Of bodies that a blade cuts.
  void check_meshes(std::int64_t k) {
    for (const Body& b : daemon_.world().bodies()) {
      if (!(b.toughness > 0)) continue;
      TissueModel model = b.model;
      CutWorkspace work(model);
      const std::string wrong = check_mesh(model, b.state, work, &b.surface);
      if (!wrong.empty()) fault(k, "the mesh: " + wrong);
    }
  }

  void move(int i, const HandTarget& target, const ForceSample& answer) {
    Hand& hand = hand_[static_cast<std::size_t>(i)];
    for (int k = 0; k < substeps; ++k)
      hand.state = advanced(settings(i), hand.state, {target.x + tick_s * k / substeps * target.v, target.v},
                            answer.force, tick_s / substeps);
    const Vec3 moved = hand.state.x - hand.before;
    energy_ -= answer.force.dot(moved);
    energy_by_force_ -= answer.force.dot(moved);
    hand.energy -= answer.force.dot(moved);
    hand.least_energy = std::min(hand.least_energy, hand.energy);
    const DeviceState& rendered = daemon_.device(i);
    report_.controlled_force_max = std::max(report_.controlled_force_max, rendered.controlled.norm());
    report_.controlled_force_rms += rendered.controlled.squaredNorm();
    report_.controlled_work -= rendered.controlled.dot(moved);
    const Vec3 torque = rendered.render == Render::zero ? Vec3(Vec3::Zero()) : rendered.rendered.torque;
    const Quat turned = on_device(i).q;
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

  void fault(std::int64_t k, const std::string& what) {
    if (++report_.faulty > 1) return;
    report_.faults.push_back("seed " + std::to_string(seed_) + ", tick " + std::to_string(k) + ": " + what);
  }

  const Scene scene_;
  const std::uint64_t seed_;
  RandomReport& report_;
  HandsDaemon daemon_;
  TissueWatch watch_;
  std::vector<Hand> hand_;
  const int nodes_;
  EachInstrument<bool> connected_;
  double energy_ = 0, least_ = 0, energy_by_force_ = 0, least_by_force_ = 0;
  std::optional<TissueExtremes> seen_;  // at the end of a step, not judged yet
};

void add(const RandomReport& part, RandomReport& sum) {
  add(static_cast<const TrialTally&>(part), static_cast<TrialTally&>(sum));
  sum.cut_area += part.cut_area;
  sum.nodes_added += part.nodes_added;
  sum.out_of_room += part.out_of_room;
  sum.both_in_contact += part.both_in_contact;
  sum.touching += part.touching;
  sum.made = std::max(sum.made, part.made);
  sum.made_by_episode += part.made_by_episode;
  sum.made_by_force = std::max(sum.made_by_force, part.made_by_force);
  sum.made_at_hand = std::max(sum.made_at_hand, part.made_at_hand);
  sum.absorbed += part.absorbed;
  sum.controlled_force_max = std::max(sum.controlled_force_max, part.controlled_force_max);
  sum.controlled_work += part.controlled_work;
  sum.controlled_force_rms += part.controlled_force_rms;
  sum.faulty += part.faulty;
  sum.faults.insert(sum.faults.end(), part.faults.begin(), part.faults.end());
}

}  // namespace

RandomReport run_random(const Scene& scene, const std::vector<StrayingHand>& hands,
                        const RandomSettings& settings, const std::function<bool(double)>& progress) {
  const auto run = [&](std::uint64_t seed, std::int64_t ticks, RandomReport& part,
                       const std::function<bool(std::int64_t)>& done) {
    const auto episode = std::make_unique<Episode>(scene, hands, settings, seed, part);
    for (std::int64_t k = 0; k < ticks; ++k) {
      episode->tick(k);
      if (k % 256 == 0 && !done(256)) break;
    }
    episode->finish();
  };
  const std::vector<RandomReport> parts =
      run_episodes<RandomReport>(settings.ticks, settings.episode, settings.seed, run, progress);
  RandomReport report;
  report.hands = static_cast<int>(hands.size());
  report.passivity_control = settings.passivity_control;
  report.late_steps = settings.late_steps;
  for (const RandomReport& part : parts) add(part, report);
  if (!parts.empty()) report.made_by_episode /= static_cast<double>(parts.size());
  if (report.ticks > 0)
    report.controlled_force_rms = std::sqrt(report.controlled_force_rms / static_cast<double>(report.ticks));
  return report;
}

}  // namespace hapticd
