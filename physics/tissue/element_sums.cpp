// What is summed over all live tetrahedra in every step: forces, stiffness times a motion, least volumes.
#include <algorithm>
#include <limits>

#include "physics/tissue/element_lanes.h"

namespace hapticd {

namespace {

auto positions(const TissueState& state) noexcept {
  return [x = state.x.data()](int n) { return x[n].data(); };
}

void clear_fixed(const TissueModel& model, Eigen::Ref<VecX> f) noexcept {
  model.each_node([&](int n) {
    if (model.fixed[n]) f.segment<3>(3 * n).setZero();
  });
}

struct Eight {
  Lanes3x4 g;
  Lanes3x3 R;
  double volume[element_lanes], mu[element_lanes], lambda[element_lanes];

  Eight(const TissueModel& model, const TissueState& state, const int* tet) noexcept {
    load_gradients(model, tet, g);
    for (int l = 0; l < element_lanes; ++l) {
      R.set(l, state.rotation[tet[l]].data());
      volume[l] = volume_left(model, state, tet[l]);
      mu[l] = model.elastic[tet[l]].mu;
      lambda[l] = model.elastic[tet[l]].lambda;
    }
  }
};

// P = −V (2μ (F − R) + λ (tr(RᵀF) − 3) R); F is made symmetric first where it is linear tissue's.
void stresses(const TissueModel& model, const Eight& of, Lanes3x3& F, Lanes3x3& P) noexcept {
  for (int j = 0; !model.corotational && j < 3; ++j)
    for (int i = 0; i < j; ++i)
      for (int l = 0; l < element_lanes; ++l)
        F.m[3 * j + i][l] = F.m[3 * i + j][l] = 0.5 * (F.m[3 * j + i][l] + F.m[3 * i + j][l]);
  for (int l = 0; l < element_lanes; ++l) {
    double trace = 0;
    for (int k = 0; k < 9; ++k) trace += of.R.m[k][l] * F.m[k][l];
    const double along = -of.volume[l] * (of.lambda[l] * (trace - 3) - 2 * of.mu[l]),
                 of_F = -of.volume[l] * 2 * of.mu[l];
    for (int k = 0; k < 9; ++k) P.m[k][l] = of_F * F.m[k][l] + along * of.R.m[k][l];
  }
}

// P −= s V (μ (G + R Gᵀ R) + λ tr(RᵀG) R): what the law linearised at R answers to a motion of gradient G.
void subtract_linear(const Eight& of, double s, const Lanes3x3& G, Lanes3x3& P) noexcept {
  const auto& R = of.R.m;
  for (int l = 0; l < element_lanes; ++l) {
    double trace = 0;
    for (int k = 0; k < 9; ++k) trace += R[k][l] * G.m[k][l];
    double A[3][3];  // Gᵀ R
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        A[i][j] = G.m[3 * i][l] * R[3 * j][l] + G.m[3 * i + 1][l] * R[3 * j + 1][l] +
                  G.m[3 * i + 2][l] * R[3 * j + 2][l];
    const double of_G = s * of.volume[l] * of.mu[l], along = s * of.volume[l] * of.lambda[l] * trace;
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) {
        const double turned = R[i][l] * A[0][j] + R[3 + i][l] * A[1][j] + R[6 + i][l] * A[2][j];
        P.m[3 * j + i][l] -= of_G * (G.m[3 * j + i][l] + turned) + along * R[3 * j + i][l];
      }
  }
}

auto motion(const VecX& dx) noexcept {
  return [x = dx.data()](int n) { return x + 3 * static_cast<std::ptrdiff_t>(n); };
}

// What is not a number stays.
double lesser(double a, double b) noexcept { return (b >= a) | (a != a) ? a : b; }

// f += f_int(x) where `at_x`, − s K dx where there is a motion.
void sum_forces(const TissueModel& model, const TissueState& state, bool at_x, const VecX* dx, double s,
                Eigen::Ref<VecX> f) noexcept {
  each_eight(model, state, [&](const int* tet, int count) {
    const Eight of(model, state, tet);
    Lanes3x4 x;
    Lanes3x3 F, P{};
    if (at_x) {
      load_corners(model, tet, positions(state), x);
      deformation_gradients(x, of.g, F);
      stresses(model, of, F, P);
    }
    if (dx) {
      load_corners(model, tet, motion(*dx), x);
      deformation_gradients(x, of.g, F);
      subtract_linear(of, s, F, P);
    }
    add_forces(model, tet, count, P, of.g, f.data());
  });
  for (const Collapsed& c : state.collapsed)
    for (int a = 0; at_x && state.alive[c.tet] && a < 4; ++a)
      f.segment<3>(3 * c.node[a]) += c.force * c.push.col(a);
  for (std::size_t n = 0; n < model.springs.size(); ++n) {
    const auto i = static_cast<Eigen::Index>(3 * n);
    const NodeSpring& spring = model.springs[n];
    if (state.live_tets_of_node[n] == 0) continue;
    if (at_x) f.segment<3>(i) -= spring.stiffness * (state.x[n] - spring.anchor);
    if (dx) f.segment<3>(i) -= s * spring.stiffness * dx->segment<3>(i);
  }
  if (!model.condensed) return;
  if (at_x) model.condensed->add_forces(state, f);
  if (dx) model.condensed->subtract_stiffness(*dx, s, f);
}

}  // namespace

void internal_forces(const TissueModel& model, const TissueState& state, Eigen::Ref<VecX> f) noexcept {
  f.setZero();
  sum_forces(model, state, true, nullptr, 0, f);
  clear_fixed(model, f);
}

void internal_forces(const TissueModel& model, const TissueState& state, const VecX& dx, double s,
                     Eigen::Ref<VecX> f) noexcept {
  f.setZero();
  sum_forces(model, state, true, &dx, s, f);
  clear_fixed(model, f);
}

void subtract_stiffness(const TissueModel& model, const TissueState& state, const VecX& dx, double s,
                        Eigen::Ref<VecX> f) noexcept {
  sum_forces(model, state, false, &dx, s, f);
}

double least_volume(const TissueModel& model, const TissueState& state, const VecX* dx) noexcept {
  double least[element_lanes];
  std::fill_n(least, element_lanes, std::numeric_limits<double>::infinity());
  each_eight(model, state, [&](const int* tet, int) {
    Lanes3x4 x, moved;
    load_corners(model, tet, positions(state), x);
    if (dx) {
      load_corners(model, tet, motion(*dx), moved);
      for (int k = 0; k < 12; ++k)
        for (int l = 0; l < element_lanes; ++l) x.m[k][l] += moved.m[k][l];
    }
    for (int l = 0; l < element_lanes; ++l) {
      double e[3][3];
      for (int a = 0; a < 3; ++a)
        for (int i = 0; i < 3; ++i) e[a][i] = x.m[3 * (a + 1) + i][l] - x.m[i][l];
      const double six = (e[0][1] * e[1][2] - e[0][2] * e[1][1]) * e[2][0] +
                         (e[0][2] * e[1][0] - e[0][0] * e[1][2]) * e[2][1] +
                         (e[0][0] * e[1][1] - e[0][1] * e[1][0]) * e[2][2];
      least[l] = lesser(least[l], six);
    }
  });
  double all = least[0];
  for (const double v : least) all = lesser(all, v);
  return all / 6;
}

}  // namespace hapticd
