#include "physics/simulation/step/removal_stage.h"

#include <algorithm>

#include "physics/tissue/fragments.h"

namespace hapticd {

Removed RemovalStage::remove(Bodies& bodies, Instruments instruments, const InstrumentSamples& samples,
                             const InstrumentPoses& tips) {
  Removed out;
  const auto count = [&](int b, int gone) {
    if (gone == 0) return;
    out.tets += gone;
    out.bodies.push_back(b);
  };
  for (const Scheduled& s : scheduled_) count(s.body, take(bodies, s.body, s.tets));
  scheduled_.clear();
  for (int i = 0; i < instruments.count(); ++i)
    remove_at_tip(bodies, i, instruments[i], samples[i], tips[i], out);
  total_ += out.tets;
  return out;
}

void RemovalStage::remove_at_tip(Bodies& bodies, int i, const Instrument& instrument,
                                 const InstrumentSample& sample, const Pose& tip, Removed& out) {
  const RemovalSettings& settings = settings_[i];
  double& budget = budget_[i];
  const bool cutting = sample.present && sample.phaco;
  // What a tip in the open does not spend does not pile up: one element and one step's worth at most.
  const double per_step = settings.rate * h_;
  budget = cutting ? std::min(budget + per_step, 1 + per_step) : 0;
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
    if (sample.present && sample.aspiration && settings.aspiration_max_tets > 0 && body.state.removed > 0) {
      const Aspirated sucked = fragments_at_tip(body.model, body.state, instrument, tip, settings);
      if (sucked.fragments > 0) {
        gone += take(bodies, static_cast<int>(b), sucked.tets);
        out.fragments_aspirated += sucked.fragments;
      }
    }
    if (gone == 0) continue;
    out.tets += gone;
    out.bodies.push_back(static_cast<int>(b));
  }
}

int RemovalStage::take(Bodies& bodies, int b, std::span<const int> tets) {
  const std::vector<int> went = take_out(bodies[b], tets);
  gone_[b].insert(gone_[b].end(), went.begin(), went.end());
  return static_cast<int>(went.size());
}

void RemovalStage::tell_compliances(Bodies& bodies) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (gone_[b].empty()) continue;
    bodies[b].compliance->remove(bodies[b].state, gone_[b]);
    gone_[b].clear();
    bodies[b].free.ahead = false;
  }
}

}  // namespace hapticd
