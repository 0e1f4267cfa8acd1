// Solutions of elasticity that others found, as functions: what the checks are held against.
//
// Units: SI. Each names its source; those by series or by integrating an ordinary differential equation are
// accurate to 1e-8 and better.
#pragma once

#include "physics/types.h"

namespace hapticd {

// A prismatic beam: length, bending stiffness EI, shear stiffness κGA, axial stiffness EA, mass per length.
struct Beam {
  double length, bending, shear, axial, mass;
};
// Rectangular, ν = 0, κ = 5/6 (for ν = 0: Cowper 1966).
Beam rectangular_beam(double length, double width, double height, double young, double density);

// Tip deflection under a tip force P: PL³/3EI + PL/κGA. Timoshenko 1921.
double timoshenko_tip(const Beam& beam, double force);

// The tip of a cantilever along x under a dead tip force along −z, at any deflection: (shortening L − x,
// sinking). With shear = axial = ∞ it is Euler's elastica (Bisshopp and Drucker 1945); finite, Reissner's
// beam (1972).
struct TipPlace {
  double shortening, sinking;
};
TipPlace elastica_tip(const Beam& beam, double force);

// Lowest angular frequency of a cantilever with shear and rotary inertia. Timoshenko 1921.
double timoshenko_frequency(const Beam& beam, double rotary_inertia);

// Torsional stiffness of a square bar of side a over G a⁴: 0.140577. Saint-Venant 1855.
double square_torsion();

// Displacement at x (z ≤ 0 inside) under a point force along −z at the origin of a half-space. Boussinesq
// 1885.
Vec3 boussinesq(const Vec3& x, double force, double young, double poisson);

// Force of a rigid sphere pressed to a depth d into a half-space: 4/3 E/(1−ν²) √R d^{3/2}. Hertz 1882.
double hertz_force(double depth, double radius, double young, double poisson);

// Depth of the middle of a circle of radius a under a uniform pressure p: 2 (1−ν²) p a/E. Timoshenko and
// Goodier 1951, §139.
double pressed_circle(double pressure, double radius, double young, double poisson);

// Radial displacement at the inner radius a of a tube (outer radius b) under inner pressure, plane strain.
// Lamé 1852.
double lame_inner(double pressure, double a, double b, double young, double poisson);

}  // namespace hapticd
