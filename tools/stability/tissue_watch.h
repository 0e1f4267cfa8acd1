// Whether tissue has burst: looked at after each simulation step.
//
//   farthest   of a live node from the middle of the removable body at rest [m]
//   fastest    node [m/s]
//   made       E − E₀ of a free piece, E = ½ Σ m v² + elastic energy, E₀ since it was last pressed, cut or
//              joined to nothing held: neither instrument nor gravity did work on it, so E may only fall [J]
//
// Bounds are the scene's and the script's, V the instrument's largest speed:
//   farthest   R + 2 V/α + 2 a    R: of a deformable body at rest from that middle; a piece that is struck
//                                 elastically by what is heavier goes at 2 V and, slowed by the Rayleigh mass
//                                 damping α alone, comes no farther than 2 V/α; what is pressed lies within
//                                 two alarm distances a besides
//   fastest    2 V + s/h          s: the removable body's least extent; what is pressed through all of it and
//                                 let go comes back in a step
// Pieces hang together by nodes (fragments.h). Without gravity only: std::invalid_argument else.
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
  double made = 0;         // by a free piece, largest [J]
  double free_energy = 0;  // largest E₀ of one [J]
};

class TissueWatch {
 public:
  TissueWatch(const Scene& scene, const Bodies& bodies, double instrument_speed);

  const TissueBounds& bounds() const { return bounds_; }

  // Of the state as it is; of energy, against the states seen since.
  TissueExtremes look(const Bodies& bodies);

 private:
  // Of one body. A piece that loses nothing keeps its first tetrahedron and their number.
  struct Watched {
    struct Piece {
      int first = -1, tets = 0;
      double since = -1;  // E₀; negative: not known
      double energy = 0;
    };
    int removed = -1;  // the body's, when they were labelled
    Pieces pieces;
    std::vector<Piece> piece;
  };
  static void label(const Body& body, Watched& watched);
  static void look_at_energy(const Body& body, Watched& watched, TissueExtremes& out);

  Vec3 middle_ = Vec3::Zero();
  TissueBounds bounds_;
  std::vector<Watched> watched_;
};

}  // namespace hapticd
