// Checks of the tissue against solutions that were not made here: what the chart prints and the tests assert.
//
//   relative error = |value − reference| / |reference|, or |value| where the reference is zero
//
// A group is one function that appends to the findings; the quick effort is the part of ordinary tests, the
// full one takes minutes. A value named "extrapolated" is Richardson's, f + (f − f_coarse)/(r^p − 1), from
// the two finest meshes at the order p that the name gives. Units: of each check, in its name or SI. Errors:
// std::runtime_error where a solver fails.
#pragma once

#include <string>
#include <vector>

namespace hapticd {

enum class Effort { quick, full };

struct TissueCheck {
  std::string name;
  double reference = 0;
  double value = 0;
  double relative_error = 0;
  double tolerance = 0;
  std::string source;
  bool passed = false;
};

// Error against the size of elements, for the picture; the order is between the two finest.
struct TissueSeries {
  std::string name;
  double expected_order = 0;
  std::vector<double> size;  // relative to the body
  std::vector<double> error;
};

// One material, mesh and remedy of the chart of locking.
struct LockingPoint {
  std::string problem;  // indentation, cylinder
  std::string remedy;   // none, lowered, patches
  double poisson = 0;
  double size = 0;        // of elements, relative to the body
  double stiffness = 0;   // relative to the exact solution: 1 is right, above it locks
  double operations = 0;  // of the factorisation
};

struct TissueFindings {
  std::vector<TissueCheck> checks;
  std::vector<TissueSeries> series;
  std::vector<LockingPoint> locking;
  std::vector<std::string> skipped;  // what could not be checked here, and why

  void check(const std::string& name, double reference, double value, double tolerance,
             const std::string& source);
  // The series, and a check of its order.
  void converges(const TissueSeries& of, double tolerance, const std::string& source);
};

double order_of(const TissueSeries& series);
double extrapolated(double coarse, double fine, double ratio, double order);

struct TissueCheckGroup {
  const char* name;
  void (*run)(Effort effort, TissueFindings& findings);
};
const std::vector<TissueCheckGroup>& tissue_check_groups();

// Stiffness of the pressed square of the chart of locking, over the exact one, on a mesh of n elements along an
// edge (even); ν above `cap` lowered to it.
double indentation_stiffness(double poisson, double cap, int n);

// The groups. Elements:
void check_patch(Effort, TissueFindings&);
void check_invariance(Effort, TissueFindings&);
void check_derivatives(Effort, TissueFindings&);
// Beams:
void check_cantilever(Effort, TissueFindings&);
void check_elastica(Effort, TissueFindings&);
void check_torsion(Effort, TissueFindings&);
void check_frequencies(Effort, TissueFindings&);
// Solids:
void check_manufactured(Effort, TissueFindings&);
void check_le10(Effort, TissueFindings&);
void check_boussinesq(Effort, TissueFindings&);
void check_hertz(Effort, TissueFindings&);
// Motion, another program, incompressibility, inversion:
void check_motion(Effort, TissueFindings&);
void check_calculix(Effort, TissueFindings&);
void check_locking(Effort, TissueFindings&);

}  // namespace hapticd
