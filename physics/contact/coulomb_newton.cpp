#include "physics/contact/coulomb_newton.h"

#include <algorithm>
#include <cmath>

#include "physics/contact/small_factors.h"

namespace hapticd {
namespace {

enum class Mode : std::uint8_t { stick, slip, frictionless };

struct Unknowns {
  int contact;
  Mode mode;
  int first;           // its unknowns start here
  Vec3 along;          // slip: (1, μ d), the direction of λ
  Vec3 across;         // slip: (0, t̂)
  double lambda_n = 0;  // slip: at the base point

  int count() const noexcept { return mode == Mode::stick ? 3 : mode == Mode::slip ? 2 : 1; }
  Vec3 trial(int k) const noexcept {  // direction of λ that unknown k moves
    if (mode == Mode::stick) return Vec3::Unit(k);
    return k == 0 ? along : across;
  }
  Vec3 test(int k) const noexcept {  // direction of δ that equation k measures
    if (mode == Mode::slip && k == 1) return across;
    return Vec3::Unit(k);
  }
};

// Sorts one contact by y = λ − ρ δ; false: open.
bool classify(const Vec3& lambda, const Vec3& delta, double rho, double mu, Unknowns& u) noexcept {
  const Vec3 y = lambda - rho * delta;
  if (!(y[0] > 0)) return false;
  const double pulled = y.tail<2>().norm();
  if (mu <= 0) {
    u.mode = Mode::frictionless;
    u.along = Vec3::UnitX();
  } else if (pulled <= mu * y[0]) {
    u.mode = Mode::stick;
  } else {
    u.mode = Mode::slip;
    const Vec3 d(0, y[1] / pulled, y[2] / pulled);
    u.along = Vec3::UnitX() + mu * d;
    u.across = Vec3(0, -d[2], d[1]);
    u.lambda_n = lambda[0] > 0 ? lambda[0] : y[0];
  }
  return true;
}

// λ of one contact after its step, inside its cone.
Vec3 stepped(const Unknowns& u, const double* base, const double* step, double mu) noexcept {
  const Eigen::Map<const Vec3> l(base);
  if (u.mode == Mode::frictionless) return {std::max(0.0, l[0] + step[0]), 0, 0};
  if (u.mode == Mode::slip) {
    const double n = std::max(0.0, u.lambda_n + step[0]);
    if (n == 0) return Vec3::Zero();
    Vec3 d = u.along - Vec3::UnitX() + step[1] / n * u.across;
    d *= mu * n / d.norm();
    return {n, d[1], d[2]};
  }
  Vec3 out = l + Eigen::Map<const Vec3>(step);
  out[0] = std::max(0.0, out[0]);
  const double t = out.tail<2>().norm();
  if (t > mu * out[0]) out.tail<2>() *= mu * out[0] / t;
  return out;
}

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
  for (int i = 0; i < contacts; ++i) {
    const Eigen::Map<const Vec3> l(lambda + 3 * i);
    if (!l.isZero(0)) add_contact(i, l, delta);
  }
}

namespace {

// Assembles and solves for ws.step at the base point ws.trial; ws.delta becomes δ there.
bool solve_reduced(const CoulombSystem& s, std::span<Unknowns> unknown, CoulombWorkspace& ws) noexcept {
  int size = 0;
  for (Unknowns& u : unknown) {
    u.first = size;
    size += u.count();
  }
  s.compute_delta(ws.trial.data(), ws.delta.data());
  for (Unknowns& uj : unknown) {
    const Eigen::Map<const Vec3> delta(ws.delta.data() + 3 * uj.contact);
    for (int b = 0; b < uj.count(); ++b) ws.step[uj.first + b] = -uj.test(b).dot(delta);
    for (const Unknowns& ui : unknown) {
      Mat3 block = s.W.block<3, 3>(3 * ui.contact, 3 * uj.contact);
      if (&ui == &uj) block.diagonal().array() += s.diagonal(uj.contact);
      for (int b = 0; b < uj.count(); ++b) {
        const Vec3 moved = block * uj.trial(b);
        double* column = ws.jacobian.data() + static_cast<std::ptrdiff_t>(uj.first + b) * size;
        for (int a = 0; a < ui.count(); ++a) column[ui.first + a] = ui.test(a).dot(moved);
      }
    }
    if (uj.mode != Mode::slip) continue;
    const double mu = s.mu[uj.contact];
    const double slip = -(uj.along - Vec3::UnitX()).dot(delta) / mu;  // along −d
    ws.jacobian[static_cast<std::size_t>(uj.first + 1) * static_cast<std::size_t>(size + 1)] +=
        std::max(0.0, slip) / (mu * uj.lambda_n);
  }
  return lu_solve(ws.jacobian.data(), size, ws.step.data());
}

// The contact that its step pulls on hardest, or −1.
int most_negative(std::span<const Unknowns> unknown, const CoulombWorkspace& ws) noexcept {
  int worst = -1;
  double least = 0;
  for (std::size_t k = 0; k < unknown.size(); ++k) {
    const double n = ws.trial[3 * unknown[k].contact] + ws.step[unknown[k].first];
    if (n >= least) continue;
    least = n;
    worst = static_cast<int>(k);
  }
  return worst;
}

}  // namespace

bool newton_step(const CoulombSystem& s, const double* lambda, CoulombWorkspace& ws) noexcept {
  // Base point: λ moved onto the manifold of its class, so that δ is exact there.
  std::array<Unknowns, max_contacts> storage;
  int contacts = 0;
  std::fill_n(ws.trial.data(), 3 * s.contacts, 0.0);
  for (int i = 0; i < s.contacts; ++i) {
    const Eigen::Map<const Vec3> l(lambda + 3 * i), d(ws.delta.data() + 3 * i);
    Unknowns& u = storage[contacts];
    if (!classify(l, d, s.rho[i], s.mu[i], u)) continue;
    u.contact = i;
    ++contacts;
    Eigen::Map<Vec3> base(ws.trial.data() + 3 * i);
    if (u.mode == Mode::slip)
      base = u.lambda_n * u.along;
    else
      base = u.mode == Mode::stick ? Vec3(l) : Vec3(l[0], 0, 0);
  }
  for (;;) {
    const std::span<Unknowns> unknown(storage.data(), static_cast<std::size_t>(contacts));
    if (!solve_reduced(s, unknown, ws)) return false;
    const int pulled = most_negative(unknown, ws);
    if (pulled < 0) break;
    Eigen::Map<Vec3>(ws.trial.data() + 3 * storage[pulled].contact).setZero();
    std::copy(storage.begin() + pulled + 1, storage.begin() + contacts, storage.begin() + pulled);
    --contacts;
  }
  for (int k = 0; k < contacts; ++k) {
    const Unknowns& u = storage[k];
    double* out = ws.trial.data() + 3 * u.contact;
    Eigen::Map<Vec3>{out} = stepped(u, out, ws.step.data() + u.first, s.mu[u.contact]);
  }
  return true;
}

}  // namespace hapticd
