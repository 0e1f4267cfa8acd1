#include "tools/chart/tissue/tissue_analytic.h"

#include <array>
#include <cmath>
#include <numbers>

namespace hapticd {

namespace {

constexpr double pi = std::numbers::pi;

// Classical Runge–Kutta from 0 to `length`.
template <int N, class Slope>
std::array<double, N> integrated(std::array<double, N> y, double length, int steps, Slope slope) {
  const double ds = length / steps;
  const auto ahead = [](const std::array<double, N>& from, const std::array<double, N>& k, double by) {
    std::array<double, N> out;
    for (int i = 0; i < N; ++i) out[i] = from[i] + by * k[i];
    return out;
  };
  for (int step = 0; step < steps; ++step) {
    const auto k1 = slope(y), k2 = slope(ahead(y, k1, ds / 2)), k3 = slope(ahead(y, k2, ds / 2)),
               k4 = slope(ahead(y, k3, ds));
    for (int i = 0; i < N; ++i) y[i] += ds / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
  }
  return y;
}

// Bisection; f changes sign between low and high.
template <class F>
double root(F f, double low, double high) {
  const bool rising = f(low) < 0;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    ((f(middle) < 0) == rising ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

Beam rectangular_beam(double length, double width, double height, double young, double density) {
  const double area = width * height;
  return {length, young * width * std::pow(height, 3) / 12, 5.0 / 6 * young / 2 * area, young * area,
          density * area};
}

double timoshenko_tip(const Beam& b, double force) {
  return force * std::pow(b.length, 3) / (3 * b.bending) + force * b.length / b.shear;
}

TipPlace elastica_tip(const Beam& b, double force) {
  // The force in every section is (0, −P). y = x, z, θ (turn of the section, downward), moment.
  const auto tip = [&](double moment) {
    const auto slope = [&](const std::array<double, 4>& y) {
      const double c = std::cos(y[2]), s = std::sin(y[2]);
      const double along = 1 + force * s / b.axial;  // t = (c, −s), N = (0, −P)·t = P s
      const double across = force * c / b.shear;     // n = (−s, −c), V = (0, −P)·n = P c
      const double dx = along * c - across * s, dz = -along * s - across * c;
      return std::array<double, 4>{dx, dz, y[3] / b.bending, -force * dx};
    };
    return integrated<4>({0, 0, 0, moment}, b.length, 2000, slope);
  };
  // The moment at the support is P times where the tip is: between none and the whole length.
  const double moment = root([&](double m) { return tip(m)[3]; }, 0, 1.5 * force * b.length);
  const auto end = tip(moment);
  return {b.length - end[0], -end[1]};
}

double timoshenko_frequency(const Beam& b, double rotary_inertia) {
  // y = w, φ, moment, shear force, per e^{iωt}: w' = φ + V/κGA, φ' = M/EI, M' = −V − ρI ω² φ, V' = −m ω² w.
  const auto free_end = [&](double omega) {
    const auto slope = [&](const std::array<double, 4>& y) {
      return std::array<double, 4>{y[1] + y[3] / b.shear, y[2] / b.bending,
                                   -y[3] - rotary_inertia * omega * omega * y[1],
                                   -b.mass * omega * omega * y[0]};
    };
    const auto p = integrated<4>({0, 0, 1, 0}, b.length, 2000, slope);
    const auto q = integrated<4>({0, 0, 0, 1 / b.length}, b.length, 2000, slope);
    return p[2] * q[3] - p[3] * q[2];
  };
  const double slender = 3.516015 * std::sqrt(b.bending / (b.mass * std::pow(b.length, 4)));
  return root(free_end, 0.3 * slender, 1.2 * slender);
}

double square_torsion() {
  double sum = 0;
  for (int k = 1; k < 60; k += 2) sum += std::tanh(k * pi / 2) / std::pow(k, 5);
  return 1.0 / 3 - 64 / std::pow(pi, 5) * sum;
}

Vec3 boussinesq(const Vec3& x, double force, double young, double poisson) {
  const double G = young / (2 * (1 + poisson));
  const double depth = -x.z(), r = std::hypot(x.x(), x.y()), R = x.norm();
  const double scale = force / (4 * pi * G);
  const double sideways = scale * (r * depth / (R * R * R) - (1 - 2 * poisson) * r / (R * (R + depth)));
  const double down = scale * (depth * depth / (R * R * R) + 2 * (1 - poisson) / R);
  if (r == 0) return {0, 0, -down};
  return {sideways * x.x() / r, sideways * x.y() / r, -down};
}

double hertz_force(double depth, double radius, double young, double poisson) {
  return 4.0 / 3 * young / (1 - poisson * poisson) * std::sqrt(radius * std::pow(depth, 3));
}

double pressed_circle(double pressure, double radius, double young, double poisson) {
  return 2 * (1 - poisson * poisson) * pressure * radius / young;
}

double lame_inner(double pressure, double a, double b, double young, double poisson) {
  return (1 + poisson) / young * pressure * a * a / (b * b - a * a) * ((1 - 2 * poisson) * a + b * b / a);
}

}  // namespace hapticd
