#include "physics/contact/delassus.h"

#include <algorithm>

#include "physics/contact/delassus_columns.h"

namespace hapticd {
namespace {

using delassus::Lanes;

constexpr double rigid_compliance = 1e-3;  // of the coupling's, at contacts with less of their own

// A column of one block of W. Of the vector's four lanes the last is not meant: the next contact's block
// writes there again, and the last one's ends before.
void put(double* at, double w, bool) noexcept { *at = w; }
void put(double* at, Lanes w, bool last) noexcept {
  if (!last) return delassus::store(at, w);
  for (int r = 0; r < 3; ++r) at[r] = w[r];
}

// The upper triangle from the lower one.
void mirror(double* W, int n) noexcept {
  using delassus::load;
  using delassus::store;
  constexpr int side = 4;
  for (int j = 0; j < n; j += side)
    for (int i = j; i < n; i += side) {
      double* const from = W + static_cast<std::ptrdiff_t>(j) * n + i;
      double* const to = W + static_cast<std::ptrdiff_t>(i) * n + j;
      if (i == j || i + side > n) {
        for (int c = 0; c < side && j + c < n; ++c)
          for (int r = i == j ? c + 1 : 0; r < side && i + r < n; ++r)
            to[static_cast<std::ptrdiff_t>(r) * n + c] = from[static_cast<std::ptrdiff_t>(c) * n + r];
        continue;
      }
      const Lanes a = load(from), b = load(from + n), c = load(from + 2 * n), d = load(from + 3 * n);
      const Lanes ab0 = __builtin_shufflevector(a, b, 0, 4, 2, 6),
                  ab1 = __builtin_shufflevector(a, b, 1, 5, 3, 7);
      const Lanes cd0 = __builtin_shufflevector(c, d, 0, 4, 2, 6),
                  cd1 = __builtin_shufflevector(c, d, 1, 5, 3, 7);
      store(to, __builtin_shufflevector(ab0, cd0, 0, 1, 4, 5));
      store(to + n, __builtin_shufflevector(ab1, cd1, 0, 1, 4, 5));
      store(to + 2 * n, __builtin_shufflevector(ab0, cd0, 2, 3, 6, 7));
      store(to + 3 * n, __builtin_shufflevector(ab1, cd1, 2, 3, 6, 7));
    }
}

// What the couplings of two rows' instruments have in common: B, in the rows' frames.
Mat3 coupling(const EachInstrument<Vec6>& K_inv_diag, const ContactRow& i, const ContactRow& j) noexcept {
  const auto cross = [](const Vec3& r) {
    Mat3 m;
    m << 0, -r.z(), r.y(), r.z(), 0, -r.x(), -r.y(), r.x(), 0;
    return m;
  };
  Mat3 B = Mat3::Zero();
  const auto add = [&](int of_i, const Vec3& r_i, int of_j, const Vec3& r_j, double sign) {
    if (of_i < 0 || of_i != of_j) return;
    const Vec6& K = K_inv_diag[of_i];
    B += sign * (Mat3(K.head<3>().asDiagonal()) - cross(r_i) * K.tail<3>().asDiagonal() * cross(r_j));
  };
  add(i.instrument, i.arm, j.instrument, j.arm, 1);
  add(i.instrument, i.arm, j.other, j.other_arm, -1);
  add(i.other, i.other_arm, j.instrument, j.arm, -1);
  add(i.other, i.other_arm, j.other, j.other_arm, 1);
  return i.frame.transpose() * B * j.frame;
}

// G of a contact with itself, world axes.
template <int corners, typename Sample>
Mat3 own_compliance(const CondensedProblem& problem, const Sample& s) noexcept {
  Mat3 G = Mat3::Zero();
  if (s.node[0] < 0) return G;
  const auto C = problem.C();
  for (int a = 0; a < corners; ++a)
    for (int b = 0; b < corners; ++b)
      G += s.weight[a] * s.weight[b] * problem.column_scale[s.node[b]] *
           C.template block<3, 3>(3 * s.node[a], 3 * s.node[b]);
  return G;
}

// n·G n of a contact with itself.
double own_compliance(const CondensedProblem& problem, const PatchSample& s, const Vec3& n) noexcept {
  if (s.node[0] < 0) return 0;
  const auto size = static_cast<std::ptrdiff_t>(3 * problem.nodes);
  double sum = 0;
  for (int b = 0; b < 3; ++b) {
    const double* const C = problem.C().data() + 3 * s.node[b] * size;
    double of_b = 0;
    for (int a = 0; a < 3; ++a) {
      const double* const at = C + 3 * s.node[a];
      double pushed = 0;
      for (int k = 0; k < 3; ++k)
        pushed += n[k] * (at[k * size] * n[0] + at[k * size + 1] * n[1] + at[k * size + 2] * n[2]);
      of_b += s.weight[a] * pushed;
    }
    sum += s.weight[b] * problem.column_scale[s.node[b]] * of_b;
  }
  return sum;
}

// W_jj of a contact with tissue or an obstacle, without friction.
double own_entry(const CondensedProblem& problem, const Vec6& K_inv_diag, const ContactRow& row) noexcept {
  const Vec3 n = row.frame.col(0), moment = row.arm.cross(n);
  const Vec3 shifts = K_inv_diag.head<3>(), turns = K_inv_diag.tail<3>(), squares = row.arm.cwiseAbs2();
  const double of_coupling = shifts.dot(n.cwiseAbs2()) + turns.dot(moment.cwiseAbs2());
  const double trace = shifts.sum() + turns.sum() * squares.sum() - turns.dot(squares);
  const double of_tissue = own_compliance(problem, problem.sample[row.sample], n);
  return of_coupling + of_tissue + std::max(0.0, rigid_compliance * trace / 3 - of_tissue);
}

}  // namespace

// What a contact's compliance lacks to a thousandth of the coupling's there is added: means of the diagonal,
// without friction G's normal entry.
template <int m>
void DelassusColumns<m>::own_block(int j) noexcept {
  const ContactRow& of = rows_->row[j];
  if (m == 1 && of.sample >= 0) {
    *block(j, j) = own_entry(*problem_, K_inv_diag_[of.instrument], of);
    return;
  }
  Mat3 W = coupling(K_inv_diag_, of, of);
  const double of_coupling = rigid_compliance * W.trace() / 3;
  double added = of_coupling;
  if (of.incision) {
    W.diagonal().array() += of.compliance;
    added = std::max(0.0, of_coupling - of.compliance);
  } else if (of.other < 0) {
    const Mat3 G = of.edge < 0 ? own_compliance<3>(*problem_, problem_->sample[of.sample])
                               : own_compliance<4>(*problem_, problem_->edge[of.edge]);
    const Mat3 G_local = of.frame.transpose() * G * of.frame;
    added = std::max(0.0, of_coupling - (m == 1 ? G_local(0, 0) : G_local.trace() / 3));
    W += G_local;
  }
  for (int c = 0; c < m; ++c)
    for (int r = 0; r < m; ++r)
      block(j, j)[c * n_ + r] = W(std::max(r, c), std::min(r, c)) + (r == c ? added : 0);
  if (of.edge >= 0) *block(j, j) += of.compliance;
}

template <int m>
void DelassusColumns<m>::begin(const CondensedProblem& problem, const EachInstrument<Vec6>& K_inv_diag,
                               ContactRows& rows) noexcept {
  problem_ = &problem;
  K_inv_diag_ = K_inv_diag;
  rows_ = &rows;
  W_ = rows.W_storage.data();
  n_ = rows.rows();
  used_.find(problem, rows);
  std::fill_n(made_.begin(), rows.contacts, false);
  count_ = 0;
  for (int j = 0; j < rows.contacts; ++j) {
    probe_[j] = delassus::Probe<m>(rows.row[j]);
    own_block(j);
  }
}

template <int m>
void DelassusColumns<m>::make(int j) noexcept {
  if (made_[j]) return;
  column(j, 0);
  made_[j] = true;
  ++count_;
}

template <int m>
void DelassusColumns<m>::make_all() noexcept {
  if (count_ == rows_->contacts) return;
  for (int j = 0; j < rows_->contacts; ++j) column(j, j);
  mirror(W_, static_cast<int>(n_));
  std::fill_n(made_.begin(), rows_->contacts, true);
  count_ = rows_->contacts;
}

template <int m>
void DelassusColumns<m>::column(int j, int first) noexcept {
  const ContactRow& of = rows_->row[j];
  panel_.fill(*problem_, used_, K_inv_diag_[of.instrument], of);
  for (int i = first; i < rows_->contacts; ++i) {
    if (i == j) continue;
    const ContactRow& row = rows_->row[i];
    double* const to = block(i, j);
    if (made_[i]) {
      for (int c = 0; c < m; ++c)
        for (int r = 0; r < m; ++r) to[c * n_ + r] = block(j, i)[r * n_ + c];
      continue;
    }
    if (row.other >= 0 || of.other >= 0 || row.incision || of.incision) {
      const Mat3 B = coupling(K_inv_diag_, row, of);
      for (int c = 0; c < m; ++c) std::copy_n(B.col(c).data(), m, to + c * n_);
      continue;
    }
    const bool one_instrument = row.instrument == of.instrument,
               last = i + 1 == rows_->contacts || i + 1 == j;
    const auto u =
        row.edge < 0 ? panel_.tissue(problem_->sample[row.sample]) : panel_.tissue(problem_->edge[row.edge]);
    for (int c = 0; c < m; ++c)
      put(to + c * n_, one_instrument ? probe_[i](panel_, u.by[c], c) : probe_[i].tissue(u.by[c]), last);
  }
}

template class DelassusColumns<1>;
template class DelassusColumns<3>;

void assemble_delassus(const CondensedProblem& problem, const EachInstrument<Vec6>& K_inv_diag,
                       ContactRows& rows) noexcept {
  const auto assemble = [&](auto columns) {
    columns.begin(problem, K_inv_diag, rows);
    columns.make_all();
  };
  if (rows.rows_per_contact == 1)
    assemble(DelassusColumns<1>());
  else
    assemble(DelassusColumns<3>());
}

}  // namespace hapticd
