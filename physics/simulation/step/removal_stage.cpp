#include "physics/simulation/step/removal_stage.h"

#include <algorithm>
#include <utility>

#include "physics/tissue/fragments.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

constexpr double rounding = 1e-9;  // of a volume that is all but through

bool is_crushed(const Body& body, int t) {
  const Corners x = corners_of(body.model.mesh.tets[t], body.state.x);
  return !(deformation_gradient(x, body.model.gradients[t]).determinant() > crushed);
}

void count(int body, int gone, Removed& out) {
  if (gone == 0) return;
  out.tets += gone;
  out.bodies.push_back(body);
}

}  // namespace

void RemovalStage::schedule_hinged(const Bodies& bodies, int body, std::span<const int> changed) {
  if (!bodies[body].removable) return;
  std::vector<int> tets = hinged_fragments(bodies[body].model, bodies[body].state, changed, crumb_tets);
  if (!tets.empty()) schedule(body, std::move(tets));
}

void RemovalStage::schedule_thinning(int body, std::span<const int> tets, double time, double begun) {
  for (const int t : tets) fading_.push_back({body, t, 1 - begun / time, 1 / time});
}

Removed RemovalStage::remove(Bodies& bodies, Instruments instruments, const InstrumentSamples& samples,
                             const InstrumentPoses& tips) {
  Removed out;
  for (const Scheduled& s : scheduled_) count(s.body, take(bodies, s.body, s.tets), out);
  scheduled_.clear();
  if (!std::exchange(ahead_, false)) remove_at_tips(bodies, instruments, samples, tips, out);
  total_ += out.tets;
  return out;
}

Removed RemovalStage::remove_ahead(Bodies& bodies, Instruments instruments, const InstrumentSamples& samples,
                                   const InstrumentPoses& tips) {
  Removed out;
  remove_at_tips(bodies, instruments, samples, tips, out);
  ahead_ = true;
  total_ += out.tets;
  return out;
}

void RemovalStage::remove_at_tips(Bodies& bodies, Instruments instruments, const InstrumentSamples& samples,
                                  const InstrumentPoses& tips, Removed& out) {
  out.by_tips = true;
  for (const Scheduled& s : spent_) {
    const Body& body = bodies[s.body];
    const int gone = take(bodies, s.body, s.tets);
    const std::vector<int> hinged = hinged_fragments(body.model, body.state, s.tets, crumb_tets);
    count(s.body, gone + take(bodies, s.body, hinged), out);
  }
  spent_.clear();
  for (int i = 0; i < instruments.count(); ++i)
    remove_at_tip(bodies, i, instruments[i], samples[i], tips[i], out);
}

void RemovalStage::remove_at_tip(Bodies& bodies, int i, const Instrument& instrument,
                                 const InstrumentSample& sample, const Pose& tip, Removed& out) {
  const RemovalSettings& settings = settings_[i];
  double& budget = budget_[i];
  const bool cutting = sample.present && sample.phaco && !settings.gradual;
  // What a tip in the open does not spend does not pile up: one element and one step's worth at most.
  const double per_step = settings.rate * h_;
  budget = cutting ? std::min(budget + per_step, 1 + per_step) : 0;
  const bool drawing = sample.present && sample.aspiration && aspirates(instrument, settings);
  // What is in the lumen moves as fast as the pump draws, and the next piece waits until it is through.
  if (drawing) {
    const double all = passing_[i], left = all - instrument.port.flow * h_;
    passing_[i] = instrument.port.flow > 0 && left > rounding * all ? left : 0;
    out.passed[i] = all - passing_[i];
  }
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body& body = bodies[b];
    if (!body.removable) continue;
    int gone = 0;
    if (budget >= 1) {
      std::vector<int> tets = tets_at_tip(body.model, body.state, instrument, tip, settings.stroke);
      tets.resize(std::min(tets.size(), static_cast<std::size_t>(budget)));
      budget -= static_cast<double>(tets.size());
      gone += take(bodies, static_cast<int>(b), tets);
      gone += take(bodies, static_cast<int>(b), hinged_fragments(body.model, body.state, tets, crumb_tets));
    }
    if (drawing && (body.state.removed > 0 || body.topology > 0) && passing_[i] <= 0)
      gone += suck_out(bodies, static_cast<int>(b), i, instrument, tip, out);
    count(static_cast<int>(b), gone, out);
  }
  out.lumen[i].passing = passing_[i];
}

int RemovalStage::suck_out(Bodies& bodies, int b, int i, const Instrument& instrument, const Pose& tip,
                           Removed& out) {
  const Body& body = bodies[b];
  const Aspirated sucked = fragments_at_tip(body.model, body.state, instrument, tip, settings_[i]);
  double& too_wide = out.lumen[i].too_wide;
  if (sucked.too_wide > 0) too_wide = too_wide > 0 ? std::min(too_wide, sucked.too_wide) : sucked.too_wide;
  if (sucked.fragments == 0) return 0;
  if (instrument.port.lumen > 0) passing_[i] += sucked.volume;
  out.fragments_aspirated += sucked.fragments;
  return take(bodies, b, sucked.tets);
}

std::vector<int> RemovalStage::thin(Bodies& bodies, Instruments instruments, const InstrumentSamples& samples,
                                    const InstrumentPoses& tips, double ahead) {
  std::vector<std::vector<Thinned>> thinned(bodies.size());
  std::erase_if(fading_, [&](const Fading& f) { return !bodies[f.body].state.alive[f.tet]; });
  for (Fading& f : fading_) {
    const double now = bodies[f.body].state.left[f.tet];
    thinned[f.body].push_back(
        {f.tet, std::clamp(f.left - f.per_second * ahead, std::min(spent_left, now), now)});
    f.left -= f.per_second * h_;
  }
  std::vector<int> changed;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body& body = bodies[b];
    const int before = body.state.thinnings;
    thin_tets(body.model, body.state, thinned[b]);
    for (int i = 0; i < instruments.count(); ++i)
      if (body.removable && samples[i].present && samples[i].phaco && settings_[i].gradual)
        thin_at_tip(body, static_cast<int>(b), i, instruments[i], tips[i]);
    if (body.state.thinnings == before) continue;
    body.energy.elastic.resize(0);
    changed.push_back(static_cast<int>(b));
  }
  return changed;
}

void RemovalStage::thin_at_tip(Body& body, int b, int i, const Instrument& instrument, const Pose& tip) {
  const std::vector<int> tets = tets_at_tip(body.model, body.state, instrument, tip, settings_[i].stroke);
  const double share = settings_[i].rate * h_ * body.mean_volume / static_cast<double>(tets.size());
  std::vector<Thinned> thinned;
  Scheduled spent{b, {}};
  for (const int t : tets) {
    const double left = body.state.left[t] - share / body.model.volume[t];
    if (left <= spent_left || (left < 1 && is_crushed(body, t))) spent.tets.push_back(t);
    thinned.push_back({t, std::max(left, spent_left)});
  }
  thin_tets(body.model, body.state, thinned);
  if (!spent.tets.empty()) spent_.push_back(std::move(spent));
}

int RemovalStage::take(Bodies& bodies, int b, std::span<const int> tets) {
  const std::vector<int> went = take_out(bodies[b], tets);
  gone_[b].insert(gone_[b].end(), went.begin(), went.end());
  return static_cast<int>(went.size());
}

void RemovalStage::tell_compliances(Bodies& bodies) {
  for (std::size_t b = 0; b < bodies.size(); ++b) tell_compliance(bodies, static_cast<int>(b));
}

void RemovalStage::tell_compliance(Bodies& bodies, int b) {
  if (gone_[b].empty()) return;
  bodies[b].compliance->remove(bodies[b].state, gone_[b]);
  gone_[b].clear();
  bodies[b].free.ahead = false;
}

}  // namespace hapticd
