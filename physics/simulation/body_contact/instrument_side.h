// The instruments' part of a solve that it shares with bodies that touch one another.
//
//   rows at the last solve's state → (one solve of all rows, body_contact.h) → the instrument on its virtual
//   coupling, where its forces put it → rows again …
//
// Coupling, slip and anchors are those of contact_solve.h. Units: m, N. Errors: by the solution's status;
// after `not_finite` force and memory are zero.
#pragma once

#include "physics/contact/contact_solve.h"
#include "physics/simulation/body_contact/body_contact.h"

namespace hapticd {

class InstrumentSide {
 public:
  // h: simulation step [s]; margin: gap below which renewed rows exist [m].
  InstrumentSide(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& device,
                 double h, double margin, ContactState& state, ContactScratch& scratch);

  // Rows where the last solve has put instrument and tissue; λ to start from.
  void linearise(const BodyContacts& contacts);

  // After a solve: the instrument goes to where its forces put it.
  void follow();

  // Where the instruments are linearised next, from where they would be free: turns at 5 mm [m].
  static constexpr int point_size = 6 * max_instruments;
  VecX linearisation_point() const;
  void go_to(const VecX& d);

  // Leaves memory and coupling offset for the next step.
  ContactSolution finish(const BodyContacts& contacts);

  VecX lambda;  // of the rows in the scratch [N]

 private:
  EachInstrument<Vec6> wrench() const;
  void remember(ContactMemory& memory) const;
  bool sticks(const BodyContacts& contacts, int row) const;

  const CondensedProblem& problem_;
  const Instruments instruments_;
  InstrumentPoses device_;
  CouplingStart start_;
  InstrumentPoses X_;
  ContactState& state_;
  ContactScratch& scratch_;
  ContactMemory working_;
  double margin_, period_;
  bool frozen_;
  bool first_ = true;
};

}  // namespace hapticd
