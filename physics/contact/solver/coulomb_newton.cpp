#include "physics/contact/solver/coulomb_newton.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "physics/contact/solver/small_factors.h"

namespace hapticd {
namespace {

constexpr int singly = 60;  // unknowns up to which contacts leave one by one
constexpr double forget = 0.95;
constexpr double flops_of_assembly = 12;  // per entry, in LU flops

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
Vec3 linear(const ReducedContact& u, const double* base, const double* step, double mu) noexcept {
  if (u.mode == ContactMode::frictionless) return {base[0] + step[0], 0, 0};
  if (u.mode == ContactMode::stick) return {base[0] + step[0], base[1] + step[1], base[2] + step[2]};
  const double n = u.lambda_n + step[0], turn = step[1] / mu;
  return {n, mu * (n * u.d1 - turn * u.d2), mu * (n * u.d2 + turn * u.d1)};
}

// λ of one contact after its step, inside its cone.
Vec3 stepped(const ReducedContact& u, const double* base, const double* step, double mu,
             double limit) noexcept {
  if (u.mode == ContactMode::frictionless) return {std::clamp(base[0] + step[0], 0.0, limit), 0, 0};
  if (u.mode == ContactMode::slip) {
    const double n = std::max(0.0, u.lambda_n + step[0]);
    if (n == 0) return Vec3::Zero();
    const double turn = step[1] / (mu * n);
    Eigen::Vector2d d(u.d1 - turn * u.d2, u.d2 + turn * u.d1);
    d *= mu * n / d.norm();
    return {n, d[0], d[1]};
  }
  Vec3 out(std::max(0.0, base[0] + step[0]), base[1] + step[1], base[2] + step[2]);
  const double t = out.tail<2>().norm();
  if (t > mu * out[0]) out.tail<2>() *= mu * out[0] / t;
  return out;
}

// δ's part that equation k of one contact measures.
inline void measure(const ReducedContact& u, const double* g, double* out) noexcept {
  const double* at = g + 3 * u.contact;
  double* to = out + u.first;
  to[0] = at[0];
  if (u.mode == ContactMode::stick) {
    to[1] = at[1];
    to[2] = at[2];
  } else if (u.mode == ContactMode::slip) {
    to[1] = u.d1 * at[2] - u.d2 * at[1];
  }
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

  double flops() const noexcept { return size_ * (size_ * (2.0 / 3 * size_ + flops_of_assembly)); }

  bool factor(double shift, bool raw) noexcept {
    CoulombFactor& f = ws_.factor;
    f.version = 0;
    const int ld = padded(size_);
    for (const ReducedContact& u : contacts()) {
      const double* c0 = s_.W.data() + 3 * static_cast<std::ptrdiff_t>(u.contact) * s_.W.outerStride();
      const double* c1 = c0 + s_.W.outerStride();
      const double* c2 = c1 + s_.W.outerStride();
      const double mu = s_.mu[u.contact];
      const double rho = s_.rho[u.contact], diagonal = rho > 0 ? (s_.epsilon + shift) / rho : 0;
      for (int b = 0; b < u.count(); ++b) {
        double* out = f.lu.data() + static_cast<std::ptrdiff_t>(u.first + b) * ld;
        const double* g = b == 0 ? c0 : b == 1 ? c1 : c2;
        if (u.mode == ContactMode::slip) {
          combine(b == 0 ? c0 : nullptr, c1, c2, b == 0 ? mu * u.d1 : -u.d2, b == 0 ? mu * u.d2 : u.d1);
          g = ws_.column.data();
        }
        for (const ReducedContact& v : contacts()) measure(v, g, out);
        std::fill(out + size_, out + ld, 0.0);
        out[u.first + b] += diagonal;
      }
      if (u.mode != ContactMode::slip) continue;
      const double* d = ws_.delta.data() + 3 * u.contact;
      const double slip = -(u.d1 * d[1] + u.d2 * d[2]);
      f.lu[static_cast<std::size_t>(u.first + 1) * static_cast<std::size_t>(ld + 1)] +=
          raw ? u.c : std::max(u.c, slip / (mu * u.lambda_n));
    }
    if (!lu_factor(f.lu.data(), size_, f.pivot.data())) return false;
    double least = std::numeric_limits<double>::infinity(), largest = 0;
    for (int k = 0; k < size_; ++k) {
      const double pivot = std::abs(f.lu[static_cast<std::size_t>(k) * static_cast<std::size_t>(ld + 1)]);
      least = std::min(least, pivot);
      largest = std::max(largest, pivot);
    }
    f.pivot_ratio = largest > 0 ? least / largest : 1;
    f.contacts = s_.contacts;
    f.size = size_;
    f.epsilon = s_.epsilon;
    std::copy_n(ws_.mode.begin(), s_.contacts, f.mode.begin());
    // Within one solve W is the same, whatever its version.
    f.version = s_.version;
    return true;
  }

  void solve() noexcept {
    for (const ReducedContact& u : contacts()) measure(u, ws_.delta.data(), ws_.step.data());
    for (int k = 0; k < size_; ++k) ws_.step[k] = -ws_.step[k];
    lu_solve(ws_.factor.lu.data(), size_, ws_.factor.pivot.data(), ws_.step.data());
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
  void number() noexcept {
    size_ = 0;
    for (int k = 0; k < count_; ++k) {
      ws_.reduced[k].first = size_;
      size_ += ws_.reduced[k].count();
    }
  }

  // column = [c0 +] x c1 + y c2
  void combine(const double* c0, const double* c1, const double* c2, double x, double y) noexcept {
    const int rows = 3 * s_.contacts;
    double* g = ws_.column.data();
    if (c0) {
      for (int k = 0; k < rows; ++k) g[k] = c0[k] + x * c1[k] + y * c2[k];
    } else {
      for (int k = 0; k < rows; ++k) g[k] = x * c1[k] + y * c2[k];
    }
  }

  const CoulombSystem& s_;
  CoulombWorkspace& ws_;
  int count_ = 0;
  int size_ = 0;
};

}  // namespace

void CoulombSystem::add_contact(int i, const Vec3& change, double* delta) const noexcept {
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
  s.compute_delta(ws.trial.data(), ws.delta.data());
  NewtonStep result;
  const auto factor = [&] {
    CoulombFactor& f = ws.factor;
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
    const double* step = ws.step.data() + u.first;
    Eigen::Map<Vec3>{out} = raw ? linear(u, out, step, s.mu[u.contact])
                                : stepped(u, out, step, s.mu[u.contact], s.limit_of(u.contact));
  }
  return result;
}

}  // namespace hapticd
