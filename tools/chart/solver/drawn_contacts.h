// Contact problems drawn by chance rather than met by a stroke: families on which solvers stall, or err.
//
// wedge: points on two walls that open by 0.05 to 1 rad and face one another, half on each, an instrument in
// between on a coupling of 400 N/m, walls a thousand times as stiff; forces inside are large and not unique,
// the wrench is. badly_scaled: W = S B Bᵀ S, B square of uniform numbers, S one factor a contact, so that
// compliances are up to 1e12 apart; the wrench is of the first six columns of S B. `width` rows a contact: 3
// (n, t1, t2) or 1 (n). Units: m, N.
#pragma once

#include <random>
#include <vector>

#include "physics/types.h"

namespace hapticd {

struct DrawnContacts {
  MatX J;          // rows × 6
  MatX W;          // symmetric positive semidefinite
  VecX q, motion;  // free gaps at first, and by how much they change
  std::vector<double> mu;
};

// Uniform in [low, high): the library's distributions differ between implementations.
double between(std::mt19937_64& random, double low, double high);

DrawnContacts draw_wedge(std::mt19937_64& random, int contacts, int width);
DrawnContacts draw_badly_scaled(std::mt19937_64& random, int contacts, int width);

}  // namespace hapticd
