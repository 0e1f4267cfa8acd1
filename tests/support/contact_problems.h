// Seeded random contact problems: matrices as contact makes them, and whole patches of tissue.
//
// Units: m, N. Everything is a function of the generator's state alone.
#pragma once

#include <memory>
#include <random>
#include <vector>

#include "physics/contact/contact_solve.h"

namespace hapticd {

using Random = std::mt19937_64;

double uniform(Random& random, double low, double high);
double normal(Random& random);
Vec3 unit_vector(Random& random);
Quat random_rotation(Random& random);

// B Bᵀ with B n × rank of standard normals: symmetric positive semidefinite of that rank.
MatX random_psd(Random& random, int n, int rank);

// A square sheet of nodes × nodes at z = 0 facing +z, with `per_triangle`² samples a triangle and a
// compliance that falls with distance: C_ab = c·(I + 0.1 R) ⊗ exp(−|x_a − x_b|/ℓ), ℓ the reach, R
// symmetric and random, c [m/N]. Symmetric positive definite. Samples' ids are 1, 2, …
struct SheetSettings {
  int nodes = 5;            // per side
  double side = 8e-3;       // [m]
  int per_triangle = 2;
  double compliance = 0.05;  // [m/N]
  double reach = 2e-3;       // [m]
  double friction = 0;
};
std::unique_ptr<CondensedProblem> sheet_problem(Random& random, const SheetSettings& settings);

// A sphere about the instrument's origin.
Instrument sphere_instrument(double radius);

// A single patch node on three equal springs of stiffness k, its one sample at x facing +z.
std::unique_ptr<CondensedProblem> spring_problem(double k, const Vec3& x, double friction);

// H (rows × 3·nodes) and J (rows × 6) of built rows, dense.
MatX dense_H(const CondensedProblem& problem, const ContactRows& rows);
MatX dense_J(const ContactRows& rows);

}  // namespace hapticd
