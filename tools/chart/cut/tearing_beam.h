// A double cantilever beam that tears: at which load the crack runs, against beam theory.
//
//   J = 12 P² a² (1 + 0.64 H/a)² / (w² E H³),   so it runs at P = √(J₀ E H³/12) w / (a + 0.64 H)
//
// Two arms of height H and width w are pulled apart by P at their ends; the crack of length a lies in the
// mesh's middle plane. The load is raised until a face tears (physics/cutting/tearing.h, or breaking.h),
// which is opened; then again, while the crack goes on. ν = 0 and motion in the plane alone, so that it is a
// beam. Units: m, N. Errors: none. Source: Kanninen, Int. J. Fracture 9 (1973) 83, for the turning of the
// arms' roots.
#pragma once

#include <vector>

namespace hapticd {

struct TearingBeam {
  int nodes = 0;
  int across_arm = 0;   // elements over the height of an arm
  double load_n = 0;    // mean over the faces that tore
  double theory_n = 0;  // mean over the same lengths
  int torn = 0;         // faces
};

// By the energy that the slit's front releases, or by what opening faces releases.
enum class TearRule { front, face };

// One for each number of elements over an arm's height.
std::vector<TearingBeam> chart_tearing_beam(const std::vector<int>& across_arm,
                                            TearRule rule = TearRule::front);

}  // namespace hapticd
