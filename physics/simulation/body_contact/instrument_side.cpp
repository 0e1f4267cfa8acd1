#include "physics/simulation/body_contact/instrument_side.h"

#include <algorithm>

#include "physics/contact/cutting/edge_rows.h"
#include "physics/contact/incision/incision_rows.h"

namespace hapticd {
namespace {

constexpr double least_margin = 1e-6;  // [m]
constexpr double arm = 5e-3;           // that a turn is measured at [m]

}  // namespace

InstrumentSide::InstrumentSide(const CondensedProblem& problem, Instruments instruments,
                               const InstrumentPoses& device, double h, double margin, ContactState& state,
                               ContactScratch& scratch)
    : problem_(problem),
      instruments_(instruments),
      device_(device),
      start_(start_coupling(problem, device, h, state.coupling_offset)),
      X_(start_.X_start),
      state_(state),
      scratch_(scratch),
      period_(h) {
  frozen_ = problem.renewal == Renewal::frozen;
  if (frozen_)
    for (int i = 0; i < max_instruments; ++i)
      if (X_.present[i]) X_[i] = problem.instrument[i].X_ref;
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
  const auto build = [&](double margin) {
    build_rows(problem_, instruments_, start_.X_free, X_, scratch_.x, start_.K_inv, working_, margin, rows,
               nullptr, nullptr, period_, nullptr, &scratch_.in_reach);
  };
  scratch_.in_reach.keep(0);
  build(margin_);
  // A choice among too many changes from round to round; what is near enough to matter is not too many.
  for (; !frozen_ && rows.contacts == max_contacts && margin_ > least_margin; margin_ *= 0.5)
    build(0.5 * margin_);
  ++scratch_.matrix_version;
  lambda = VecX::Zero(rows.rows());
  for (int i = 0; i < rows.contacts; ++i)
    if (const ContactMemory::Entry* known =
            working_.find(rows.row[i].id, rows.row[i].instrument, rows.row[i].primitive))
      lambda.segment(rows.rows_per_contact * i, rows.rows_per_contact) =
          (rows.row[i].frame.transpose() * known->lambda).head(rows.rows_per_contact);
}

void InstrumentSide::follow() {
  remember(working_);
  if (!frozen_) X_ = placed_by(start_, wrench());
}

VecX InstrumentSide::linearisation_point() const {
  const EachInstrument<Vec6> d = difference(X_, start_.X_free);
  VecX out(point_size);
  for (int i = 0; i < max_instruments; ++i) {
    out.segment<6>(6 * i) = d[i];
    out.segment<3>(6 * i + 3) *= arm;
  }
  return out;
}

void InstrumentSide::go_to(const VecX& d) {
  if (frozen_) return;
  EachInstrument<Vec6> moved;
  for (int i = 0; i < max_instruments; ++i) {
    moved[i] = d.segment<6>(6 * i);
    moved[i].tail<3>() /= arm;
  }
  X_ = displaced(start_.X_free, moved);
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
  out.instrument = placed_by(start_, out.wrench);
  if (!lambda.allFinite()) {
    state_ = ContactState{};
    out.status = SolveStatus::not_finite;
    out.wrench = {};
    out.instrument = start_.X_free;
    return out;
  }
  const EachInstrument<Vec6> moved = difference(out.instrument, X_);
  remember(state_.memory);
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[i];
    out.active += lambda[rows.rows_per_contact * i] > 0;
    ContactMemory::Entry& e = state_.memory.entry[i];
    e.sticking = sticks(contacts, i);
    if (row.edge >= 0) {
      const int n = rows.rows_per_contact * i;
      e.advance = advance_after(row, rows.W()(n, n), lambda[n], contacts.tool_delta()[n]);
      continue;
    }
    const Pose& X = out.instrument[row.instrument];
    const Vec6& d = moved[row.instrument];
    const auto place = [&](const Vec3& s) {
      return frozen_ ? X_[row.instrument].to_local(s - d.head<3>() - d.tail<3>().cross(row.arm))
                     : X.to_local(s);
    };
    if (row.incision) {
      if (e.sticking) continue;
      const int m = rows.rows_per_contact;
      Vec3 local = Vec3::Zero();
      local.head(m) = lambda.segment(m * i, m);
      e.anchor = place(X_[row.instrument].p + row.arm);
      e.other_anchor = ring_at_rest(row, X_[row.instrument], local);
      continue;
    }
    if (row.other >= 0) {
      if (e.sticking) continue;
      e.anchor = X_[row.instrument].q.conjugate() * row.arm;
      e.other_anchor = X_[row.other].q.conjugate() * row.other_arm;
      continue;
    }
    const Vec3 s = sample_position(problem_, scratch_.x, row.sample);
    out.penetration = std::max(out.penetration, -gap_at(instruments_[row.instrument], X, s).distance);
    if (!e.sticking) e.anchor = place(s);
  }
  for (int i = 0; i < max_instruments; ++i)
    if (device_.present[i]) out.wrench[i] += problem_.instrument[i].load;
  state_.coupling_offset = coupling_offset(device_, out.instrument, start_.K_inv);
  return out;
}

EachInstrument<Vec6> InstrumentSide::wrench() const {
  return wrench_on_instruments(scratch_.rows, {lambda.data(), static_cast<std::size_t>(lambda.size())});
}

void InstrumentSide::remember(ContactMemory& memory) const {
  const ContactRows& rows = scratch_.rows;
  memory.count = rows.contacts;
  for (int i = 0; i < rows.contacts; ++i) {
    const int m = rows.rows_per_contact;
    const Vec3 force = rows.row[i].frame.leftCols(m) * lambda.segment(m * i, m);
    const ContactRow& row = rows.row[i];
    memory.entry[i] = {row.id,        force,          row.anchor,       false,
                       row.primitive, row.instrument, row.other_anchor, row.advance};
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
