// What the tip destroys or sucks out, and what was scheduled, leaves the bodies.
//
// In: the tip's pose and pedals; out: what went. Masses and surfaces follow at once; the compliances are told
// later (`tell_compliances`). A step that linearises bodies for the next removes what the tip will have taken
// by then (`remove_ahead`), and its problem is without it. Else the next step begins with that (`remove`), as
// with what was scheduled, and an interim problem is made with the factors that there still are.
// What goes by degrees is thinned in between.
// Units: m, s. Errors: none.
#pragma once

#include <span>
#include <vector>

#include "physics/simulation/body.h"
#include "physics/simulation/step/instrument_motion.h"
#include "physics/simulation/step/removal.h"

namespace hapticd {

struct Removed {
  int tets = 0;
  int fragments_aspirated = 0;
  std::vector<int> bodies;           // that lost some
  bool by_tips = false;              // what they take in a step, if anything; else nothing of what follows
  EachInstrument<LumenState> lumen;  // as they are then
  EachInstrument<double> passed;     // volume that left them in the step [m³]
};

class RemovalStage {
 public:
  RemovalStage(const EachInstrument<RemovalSettings>& settings, double h, std::size_t bodies)
      : settings_(settings), h_(h), gone_(bodies) {}

  // The next `remove` takes these too, whatever the tip does.
  void schedule(int body, std::vector<int> tets) { scheduled_.push_back({body, std::move(tets)}); }
  // … and the crumbs that hang (fragments.h) where these changed.
  void schedule_hinged(const Bodies& bodies, int body, std::span<const int> changed);
  // These become less, evenly, so fast that after `time` nothing would be left of any, but not less than
  // `spent_left`, and never more than there is; begun: so long before the next step.
  void schedule_thinning(int body, std::span<const int> tets, double time, double begun);

  // Either has what the tips take in a step, the second before the step begins. tips: the instruments' poses
  // when the problem without these is in use.
  Removed remove(Bodies& bodies, Instruments instruments, const InstrumentSamples& samples,
                 const InstrumentPoses& tips);
  Removed remove_ahead(Bodies& bodies, Instruments instruments, const InstrumentSamples& samples,
                       const InstrumentPoses& tips);

  // What goes by degrees becomes less. ahead: the problem at hand will be in the middle of its use so long
  // after the step's begin. Returns the bodies that lost some.
  std::vector<int> thin(Bodies& bodies, Instruments instruments, const InstrumentSamples& samples,
                        const InstrumentPoses& tips, double ahead);

  // Per body: gone in this step, and its compliance does not know yet.
  const std::vector<std::vector<int>>& gone() const { return gone_; }
  void tell_compliances(Bodies& bodies);
  void tell_compliance(Bodies& bodies, int b);

  int total() const { return total_; }

 private:
  struct Scheduled {
    int body;
    std::vector<int> tets;
  };
  struct Fading {
    int body, tet;
    double left, per_second;  // at the step's begin
  };

  int take(Bodies& bodies, int b, std::span<const int> tets);
  void remove_at_tips(Bodies& bodies, Instruments instruments, const InstrumentSamples& samples,
                      const InstrumentPoses& tips, Removed& out);
  void thin_at_tip(Body& body, int b, int i, const Instrument& instrument, const Pose& tip);
  void remove_at_tip(Bodies& bodies, int i, const Instrument& instrument, const InstrumentSample& sample,
                     const Pose& tip, Removed& out);
  int suck_out(Bodies& bodies, int b, int i, const Instrument& instrument, const Pose& tip, Removed& out);

  EachInstrument<RemovalSettings> settings_;
  double h_;
  std::vector<Scheduled> scheduled_;
  std::vector<Scheduled> spent_;  // by a tip, by degrees: they go next
  std::vector<Fading> fading_;
  std::vector<std::vector<int>> gone_;
  EachInstrument<double> budget_;   // tetrahedra that the rate allows now
  EachInstrument<double> passing_;  // of what was sucked in, not through the lumen yet [m³]
  bool ahead_ = false;              // what the tips take in the step to come is gone
  int total_ = 0;
};

}  // namespace hapticd
