// Which tetrahedra the tip destroys, and which fragments it sucks out.
//
// A tetrahedron goes when its present shape intersects the tip primitive's volume grown by the
// ultrasonic stroke (convex against convex, GJK by libccd on exact support functions), while the
// pedal is down, at no more than `rate` per second, nearest to the tip first. The stroke matters:
// contact keeps tissue out of the tip at rest, and it is the vibrating tip that destroys it. A fragment that
// holds no fixed node is sucked out whole when it is near and passes, while aspiration is on: with a lumen,
// any of its nodes is within `aspiration_reach` of the port's opening and the piece fits the lumen (lumen.h);
// without, any is so near to the tip's surface and there are at most `aspiration_max_tets`. What the tip
// leaves of a few tetrahedra hanging by an edge, a node or springs goes with what held it (fragments.h), at
// no cost to the rate; what a crack leaves so, a step later.
// By degrees: all tetrahedra that the grown tip meets share the rate's volume equally, losing stiffness and
// mass, and each goes at a tenth of its own, or when it is crushed.
// Units: m, 1/s. Source: the paper §3 ("consecutively removing tetrahedra intersected by the tip");
// departure: the hinged fragments.
#pragma once

#include <span>
#include <vector>

#include "physics/contact/instrument.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

struct RemovalSettings {
  double rate = 0;              // tetrahedra per second while the pedal is down; 0: never
  double stroke = 0;            // reach of the vibrating tip beyond its surface at rest [m]
  double aspiration_reach = 0;  // [m]
  int aspiration_max_tets = 0;  // a larger fragment does not pass, where no lumen says more
  bool gradual = false;         // tetrahedra go by degrees; false: whole, as in the paper
};

inline constexpr int crumb_tets = 8;       // what hangs and is larger is kept
inline constexpr double spent_left = 0.1;  // share of a tetrahedron at which it goes
inline constexpr double crushed = 0.2;     // … of its volume that it is pressed into, where some of it went

// True if the tetrahedron with these corners and the primitive at instrument pose X, grown by
// `stroke`, share a point.
bool intersects(const std::array<Vec3, 4>& corners, const Primitive& primitive, const Pose& X, double stroke);

// Live tetrahedra that the tip destroys, nearest (signed distance of the centroid) first.
std::vector<int> tets_at_tip(const TissueModel& model, const TissueState& state, const Instrument& instrument,
                             const Pose& X, double stroke);

// Live tetrahedra of all fragments within the tip's suction that pass, and how many fragments they are.
struct Aspirated {
  std::vector<int> tets;
  int fragments = 0;
  double volume = 0;    // of them [m³]
  double too_wide = 0;  // a lumen that the narrowest near one that does not pass would need, at least [m]
};
Aspirated fragments_at_tip(const TissueModel& model, const TissueState& state, const Instrument& instrument,
                           const Pose& X, const RemovalSettings& settings);

// Of an instrument's bore, after a step.
struct LumenState {
  double passing = 0;   // of what was sucked in, still on its way through, for volume/flow [m³]
  double too_wide = 0;  // Aspirated::too_wide
};

// Whether anything can be sucked out.
bool aspirates(const Instrument& instrument, const RemovalSettings& settings) noexcept;

}  // namespace hapticd
