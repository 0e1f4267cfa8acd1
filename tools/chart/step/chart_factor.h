// The factorisation of one lens's system matrix, our own against CHOLMOD's, in the same run by turns.
//
// Both factor the same A with the same order, a zone at the anterior pole last, on one thread; times are
// medians of one factorisation, from the assembled blocks to L, without the symbolic work. CHOLMOD as this
// program runs it: OpenBLAS, its OpenMP regions kept on the caller.
// Residual: ‖A y − b‖/‖b‖ of a load of every wavelength. Units in the names.
#pragma once

#include <string>

#include "physics/tissue/tissue.h"

namespace hapticd {

struct FactorFigures {
  int nodes = 0;
  int zone_nodes = 0;
  std::string kernels;  // avx512, avx2, generic
  double own_ms = 0;
  double cholmod_ms = 0;
  double plan_ms = 0;          // what a moved zone costs our own once
  double cholmod_plan_ms = 0;  // … and CHOLMOD
  double own_residual = 0;
  double cholmod_residual = 0;
};

FactorFigures chart_factor(const TissueModel& model, int zone_nodes, int repeats);

}  // namespace hapticd
