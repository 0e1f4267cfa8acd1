#include "tools/chart/solver/contact_sequence.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "physics/contact/rows.h"
#include "physics/contact/solver/coulomb.h"

namespace hapticd {
namespace {

constexpr double rigid_compliance = 1e-3;  // as in delassus.cpp

Primitive ball(double radius, const Vec3& at) {
  Primitive p;
  p.name = "ball";
  p.radius = radius;
  p.placement.p = at + Vec3(0, 0, radius);
  return p;
}

Primitive punch(double radius) {
  Primitive p;
  p.name = "punch";
  p.shape = Shape::cylinder;
  p.radius = radius;
  p.half_length = 5e-3;
  p.placement.p = Vec3(0, 0, 5e-3);
  return p;
}

// Points as dense as it takes for a good part of the contacts to be loaded, most of them where it conforms.
ContactSurface surface_for(ContactCase kind, int contacts) {
  const int size = contacts <= 10 ? 0 : contacts <= 30 ? 1 : contacts <= 100 ? 2 : 3;
  constexpr int round[] = {2, 3, 5, 6}, blunt[] = {2, 2, 2, 4}, few[] = {1, 2, 3, 5};
  switch (kind) {
    case ContactCase::blunt:
      return lens_surface(blunt[size]);
    case ContactCase::flat:
      return block_surface(size < 2 ? 6 : 10, size < 3 ? 1 : 2);
    case ContactCase::duplicates:
      return repeated(lens_surface(few[size]), 3);
    case ContactCase::two_bodies:
      return pair_of(lens_surface(few[size] + 1), 4e-3);
    case ContactCase::rigid:
      return rigid_plane(5e-3, 1 + static_cast<int>(std::sqrt(contacts)));
    case ContactCase::ill_conditioned:
      return lens_surface(5);
    case ContactCase::flat_stale:
      return block_surface(8, 2);
    case ContactCase::wedge:
    case ContactCase::badly_scaled:
      return {};
    default:
      return lens_surface(round[size]);
  }
}

}  // namespace

const std::vector<std::string>& contact_case_names() {
  static const std::vector<std::string> names = {
      "round", "blunt",           "flat",       "duplicates", "two_bodies",
      "rigid", "ill_conditioned", "flat_stale", "wedge",      "badly_scaled"};
  return names;
}

ContactSequence::ContactSequence(const SequenceSettings& settings)
    : settings_(settings),
      width_(settings.friction ? 3 : 1),
      surface_(surface_for(settings.kind, settings.contacts)),
      random_(settings.seed) {
  double stiffness = 50, radius = 0.6e-3;
  reach_ = 1e-3;
  switch (settings.kind) {
    case ContactCase::blunt:
      instrument_.primitives = {ball(4e-3, Vec3::Zero())};
      break;
    case ContactCase::ill_conditioned:
      instrument_.primitives = {ball(4e-3, Vec3::Zero())};
      stiffness = 2;
      break;
    case ContactCase::flat:
    case ContactCase::flat_stale:
    case ContactCase::rigid:
      reach_ = 3.4e-3;
      instrument_.primitives = {punch(reach_)};
      break;
    case ContactCase::two_bodies:
      instrument_.primitives = {ball(radius, Vec3(-2e-3, 0, 0)), ball(radius, Vec3(2e-3, 0, 0))};
      reach_ = 2e-3;
      break;
    case ContactCase::wedge:
      reach_ = 2e-3;
      break;
    case ContactCase::badly_scaled:
      reach_ = 1;
      break;
    default:
      instrument_.primitives = {ball(radius, Vec3::Zero())};
  }
  K_inv_.head<3>().setConstant(1 / stiffness);
  K_inv_.tail<3>().setConstant(1 / (stiffness * 25e-6));  // its force at 5 mm
  x_ = surface_.x;
  before_.assign(surface_.points.size(), -1);
  anchor_.assign(surface_.points.size(), Vec3::Zero());
  anchored_.assign(surface_.points.size(), false);
}

double ContactSequence::length(const Vec6& w) const {
  return std::sqrt(w.head<3>().squaredNorm() + w.tail<3>().squaredNorm() / (reach_ * reach_));
}

Vec3 ContactSequence::place(const std::vector<Vec3>& x, int point) const {
  const SurfacePoint& p = surface_.points[point];
  if (p.node[0] < 0) return p.fixed;
  return p.weight[0] * x[p.node[0]] + p.weight[1] * x[p.node[1]] + p.weight[2] * x[p.node[2]];
}

void ContactSequence::new_stroke() {
  constexpr double mus[] = {0.1, 0.3, 0.5, 0.8, 1.2, 2.0};
  const bool punched = settings_.kind == ContactCase::flat || settings_.kind == ContactCase::flat_stale ||
                       settings_.kind == ContactCase::rigid;
  const double span = punched ? 0.25e-3 : 0.8e-3;
  const auto point = [&] { return Vec3(between(random_, -span, span), between(random_, -span, span), 0); };
  stroke_.from = point();
  stroke_.to = point();
  const double deepest = settings_.kind == ContactCase::rigid ? 0.1e-3 : punched ? 0.3e-3 : 0.5e-3;
  stroke_.depth = between(random_, 0.4, 1) * deepest;
  stroke_.turn = between(random_, -1, 1) * (punched ? 0.01 : 0.1);
  const double angle = between(random_, 0, 2 * std::numbers::pi);
  stroke_.cycles = between(random_, 0.5, 3);
  stroke_.axis = Vec3(std::cos(angle), std::sin(angle), between(random_, -1, 1)).normalized();
  stroke_.mu = settings_.friction ? mus[(step_ / settings_.steps_per_stroke) % 6] : 0;
}

// Down and up as sin², to and fro, a turn, and a tremor of a micrometre at 9 Hz.
Pose ContactSequence::device(int step) const {
  const double s = static_cast<double>(step % settings_.steps_per_stroke) / settings_.steps_per_stroke;
  const double t = 1e-3 * step;
  const double press = std::pow(std::sin(std::numbers::pi * s), 2);
  Pose X;
  X.q = Quat(Eigen::AngleAxisd(stroke_.turn * std::sin(2 * std::numbers::pi * s), stroke_.axis));
  const double along = 0.5 - 0.5 * std::cos(2 * std::numbers::pi * stroke_.cycles * s);
  X.p = surface_.centre + stroke_.from + along * (stroke_.to - stroke_.from);
  const double tremor = 1e-6 * std::sin(2 * std::numbers::pi * 9 * t);
  // The height where the undeformed surface is just touched.
  for (int k = 0; k < 4; ++k) {
    double least = 1;
    for (int i = 0; i < static_cast<int>(surface_.points.size()); ++i)
      least = std::min(least, gap_at(instrument_, X, place(surface_.x, i)).distance);
    X.p.z() -= least;
  }
  X.p.z() += tremor + 0.05e-3 - (stroke_.depth + 0.05e-3) * press;
  return X;
}

void ContactSequence::linearise() {
  X_lin_ = step_ % settings_.steps_per_stroke == 0 ? X_ : X_instrument_;
  std::fill(before_.begin(), before_.end(), -1);
  for (std::size_t i = 0; i < contact_.size(); ++i) before_[contact_[i].point] = static_cast<int>(i);

  std::vector<Contact> all;
  for (int k = 0; k < static_cast<int>(surface_.points.size()); ++k) {
    const Vec3 s = place(x_, k);
    const Gap gap = gap_at(instrument_, X_lin_, s);
    all.push_back({k, contact_frame(gap.normal), s - X_lin_.p, gap.distance});
  }
  std::stable_sort(all.begin(), all.end(), [](const Contact& a, const Contact& b) { return a.gap < b.gap; });
  all.resize(static_cast<std::size_t>(settings_.contacts));
  std::sort(all.begin(), all.end(), [](const Contact& a, const Contact& b) { return a.point < b.point; });
  contact_ = std::move(all);

  H_ = MatX::Zero(rows(), 3 * surface_.x.size());
  J_.resize(rows(), 6);
  for (int i = 0; i < settings_.contacts; ++i) {
    const Contact& c = contact_[i];
    const SurfacePoint& p = surface_.points[c.point];
    for (int r = 0; r < width_; ++r) {
      const Vec3 f = c.frame.col(r);
      J_.row(width_ * i + r) << -f.transpose(), -c.arm.cross(f).transpose();
      if (p.node[0] < 0) continue;
      for (int a = 0; a < 3; ++a)
        H_.block<1, 3>(width_ * i + r, 3 * p.node[a]) += p.weight[a] * f.transpose();
    }
  }
  W_raw_ = J_ * K_inv_.asDiagonal() * J_.transpose();
  if (!surface_.x.empty()) W_raw_ += H_ * surface_.C * H_.transpose();
  W_raw_ = 0.5 * (W_raw_ + W_raw_.transpose()).eval();
  W_ = W_raw_;
  if (settings_.kind == ContactCase::rigid && settings_.friction)
    for (int i = 0; i < settings_.contacts; ++i)
      W_.diagonal().segment<3>(3 * i).array() +=
          rigid_compliance * W_raw_.diagonal().segment<3>(3 * i).mean();
  mu_.assign(static_cast<std::size_t>(settings_.contacts), stroke_.mu);
  ++version_;
}

void ContactSequence::measure_gap() {
  const VecX shift = J_ * difference(X_, X_lin_);
  q_.resize(rows());
  for (int i = 0; i < settings_.contacts; ++i) {
    const Contact& c = contact_[i];
    const Vec3 s = X_lin_.p + c.arm, s_free = place(surface_.x, c.point);
    if (!anchored_[c.point]) anchor_[c.point] = X_lin_.to_local(s);
    anchored_[c.point] = true;
    Vec3 delta = c.frame.transpose() * (s_free - X_lin_.to_world(anchor_[c.point]));
    delta[0] = c.gap + c.frame.col(0).dot(s_free - s);
    for (int r = 0; r < width_; ++r) q_[width_ * i + r] = delta[r] + shift[width_ * i + r];
  }
}

// The reference's forces move surface and instrument, and what slid takes a new anchor.
void ContactSequence::absorb(const VecX& reference) {
  x_ = surface_.x;
  if (!x_.empty()) {
    const VecX u = surface_.C * (H_.transpose() * reference);
    for (std::size_t n = 0; n < x_.size(); ++n) x_[n] += u.segment<3>(3 * n);
  }
  X_instrument_ = displaced(X_, K_inv_.cwiseProduct(wrench(reference)));
  const Vec6 moved = difference(X_instrument_, X_lin_);
  std::fill(anchored_.begin(), anchored_.end(), false);
  const VecX delta = W_ * reference + q_;
  for (int i = 0; i < settings_.contacts; ++i) {
    const Contact& c = contact_[i];
    bool sticks = false;
    if (width_ == 3 && reference[3 * i] > 0) {
      const Vec3 l = reference.segment<3>(3 * i);
      sticks = l.tail<2>().norm() <= inside_the_cone * mu_[i] * l[0] ||
               delta.segment<2>(3 * i + 1).norm() <=
                   sticking_slip * W_.block<3, 3>(3 * i, 3 * i).trace() / 3 * l.norm();
    }
    if (!sticks)
      anchor_[c.point] = X_lin_.to_local(place(x_, c.point) - moved.head<3>() - moved.tail<3>().cross(c.arm));
    anchored_[c.point] = true;
  }
}

bool ContactSequence::drawn() const {
  return settings_.kind == ContactCase::wedge || settings_.kind == ContactCase::badly_scaled;
}

void ContactSequence::draw() {
  const int into = step_ % settings_.steps_per_linearisation;
  relinearised_ = into == 0;
  if (relinearised_) {
    DrawnContacts d = settings_.kind == ContactCase::wedge
                          ? draw_wedge(random_, settings_.contacts, width_)
                          : draw_badly_scaled(random_, settings_.contacts, width_);
    J_ = std::move(d.J);
    W_ = W_raw_ = std::move(d.W);
    q_drawn_ = std::move(d.q);
    motion_ = std::move(d.motion);
    mu_ = std::move(d.mu);
    ++version_;
  }
  q_ = q_drawn_ + static_cast<double>(into) / settings_.steps_per_linearisation * motion_;
}

void ContactSequence::advance(const VecX& reference) {
  if (drawn()) {
    ++step_;
    return draw();
  }
  if (step_ >= 0) absorb(reference);
  ++step_;
  const bool begins = step_ % settings_.steps_per_stroke == 0;
  if (begins) {
    new_stroke();
    x_ = surface_.x;
    std::fill(anchored_.begin(), anchored_.end(), false);
  }
  X_ = device(step_);
  relinearised_ = begins || step_ % settings_.steps_per_linearisation == 0;
  if (relinearised_) linearise();
  measure_gap();
}

void ContactSequence::carry(VecX& lambda) const {
  if (!relinearised_) return;
  const VecX old = lambda;
  lambda = VecX::Zero(rows());
  if (old.size() != lambda.size() || drawn()) return;
  for (int i = 0; i < settings_.contacts; ++i)
    if (const int k = before_[contact_[i].point]; k >= 0)
      lambda.segment(width_ * i, width_) = old.segment(width_ * k, width_);
}

}  // namespace hapticd
