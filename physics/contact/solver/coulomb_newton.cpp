#include "physics/contact/solver/coulomb_newton.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr int singly = 60;  // unknowns up to which contacts leave one by one
constexpr double forget = 0.95;
// A typedef: of an alias clang drops `aligned`, and faults.
typedef double Lanes __attribute__((vector_size(32), aligned(8), may_alias));

constexpr double flops_of_assembly = 12;  // per entry, in flops of the factor

// Sorts one contact by y = λ − ρ δ.
ContactMode classify(const double* l, const double* d, double rho, double mu, double limit,
                     ReducedContact& u) noexcept {
  const double n = l[0] - rho * d[0];
  if (!(n > 0)) return ContactMode::open;
  if (mu <= 0) return n < limit ? ContactMode::frictionless : ContactMode::limited;
  const double y1 = l[1] - rho * d[1], y2 = l[2] - rho * d[2], pulled = std::sqrt(y1 * y1 + y2 * y2);
  if (pulled <= mu * n) return ContactMode::stick;
  u.d1 = y1 / pulled;
  u.d2 = y2 / pulled;
  u.lambda_n = l[0] > 0 ? l[0] : n;
  u.c = (pulled - mu * n) / (rho * mu * n);
  return ContactMode::slip;
}

// λ of one contact after its step, wherever that is.
Vec3 linear(const ReducedContact& u, const double* base, const double* steps, double mu) noexcept {
  const double* step = steps + u.first;
  if (u.mode == ContactMode::frictionless) return {base[0] + step[0], 0, 0};
  if (u.mode == ContactMode::stick) return {base[0] + step[0], base[1] + step[1], base[2] + step[2]};
  const double n = u.lambda_n + step[0], turn = steps[u.turn] / mu;
  return {n, mu * (n * u.d1 - turn * u.d2), mu * (n * u.d2 + turn * u.d1)};
}

// λ of one contact after its step, inside its cone.
Vec3 stepped(const ReducedContact& u, const double* base, const double* steps, double mu,
             double limit) noexcept {
  const double* step = steps + u.first;
  if (u.mode == ContactMode::frictionless) return {std::clamp(base[0] + step[0], 0.0, limit), 0, 0};
  if (u.mode == ContactMode::slip) {
    const double n = std::max(0.0, u.lambda_n + step[0]);
    if (n == 0) return Vec3::Zero();
    const double turn = steps[u.turn] / (mu * n);
    Eigen::Vector2d d(u.d1 - turn * u.d2, u.d2 + turn * u.d1);
    d *= mu * n / d.norm();
    return {n, d[0], d[1]};
  }
  Vec3 out(std::max(0.0, base[0] + step[0]), base[1] + step[1], base[2] + step[2]);
  const double t = out.tail<2>().norm();
  if (t > mu * out[0]) out.tail<2>() *= mu * out[0] / t;
  return out;
}

class Reduced {
 public:
  Reduced(const CoulombSystem& system, CoulombWorkspace& ws) noexcept : s_(system), ws_(ws) {}

  int size() const noexcept { return size_; }
  std::span<const ReducedContact> contacts() const noexcept {
    return {ws_.reduced.data(), static_cast<std::size_t>(count_)};
  }

  // Sorts all contacts and moves λ onto the manifold of its class, into ws.trial.
  void sort(const double* lambda) noexcept {
    std::fill_n(ws_.trial.data(), 3 * s_.contacts, 0.0);
    for (int i = 0; i < s_.contacts; ++i) {
      const double* l = lambda + 3 * i;
      ReducedContact& u = ws_.reduced[count_];
      ws_.mode[i] = u.mode =
          classify(l, ws_.delta.data() + 3 * i, s_.stretch * s_.rho[i], s_.mu[i], s_.limit_of(i), u);
      if (u.mode == ContactMode::limited) ws_.trial[3 * i] = s_.limit_of(i);
      if (u.mode == ContactMode::open || u.mode == ContactMode::limited) continue;
      u.contact = i;
      ++count_;
      double* base = ws_.trial.data() + 3 * i;
      base[0] = u.mode == ContactMode::slip ? u.lambda_n : l[0];
      if (u.mode == ContactMode::stick) std::copy_n(l + 1, 2, base + 1);
      if (u.mode != ContactMode::slip) continue;
      base[1] = s_.mu[i] * u.lambda_n * u.d1;
      base[2] = s_.mu[i] * u.lambda_n * u.d2;
    }
    number();
  }

  bool matches_factor() const noexcept {
    const CoulombFactor& f = ws_.factor;
    return f.version != 0 && f.version == s_.version && f.epsilon == s_.epsilon &&
           f.contacts == s_.contacts && f.size == size_ &&
           std::equal(ws_.mode.begin(), ws_.mode.begin() + s_.contacts, f.mode.begin());
  }

  double flops() const noexcept {
    return BorderedFactor::flops(definite_, border_) + flops_of_assembly * size_ * size_;
  }

  // The Jacobian is symmetric but for the columns of slipping contacts' λ_n, which are e = n + μ d: those are
  // the border, N has n's rows and E has e's.
  bool factor(double shift, bool raw) noexcept {
    CoulombFactor& f = ws_.factor;
    f.version = 0;
    f.jacobian.resize(definite_, border_);
    for (const ReducedContact& u : contacts()) {
      const double* c0 = normal_column(u.contact);
      const double* c1 = c0 + s_.W.outerStride();
      const double* c2 = c1 + s_.W.outerStride();
      const double mu = s_.mu[u.contact];
      const double rho = s_.rho[u.contact], diagonal = rho > 0 ? (s_.epsilon + shift) / rho : 0;
      if (u.mode != ContactMode::slip) {
        if (u.mode == ContactMode::stick) {
          measure_columns<3>(c0, s_.W.outerStride(), u.first);
        } else {
          measure_columns<1>(c0, 0, u.first);
        }
        for (int k = u.first; k < u.first + u.count(); ++k) f.jacobian.column(k)[k] += diagonal;
        continue;
      }
      for (int k = 0; k < 3 * s_.contacts; ++k) ws_.column[k] = u.d1 * c2[k] - u.d2 * c1[k];
      measure_columns<1>(ws_.column.data(), 0, u.turn);
      const double* d = ws_.delta.data() + 3 * u.contact;
      const double slip = -(u.d1 * d[1] + u.d2 * d[2]);
      f.jacobian.column(u.turn)[u.turn] += diagonal + (raw ? u.c : std::max(u.c, slip / (mu * u.lambda_n)));
      double* T = f.jacobian.corner(u.first - definite_);
      const double x = mu * u.d1, y = mu * u.d2;
      for (int j = 0; j < border_; ++j) {
        const int row = 3 * slipping(j).contact;
        T[j] = c0[row] + x * c1[row] + y * c2[row];
      }
      T[u.first - definite_] += diagonal;
    }
    if (!f.jacobian.factor()) return false;
    f.contacts = s_.contacts;
    f.size = size_;
    f.flops = flops();
    f.epsilon = s_.epsilon;
    std::copy_n(ws_.mode.begin(), s_.contacts, f.mode.begin());
    // Within one solve W is the same, whatever its version.
    f.version = s_.version;
    return true;
  }

  void solve() noexcept {
    const double* delta = ws_.delta.data();
    for (int k = 0; k < plain_; ++k) ws_.step[k] = -delta[ws_.row[k]];
    for (int j = 0; j < border_; ++j) {
      const ReducedContact& u = slipping(j);
      const double* d = delta + 3 * u.contact;
      ws_.step[u.turn] = -(u.d1 * d[2] - u.d2 * d[1]);
      ws_.step[u.first] = -d[0];
    }
    ws_.factor.jacobian.solve(ws_.step.data());
  }

  // The contact that the step pulls on hardest, or presses farthest beyond its limit, leaves (of a large
  // system, where each costs an LU, all such); true if there was one.
  bool drop_pulled() noexcept {
    const auto pulled = [&](int k) {
      const ReducedContact& u = ws_.reduced[k];
      const double n = ws_.trial[3 * u.contact] + ws_.step[u.first];
      return u.mode == ContactMode::frictionless ? std::min(n, s_.limit_of(u.contact) - n) : n;
    };
    double least = 0;
    for (int k = 0; k < count_; ++k) least = std::min(least, pulled(k));
    if (least == 0) return false;
    const double bound = size_ > singly ? 0 : least;
    int kept = 0;
    for (int k = 0; k < count_; ++k) {
      const ReducedContact u = ws_.reduced[k];
      const double n = pulled(k);
      if (n >= 0 || n > bound) {
        ws_.reduced[kept++] = u;
        continue;
      }
      double* base = ws_.trial.data() + 3 * u.contact;
      const bool limited = base[0] + ws_.step[u.first] > 0;
      ws_.mode[u.contact] = limited ? ContactMode::limited : ContactMode::open;
      std::fill_n(base, 3, 0.0);
      if (limited) base[0] = s_.limit_of(u.contact);
    }
    count_ = kept;
    number();
    return true;
  }

 private:
  // Unknowns: those of contacts that stick, of frictionless ones; then every τ, then λ_n of those that slip.
  void number() noexcept {
    plain_ = border_ = 0;
    const auto take = [&](ReducedContact& u) {
      u.first = plain_;
      for (int b = 0; b < u.count(); ++b) ws_.row[plain_++] = 3 * u.contact + b;
    };
    for (int k = 0; k < count_; ++k) {
      if (ws_.reduced[k].mode == ContactMode::slip) ws_.slipping[border_++] = k;
      if (ws_.reduced[k].mode == ContactMode::stick) take(ws_.reduced[k]);
    }
    sticking_ = plain_;
    for (int k = 0; k < count_; ++k)
      if (ws_.reduced[k].mode == ContactMode::frictionless) take(ws_.reduced[k]);
    definite_ = plain_ + border_;
    size_ = definite_ + border_;
    for (int j = 0; j < border_; ++j) {
      ReducedContact& u = ws_.reduced[ws_.slipping[j]];
      u.turn = plain_ + j;
      u.first = definite_ + j;
    }
  }

  const ReducedContact& slipping(int j) const noexcept { return ws_.reduced[ws_.slipping[j]]; }

  const double* normal_column(int contact) const noexcept {
    return s_.W.data() + 3 * static_cast<std::ptrdiff_t>(contact) * s_.W.outerStride();
  }

  // Columns k … k + N − 1 of the panel, from g = W p_k … of all contacts' rows, `apart` from one another.
  template <int N>
  void measure_columns(const double* g, std::ptrdiff_t apart, int k) noexcept {
    double* out[N];
    for (int c = 0; c < N; ++c) out[c] = ws_.factor.jacobian.column(k + c);
    const int* row = ws_.row.data();
    int i = BorderedFactor::first_row(k);
    i -= i % 3;
    // Four rows at once, of which the last is written again.
    for (; i + 3 < sticking_; i += 3)
      for (int c = 0; c < N; ++c)
        *reinterpret_cast<Lanes*>(out[c] + i) = *reinterpret_cast<const Lanes*>(g + c * apart + row[i]);
    for (; i < plain_; ++i)
      for (int c = 0; c < N; ++c) out[c][i] = g[c * apart + row[i]];
    for (int j = 0; j < border_; ++j) {
      const ReducedContact& u = slipping(j);
      const double mu = s_.mu[u.contact];
      for (int c = 0; c < N; ++c) {
        const double* at = g + c * apart + 3 * u.contact;
        out[c][plain_ + j] = u.d1 * at[2] - u.d2 * at[1];
        out[c][definite_ + j] = at[0];
        out[c][definite_ + border_ + j] = at[0] + mu * (u.d1 * at[1] + u.d2 * at[2]);
      }
    }
  }

  const CoulombSystem& s_;
  CoulombWorkspace& ws_;
  int count_ = 0;
  int sticking_ = 0;  // unknowns of contacts that stick
  int plain_ = 0;     // … that do not slip
  int border_ = 0;    // contacts that slip
  int definite_ = 0;  // plain_ + border_
  int size_ = 0;
};

}  // namespace

void CoulombSystem::add_contact(int i, const Vec3& change, double* delta) const noexcept {
  columns.ask(i);
  const double* c0 = W.data() + 3 * static_cast<std::ptrdiff_t>(i) * W.outerStride();
  const double* c1 = c0 + W.outerStride();
  const double* c2 = c1 + W.outerStride();
  const double x = change[0], y = change[1], z = change[2];
  const int rows = 3 * contacts;
  for (int k = 0; k < rows; ++k) delta[k] += x * c0[k] + y * c1[k] + z * c2[k];
  for (int k = 0; k < 3; ++k) delta[3 * i + k] += diagonal(i) * change[k];
}

void CoulombSystem::compute_delta(const double* lambda, double* delta) const noexcept {
  std::copy_n(q.data(), 3 * contacts, delta);
  for (int i = 0; anchor && i < contacts; ++i)
    for (int k = 0; k < 3; ++k) delta[3 * i + k] -= diagonal(i) * anchor[3 * i + k];
  for (int i = 0; i < contacts; ++i) {
    const Eigen::Map<const Vec3> l(lambda + 3 * i);
    if (!l.isZero(0)) add_contact(i, l, delta);
  }
}

NewtonStep newton_step(const CoulombSystem& s, const double* lambda, double shift, bool raw, bool fresh,
                       const Deadline& deadline, CoulombWorkspace& ws) noexcept {
  Reduced reduced(s, ws);
  reduced.sort(lambda);
  for (int i = 0; i < s.contacts; ++i) {
    const Vec3 moved =
        Eigen::Map<const Vec3>(ws.trial.data() + 3 * i) - Eigen::Map<const Vec3>(lambda + 3 * i);
    if (!moved.isZero(0)) s.add_contact(i, moved, ws.delta.data());
  }
  NewtonStep result;
  const auto factor = [&] {
    CoulombFactor& f = ws.factor;
    for (const ReducedContact& u : reduced.contacts()) s.columns.ask(u.contact);
    const std::int64_t left = deadline.left();
    const double flops = reduced.flops();
    if (deadline.bounded() && flops * f.ns_per_flop > static_cast<double>(left)) {
      f.ns_per_flop *= forget;  // or one LU that was interrupted would be the last
      result.outcome = NewtonOutcome::no_time;
      return false;
    }
    ++result.factorisations;
    if (!reduced.factor(shift, raw)) {
      result.outcome = NewtonOutcome::singular;
      return false;
    }
    if (deadline.bounded() && flops > 0) {
      const double measured = static_cast<double>(left - deadline.left()) / flops;
      f.ns_per_flop += 0.2 * (std::min(measured, 2 * f.ns_per_flop) - f.ns_per_flop);
    }
    return true;
  };
  if (fresh || !reduced.matches_factor()) {
    if (!factor()) return result;
  }
  for (;;) {
    reduced.solve();
    if (raw || !reduced.drop_pulled()) break;
    s.compute_delta(ws.trial.data(), ws.delta.data());
    if (!factor()) return result;
  }
  for (const ReducedContact& u : reduced.contacts()) {
    double* out = ws.trial.data() + 3 * u.contact;
    const double* steps = ws.step.data();
    Eigen::Map<Vec3>{out} = raw ? linear(u, out, steps, s.mu[u.contact])
                                : stepped(u, out, steps, s.mu[u.contact], s.limit_of(u.contact));
  }
  return result;
}

}  // namespace hapticd
