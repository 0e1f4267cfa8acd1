#include "tools/stability/bench/procedure.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "physics/tissue/fragments.h"
#include "tools/stability/bench/hands_daemon.h"
#include "tools/stability/bench/stability_bench.h"

namespace hapticd {
namespace {

constexpr double tick_s = 1e-3;
constexpr double arming = 0.2;      // before the script begins [s]
constexpr double ramped_up = 0.15;  // of arming: what changes before that is the ramp's [s]
constexpr int substeps = 10;
constexpr double least_scale = 1e-6;                         // of forces that no hand feels
constexpr double touch_force = 3.3, touch_force_rate = 200;  // config/devices/touch.yaml [N], [N/s]
constexpr double pull_allowed = 0.02;  // beyond p A, of it: as the tests of suction allow

// Of what ends at its bound.
constexpr double round_off = 1 - 1e-9;

// Of faces that were not on the first mesh's boundary, in the rest shape [m²].
double cut_area(const Body& body) {
  double area = 0;
  for (const SurfaceFace& f : body.surface.faces()) {
    if (!f.cut) continue;
    const auto x = [&](int k) {
      return body.rest()[static_cast<std::size_t>(f.nodes[static_cast<std::size_t>(k)])];
    };
    area += 0.5 * (x(1) - x(0)).cross(x(2) - x(0)).norm();
  }
  return area;
}

class Trial {
 public:
  Trial(const Procedure& of, Rendering rendering)
      : of_(of),
        rendering_(rendering),
        daemon_(of.scene, settings(rendering)),
        watch_(of.scene, daemon_.world().bodies(), 0) {
    for (const ProcedureHand& hand : of.hands) {
      hands_.push_back({});
      hands_.back().state.x = hand.at(0);
      connected_[static_cast<int>(hands_.size()) - 1] = true;
    }
    rests_.resize(of.rests.size() * hands_.size());
  }

  ProcedureResult run() {
    const auto ticks = static_cast<std::int64_t>(std::llround((arming + of_.duration) / tick_s));
    for (std::int64_t k = 0; k < ticks && result_.finite; ++k) tick(k);
    finish();
    return std::move(result_);
  }

 private:
  struct Hand {
    HandState state;
    ForceSample last;
    double waiting = 0;  // damped in a tick without a force
  };
  struct Range {
    Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  };

  HandsDaemonSettings settings(Rendering rendering) {
    HandsDaemonSettings settings;
    settings.begun = [this] { watch_.begin_step(daemon_.world().bodies()); };
    settings.published = [this] { seen_ = watch_.look(daemon_.world().bodies()); };
    settings.rendering = rendering;
    return settings;
  }
  const DeviceSettings& device(int i) const {
    return of_.scene.instruments[static_cast<std::size_t>(i)].device;
  }
  // Of the devices over the scene's.
  double energy_scale() const { return device(0).force_scale / device(0).position_scale; }
  const Port& port(int i) const { return of_.scene.instruments[static_cast<std::size_t>(i)].shape.port; }
  int count() const { return static_cast<int>(hands_.size()); }

  bool has_port() const {
    return std::any_of(of_.scene.instruments.begin(), of_.scene.instruments.end(),
                       [](const SceneInstrument& i) { return i.shape.port.radius > 0; });
  }

  void tick(std::int64_t k) {
    const double t = tick_s * static_cast<double>(k) - arming;
    if (of_.removed)
      if (std::vector<int> gone = of_.removed(t - tick_s, t); !gone.empty())
        daemon_.schedule_removal(0, std::move(gone));
    EachInstrument<DeviceSample> sample;
    EachInstrument<const DeviceSample*> arrived;
    for (int i = 0; i < count(); ++i) {
      const ProcedureHand& told = of_.hands[static_cast<std::size_t>(i)];
      sample[i].sequence = static_cast<std::uint64_t>(k) + 1;
      sample[i].pose.p = quantised(hands_[static_cast<std::size_t>(i)].state.x, of_.grip.quantum);
      sample[i].enable = true;
      sample[i].buttons = told.pedals && t > 0 ? told.pedals(t) : 0;
      arrived[i] = &sample[i];
    }
    const InstrumentPoses placed = daemon_.haptic().placed;
    const EachInstrument<ForceSample> answer = daemon_.tick(arrived, connected_);
    pump(placed);
    for (int i = 0; i < count(); ++i) {
      look_at(i, answer[i], t);
      move(i, answer[i], t);
    }
    ++result_.tally.ticks;
    result_.made = std::max(result_.made, -(energy_ + dissipated_ + result_.pumped));
    look_at_tissue();
  }

  // What the pumps put into tissue and tips in this tick. A baseline's own is not known: it has all that the
  // daemon's pumps beside it give, and need not give what they take.
  void pump(const InstrumentPoses& before) {
    const HapticState& s = daemon_.haptic();
    if (!has_port() || !s.solved || s.patch.step == 0) return;
    const CondensedProblem& p = s.patch.problem;
    double work = 0;
    for (std::size_t n = 0; n < static_cast<std::size_t>(p.nodes); ++n)
      work += p.pull[n].dot(s.scratch.x[n] - p.x_now[n]);
    for (int i = 0; i < count(); ++i)
      if (port(i).radius > 0 && s.placed.present[i] && before.present[i])
        work += p.instrument[i].load.dot(difference(s.placed[i], before[i]));
    if (rendering_ != Rendering::solved) work = std::max(work, 0.0);
    result_.pumped += energy_scale() * work;
  }

  void look_at(int i, const ForceSample& answer, double t) {
    Hand& hand = hands_[static_cast<std::size_t>(i)];
    const DeviceSettings& d = device(i);
    result_.tally.saturated += (answer.status & status_saturated) != 0;
    result_.tally.latched += (answer.status & status_latched) != 0;
    result_.tally.solver_caps += (answer.status & status_solver_cap) != 0;
    result_.finite = result_.finite && answer.force.allFinite() && hand.state.x.allFinite();
    const double change = (answer.force - hand.last.force).norm();
    if (t > ramped_up - arming) {
      result_.tally.status |= answer.status;
      result_.tally.force_max = std::max(result_.tally.force_max, answer.force.norm());
      result_.tally.device_max = d.max_force;
      result_.change = std::max(result_.change, change / (d.max_force_rate * tick_s));
    }
    result_.tally.in_contact += answer.active > 0;
    if (const Port& p = port(i); p.radius > 0) {
      const double area = std::numbers::pi * p.radius * p.radius;
      const double pulled = answer.force.dot(p.direction) / (d.force_scale * p.vacuum * area);
      result_.pull = std::max(result_.pull, pulled);
    }
    if (i == 0)
      result_.first.push_back({t, (hand.state.x - of_.hands[0].at(0)).dot(of_.along),
                               -answer.force.dot(of_.along), answer.force.norm(), change,
                               answer.torque.norm(), 0, energy_, answer.step, answer.status});
    for (std::size_t r = 0; r < of_.rests.size(); ++r) {
      if (t < of_.rests[r].first || t >= of_.rests[r].second) continue;
      Range& range = rests_[r * hands_.size() + static_cast<std::size_t>(i)];
      range.low = range.low.cwiseMin(hand.state.x);
      range.high = range.high.cwiseMax(hand.state.x);
    }
    hand.last = answer;
  }

  void move(int i, const ForceSample& answer, double t) {
    Hand& hand = hands_[static_cast<std::size_t>(i)];
    const ProcedureHand& told = of_.hands[static_cast<std::size_t>(i)];
    constexpr double h = tick_s / substeps;
    const Vec3 before = hand.state.x;
    double damped = 0;
    for (int k = 0; k < substeps; ++k) {
      const double from = std::max(0.0, t + h * k), to = std::max(0.0, t + h * (k + 1));
      const Vec3 x = told.at(from);
      hand.state = advanced(of_.grip, hand.state, {x, (told.at(to) - x) / h}, answer.force, h);
      damped += h * of_.grip.device_damping * hand.state.v.squaredNorm();
    }
    energy_ -= answer.force.dot(hand.state.x - before);
    if (answer.force.isZero(0)) {
      hand.waiting = damped;
    } else {
      dissipated_ += damped + hand.waiting;
      hand.waiting = 0;
    }
    result_.fastest_hand = std::max(result_.fastest_hand, hand.state.v.norm());
  }

  void look_at_tissue() {
    if (!seen_) return;
    const TissueExtremes seen = *std::exchange(seen_, {});
    TrialTally& tally = result_.tally;
    ++tally.steps;
    result_.finite = result_.finite && seen.finite;
    tally.farthest = std::max(tally.farthest, seen.farthest);
    tally.fastest = std::max(tally.fastest, seen.fastest);
    tally.gained = std::max(tally.gained, seen.gained);
    tally.energy = std::max(tally.energy, seen.energy);
    tally.split = std::max(tally.split, seen.split);
    result_.freed = std::max(result_.freed, seen.made);
    free_energy_ = std::max(free_energy_, seen.free_energy);
  }

  void finish() {
    const Body& body = daemon_.world().bodies().front();
    result_.absorbed = energy_;
    result_.freed_allowed = energy_allowed(free_energy_);
    result_.pieces = find_pieces(body.model, body.state).count();
    if (daemon_.world().removed() == 0) result_.opened = 0.5 * cut_area(body);
    const double torn = energy_scale() * body.tearing.toughness * result_.opened;
    result_.made = std::max(result_.made, torn - (energy_ + dissipated_ + result_.pumped));
    const TissueBounds bounds =
        TissueWatch(of_.scene, daemon_.world().bodies(), result_.fastest_hand).bounds();
    result_.tally.farthest_allowed = bounds.farthest;
    result_.tally.fastest_allowed = bounds.fastest;
    result_.tally.removed = daemon_.world().removed();
    for (const Range& range : rests_)
      result_.swing = std::max(result_.swing, (range.high - range.low).maxCoeff() - 2 * of_.grip.quantum);
  }

  const Procedure& of_;
  const Rendering rendering_;
  HandsDaemon daemon_;
  TissueWatch watch_;
  ProcedureResult result_;
  std::vector<Hand> hands_;
  std::vector<Range> rests_;  // of each rest and hand
  EachInstrument<bool> connected_;
  double energy_ = 0, dissipated_ = 0, free_energy_ = 0;
  std::optional<TissueExtremes> seen_;  // at the end of a step, not judged yet
};

}  // namespace

void as_on_a_touch(Procedure& procedure) {
  for (SceneInstrument& i : procedure.scene.instruments) {
    i.device.max_force = touch_force;
    i.device.max_force_rate = touch_force_rate;
    i.device.quantum = procedure.grip.quantum;
  }
}

double smooth_step(double u) {
  u = std::clamp(u, 0.0, 1.0);
  return u * u * (3 - 2 * u);
}

ProcedureResult run_procedure(const Procedure& procedure, Rendering rendering) {
  return Trial(procedure, rendering).run();
}

StabilityTrial trial_of(const ProcedureResult& r) {
  const TrialTally& t = r.tally;
  const double allowed = energy_allowed(t.energy);
  const struct {
    const char* what;
    double over;
  } bounds[] = {{"swing at rest", r.swing / swing_limit},
                {"energy made at the hands", r.made / made_limit},
                {"force", round_off * t.force_max / t.device_max},
                {"change of the force in a tick", round_off * r.change},
                {"pull beyond p A", (r.pull - 1) / pull_allowed},
                {"energy that a piece gained in a step", t.gained / allowed},
                {"energy that tearing made", t.split / allowed},
                {"energy that a free piece made", r.freed / std::max(r.freed_allowed, 1e-300)},
                {"speed of a piece", t.fastest / t.fastest_allowed},
                {"way of a piece", t.farthest / t.farthest_allowed}};
  StabilityTrial trial;
  for (const auto& bound : bounds)
    if (trial.worst_of.empty() || !(bound.over <= trial.judged)) {
      trial.judged = bound.over;
      trial.worst_of = bound.what;
    }
  if (t.saturated > 0) trial.worst_of += ", with the device at its largest force";
  if (!r.finite) trial.judged = std::numeric_limits<double>::infinity();
  trial.status = t.status;
  for (std::size_t k = 0; k < r.first.size(); k += 2) trial.trace.emplace_back(r.first[k].t, r.first[k].size);
  return trial;
}

double stiffness_of(Procedure procedure) {
  for (SceneInstrument& i : procedure.scene.instruments) {
    i.device.force_scale = least_scale;
    i.device.quantum = 0;
  }
  procedure.scene.bodies.front().tearing.toughness = 0;
  procedure.grip.quantum = 0;
  procedure.duration = procedure.loading.second;
  procedure.rests.clear();
  std::vector<ClosedLoopTick> slow = run_procedure(procedure, Rendering::solved).first;
  std::erase_if(slow, [&](const ClosedLoopTick& tick) { return tick.t < procedure.loading.first; });
  double most = 0;
  for (const ClosedLoopTick& tick : slow) most = std::max(most, tick.force / least_scale);
  return slope_at(slow, least_scale, 0.8 * most);
}

StabilityPlan procedure_plan(std::vector<ProcedureWay> ways, bool quick) {
  StabilityPlan plan;
  plan.naive = "contact force held for the 20 ms of a simulation step, the first way";
  plan.ours = "the daemon, the worst of all ways";
  plan.judged = "the worst bound over what it allows: swing at rest, energy, force, change in a tick, tissue";
  plan.limit = 1;
  plan.reason = "100 N/m: as of the modes of time";
  plan.required = 100;
  plan.goes_on = true;
  plan.values = quick ? std::vector<double>{100, 800} : geometric(25, 3200, 2);
  std::vector<double> stiffness;
  for (const ProcedureWay& way : ways) stiffness.push_back(stiffness_of(way.made(1)));
  const double grip = ways.front().made(1).grip.stiffness;
  const auto run = [ways, stiffness, grip](double displayed, std::size_t w, Rendering rendering) {
    Procedure procedure = ways[w].made(1 + displayed / grip);
    for (SceneInstrument& i : procedure.scene.instruments)
      i.device.force_scale = displayed / stiffness[w] / i.device.position_scale;
    StabilityTrial trial = trial_of(run_procedure(procedure, rendering));
    trial.worst_of = ways[w].name + ": " + trial.worst_of;
    return trial;
  };
  plan.run_naive = [run](double displayed) { return run(displayed, 0, Rendering::held); };
  plan.run_ours = [run, count = ways.size()](double displayed) {
    StabilityTrial worst = run(displayed, 0, Rendering::solved);
    for (std::size_t w = 1; w < count; ++w)
      if (StabilityTrial trial = run(displayed, w, Rendering::solved); !(trial.judged <= worst.judged))
        worst = std::move(trial);
    return worst;
  };
  return plan;
}

}  // namespace hapticd
