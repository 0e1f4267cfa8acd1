#include "physics/simulation/body_contact/instrument_side.h"

#include <algorithm>

namespace hapticd {

InstrumentSide::InstrumentSide(const CondensedProblem& problem, const Instrument& instrument,
                               const Pose& device, double h, double margin, ContactState& state,
                               ContactScratch& scratch)
    : problem_(problem), instrument_(instrument), device_(device), state_(state), scratch_(scratch) {
  K_inv_ = inverse_stiffness(problem.coupling, h);
  // The part of the last offset that the coupling's damper still holds.
  const double lag = problem.coupling.damping_time / (h + problem.coupling.damping_time);
  Vec6 held = lag * state.coupling_offset, offset = state.coupling_offset;
  for (int c = 0; c < 6; ++c)
    if (K_inv_[c] == 0) held[c] = offset[c] = 0;
  X_free_ = displaced(device, -held);
  frozen_ = problem.renewal == Renewal::frozen;
  X_ = frozen_ ? problem.X_ref : displaced(device, -offset);
  margin_ = frozen_ ? problem.alarm_distance : margin;
  working_ = state.memory;
}

void InstrumentSide::linearise(const BodyContacts& contacts) {
  // Where a force is forgotten, the last solve's geometry: rows.h.
  if (frozen_ || (first_ && forgets(problem_, state_.memory)))
    scratch_.x = problem_.x_now;
  else
    contacts.patch_positions(scratch_.x);
  first_ = false;
  ContactRows& rows = scratch_.rows;
  build_rows(problem_, instrument_, X_free_, X_, scratch_.x, K_inv_, working_, margin_, rows);
  ++scratch_.matrix_version;
  lambda = VecX::Zero(rows.rows());
  for (int i = 0; i < rows.contacts; ++i)
    if (const ContactMemory::Entry* known = working_.find(rows.row[i].id, rows.row[i].primitive))
      lambda.segment(rows.rows_per_contact * i, rows.rows_per_contact) =
          (rows.row[i].frame.transpose() * known->lambda).head(rows.rows_per_contact);
}

void InstrumentSide::follow(double part) {
  remember(working_);
  const Pose end = place();
  if (!frozen_) X_ = displaced(X_, part * difference(end, X_));
}

ContactSolution InstrumentSide::finish(const BodyContacts& contacts) {
  const ContactRows& rows = scratch_.rows;
  contacts.patch_positions(scratch_.x);
  std::copy_n(lambda.data(), lambda.size(), scratch_.lambda.data());
  ContactSolution out;
  out.status = contacts.report().status;
  out.residual = contacts.report().residual;
  out.contacts = rows.contacts;
  out.dropped = rows.dropped;
  out.wrench = wrench();
  out.instrument = place();
  if (!out.wrench.allFinite()) {
    state_ = ContactState{};
    out.status = SolveStatus::not_finite;
    out.wrench.setZero();
    out.instrument = X_free_;
    return out;
  }
  const Vec6 moved = difference(out.instrument, problem_.X_ref);
  remember(state_.memory);
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[i];
    const Vec3 s = sample_position(problem_, scratch_.x, row.sample);
    out.active += lambda[rows.rows_per_contact * i] > 0;
    out.penetration = std::max(out.penetration, -gap_at(instrument_, out.instrument, s).distance);
    ContactMemory::Entry& e = state_.memory.entry[i];
    e.sticking = sticks(contacts, i);
    if (!e.sticking)
      e.anchor = frozen_ ? problem_.X_ref.to_local(s - moved.head<3>() - moved.tail<3>().cross(row.arm))
                         : out.instrument.to_local(s);
  }
  state_.coupling_offset = difference(device_, out.instrument);
  for (int c = 0; c < 6; ++c)
    if (K_inv_[c] == 0) state_.coupling_offset[c] = 0;
  return out;
}

Vec6 InstrumentSide::wrench() const {
  return wrench_on_instrument(scratch_.rows, {lambda.data(), static_cast<std::size_t>(lambda.size())});
}

void InstrumentSide::remember(ContactMemory& memory) const {
  const ContactRows& rows = scratch_.rows;
  memory.count = rows.contacts;
  for (int i = 0; i < rows.contacts; ++i) {
    const int m = rows.rows_per_contact;
    const Vec3 force = rows.row[i].frame.leftCols(m) * lambda.segment(m * i, m);
    memory.entry[i] = {rows.row[i].id, force, rows.row[i].anchor, false, rows.row[i].primitive};
  }
}

bool InstrumentSide::sticks(const BodyContacts& contacts, int i) const {
  const ContactRows& rows = scratch_.rows;
  const double mu = rows.row[i].friction;
  if (rows.rows_per_contact == 1 || mu <= 0 || lambda[3 * i] <= 0) return false;
  const Vec3 l = lambda.segment<3>(3 * i);
  if (l.tail<2>().norm() <= inside_the_cone * mu * l[0]) return true;
  return contacts.tool_delta().segment<2>(3 * i + 1).norm() <=
         sticking_slip * rows.W().block<3, 3>(3 * i, 3 * i).trace() / 3 * l.norm();
}

}  // namespace hapticd
