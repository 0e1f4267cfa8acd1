// Fluid that flows into an open port, and the loose pieces of tissue that it carries along.
//
//   q = Q (1 − o),   u(r) = q/(2π r²) towards the port,   F = c (u − v),   c = 6π η a,   a³ = 3V/(4π)
//
// A sink in a wall before the port; Stokes's drag of a ball of the piece's volume V at its centroid, r from
// the port's middle, only before the port. o: the port's occlusion. At 30 ml/min 1 mm away u is 80 mm/s, and
// a piece of 1 mm³ feels 1 µN: a thousandth of what the vacuum holds it with, so held tissue is left out,
// and so is the hand. Units: m, N, m³/s. Departure from the law in a step: u is the mean over the step of
// what is carried along, (r − r₁)/h with r₁³ = r³ − 3 q h/(2π), and at most half of what lies between piece
// and opening per step; v is the step's own (implicit Euler). Errors: none. Source: Batchelor, An
// Introduction to Fluid Dynamics, §2.5 (sink) and §4.9 (Stokes).
#pragma once

#include "physics/simulation/body.h"
#include "physics/simulation/step/instrument_motion.h"

namespace hapticd {

inline constexpr double fluid_viscosity = 1e-3;  // η, of balanced salt solution [Pa·s]

// Of one port, q [m³/s]; 0 without the pedal.
double flow_into(const Port& port, const InstrumentSample& sample, double occlusion) noexcept;

// Sets the loads of all bodies' loose pieces, and wakes those that have some. X: the instruments' poses.
void carry_along(Bodies& bodies, Instruments instruments, const InstrumentPoses& X,
                 const EachInstrument<double>& flow, double h);

}  // namespace hapticd
