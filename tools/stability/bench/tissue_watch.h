// Whether tissue has burst, or made energy: looked at after each simulation step.
//
//   farthest   of a live node from the middle of the removable body at rest [m]
//   fastest    node [m/s]
//   gained     H − H_before − fᵀΔx of a piece in the step, f of the instrument and of other bodies on its
//              nodes; H = ½ Σ m v² + elastic energy, of what the step left of it: never above 0 [J]
//   split      H after a cut of the mesh − H before it, of the body: never above 0 [J]
//   made       H − H₀ of a free piece, H₀ since it was last pressed, cut or joined to nothing held: no work
//              was done on it, so H may only fall [J]
//
// Bounds are the scene's and the script's, V the instrument's largest speed:
//   farthest   R + 2 V/α + 2 a    R: of a deformable body at rest from that middle; a piece struck
//   elastically
//                                 by what is heavier goes at 2 V and, slowed by the Rayleigh mass damping α
//                                 alone, comes no farther than 2 V/α; what is pressed lies within two alarm
//                                 distances a
//   fastest    2 V + s/h          s: the removable body's largest extent; what is dragged along all of it and
//                                 let go comes back in a step
// Looked at are bodies that can be cut or removed. Pieces hang together by nodes (fragments.h). Without
// gravity only: std::invalid_argument else.
#pragma once

#include <vector>

#include "physics/simulation/world.h"
#include "server/scene/scene.h"

namespace hapticd {

struct TissueBounds {
  double farthest = 0, fastest = 0;
};

struct TissueExtremes {
  bool finite = true;
  double farthest = 0, fastest = 0;
  int free = 0;            // pieces
  double gained = 0;       // by a piece in the step, largest [J]
  double split = 0;        // by cuts of the mesh, largest of a body since the last look [J]
  double energy = 0;       // largest H of one [J]
  double made = 0;         // by a free piece, largest [J]
  double free_energy = 0;  // largest H₀ of one [J]
};

class TissueWatch {
 public:
  TissueWatch(const Scene& scene, const Bodies& bodies, double instrument_speed);

  const TissueBounds& bounds() const { return bounds_; }

  // When a step has begun, where something may split: what is then is what the step begins with.
  void begin_step(const Bodies& bodies);

  // Of the state as it is; of energy, against the states seen since.
  TissueExtremes look(const Bodies& bodies);

 private:
  // Of one body. A piece that loses nothing keeps its first tetrahedron and their number.
  struct Watched {
    struct Piece {
      int first = -1, tets = 0;
      double since = -1;  // H₀; negative: not known
      double energy = 0;  // H
    };
    int removed = -1, topology = -1;  // the body's, when they were labelled
    Pieces pieces;
    std::vector<Piece> piece;
    std::vector<Vec3> x, v;  // when last looked at; empty: never
    VecX before;             // H of each piece then
  };
  static void label(const Body& body, Watched& watched);
  static void label_anew(const Body& body, Watched& watched);
  static VecX energies(const Body& body, const Pieces& pieces, const std::vector<Vec3>& x,
                       const std::vector<Vec3>& v);
  static void look_at_step(const Body& body, Watched& watched, TissueExtremes& out);
  static void look_at_free(const Body& body, Watched& watched, TissueExtremes& out);

  Vec3 middle_ = Vec3::Zero();
  TissueBounds bounds_;
  std::vector<Watched> watched_;
  double split_ = 0;
};

}  // namespace hapticd
