// Newton of rotation.h on several matrices side by side, so that the compiler may use vector registers.
#include <algorithm>
#include <cmath>

#include "physics/tissue/rotation.h"

namespace hapticd {

namespace {

constexpr int lanes = element_lanes;
constexpr int newton_steps = 5;      // a warm start needs two or three
constexpr double definite = 1e-9;    // as in rotation.cpp
constexpr double converged = 1e-16;  // ‖δ‖²; the error left is its square

// One step of Newton–Schulz: squares the distance of R from orthogonality.
void orthonormalise(Lanes3x3& R) noexcept {
  for (int l = 0; l < lanes; ++l) {
    double g[3][3];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j <= i; ++j) {
        double dot = 0;
        for (int k = 0; k < 3; ++k) dot += R.m[3 * i + k][l] * R.m[3 * j + k][l];
        g[i][j] = g[j][i] = (i == j ? 1.5 : 0.0) - 0.5 * dot;
      }
    for (int k = 0; k < 3; ++k) {
      const double r[3] = {R.m[k][l], R.m[3 + k][l], R.m[6 + k][l]};
      for (int j = 0; j < 3; ++j) R.m[3 * j + k][l] = r[0] * g[0][j] + r[1] * g[1][j] + r[2] * g[2][j];
    }
  }
}

// R ← R exp(δ×) on each lane. `squared` gets ‖δ‖², or infinity where the step cannot be trusted; `value` is
// tr(RᵀF) before the step, of the step before on entry.
void newton_step(const Lanes3x3& F, const double* size, Lanes3x3& R, double* value,
                 double* squared) noexcept {
  for (int l = 0; l < lanes; ++l) {
    double a[3][3];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        double dot = 0;
        for (int k = 0; k < 3; ++k) dot += R.m[3 * i + k][l] * F.m[3 * j + k][l];
        a[i][j] = dot;
      }
    const double w0 = a[2][1] - a[1][2], w1 = a[0][2] - a[2][0], w2 = a[1][0] - a[0][1];
    const double h10 = -0.5 * (a[1][0] + a[0][1]);
    const double h20 = -0.5 * (a[2][0] + a[0][2]);
    const double h21 = -0.5 * (a[2][1] + a[1][2]);
    const double d0 = a[1][1] + a[2][2];
    const double l10 = h10 / d0, l20 = h20 / d0;
    const double d1 = a[0][0] + a[2][2] - l10 * h10;
    const double l21 = (h21 - l20 * h10) / d1;
    const double d2 = a[0][0] + a[1][1] - l20 * h20 - l21 * l21 * d1;
    const double y1 = w1 - l10 * w0;
    const double z = (w2 - l20 * w0 - l21 * y1) / d2;
    const double y = y1 / d1 - l21 * z;
    const double x = w0 / d0 - l10 * y - l20 * z;

    const double trace = a[0][0] + a[1][1] + a[2][2];
    const double length = x * x + y * y + z * z;
    const double least = std::min(std::min(d0, d1), d2);
    // Comparisons are false for NaN.
    const bool trusted =
        (least > definite * size[l]) & (trace >= value[l] - 1e-12 * size[l]) & (length < 1.0);
    value[l] = trace;
    squared[l] = trusted ? length : HUGE_VAL;

    const double qx = 0.5 * x, qy = 0.5 * y, qz = 0.5 * z;
    const double q2 = qx * qx + qy * qy + qz * qz;
    const double s = 2.0 / (1.0 + q2);
    const double t[3][3] = {{1 + s * (qx * qx - q2), s * (qx * qy - qz), s * (qx * qz + qy)},
                            {s * (qx * qy + qz), 1 + s * (qy * qy - q2), s * (qy * qz - qx)},
                            {s * (qx * qz - qy), s * (qy * qz + qx), 1 + s * (qz * qz - q2)}};
    for (int k = 0; k < 3; ++k) {
      const double r[3] = {R.m[k][l], R.m[3 + k][l], R.m[6 + k][l]};
      for (int j = 0; j < 3; ++j) R.m[3 * j + k][l] = r[0] * t[0][j] + r[1] * t[1][j] + r[2] * t[2][j];
    }
  }
}

}  // namespace

void nearest_rotations(const Lanes3x3& F, std::array<Mat3*, element_lanes> R) noexcept {
  Lanes3x3 r;
  double size[lanes], value[lanes], squared[lanes];
  for (int l = 0; l < lanes; ++l) {
    r.set(l, R[l]->data());
    double sum = 0;
    for (int k = 0; k < 9; ++k) sum += F.m[k][l] * F.m[k][l];
    size[l] = std::sqrt(sum);
    value[l] = -2 * size[l];
    squared[l] = 0;
  }
  orthonormalise(r);
  double worst = HUGE_VAL;
  bool trusted[lanes];
  std::fill_n(trusted, lanes, true);
  for (int step = 0; step < newton_steps && worst > converged; ++step) {
    newton_step(F, size, r, value, squared);
    worst = 0;
    for (int l = 0; l < lanes; ++l) {
      trusted[l] = trusted[l] && squared[l] < 1.0;
      if (trusted[l]) worst = std::max(worst, squared[l]);
    }
  }
  for (int l = 0; l < lanes; ++l) {
    if (!trusted[l] || !(squared[l] <= converged))
      *R[l] = nearest_rotation(F.matrix(l), *R[l]);
    else
      *R[l] = r.matrix(l);
  }
}

}  // namespace hapticd
