// Whether warping pays: the error of C_pp with each kind of it and without, for shapes that turn the tissue.
//
//   C_ij ≈ Q_i C_ij(base) Q_jᵀ,   base at rest, Q the turns of the nodes since (warp_rotation.h)
//
// A base is made of the lens at rest and the lens is then brought into a shape, without a new base:
//   indentation  the linear answer to a force on the anterior pole (within 0.6 mm), scaled to a depth [mm]
//   bending      onto a circular arc about the y axis, of so many degrees from edge to edge, floating
//   cantilever   the same arc, held at one end instead; the patch is at the other
//   turning      rigidly about the y axis by so many degrees, floating
// C depends on a shape only through the elements' rotations, so no equilibrium is needed.
// Error: ‖C_pp − oracle‖/‖oracle‖ on some columns, as in chart_removal.h. Units in the names.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "physics/compliance/compliance.h"

namespace hapticd {

struct WarpingPoint {
  std::string shape;   // indentation, bending, cantilever, turning
  double amount = 0;   // [mm] or [degrees]
  std::string method;  // zone, lazy
  Warping warping = Warping::none;
  double largest_turn = 0;  // of a node of the patch since the base [rad]
  double w_rel_error = 0;
};

struct WarpingSettings {
  double h = 0.02;
  int zone_nodes = 160;
  int patch_nodes = 60;
  int error_columns = 36;
  std::vector<double> depths_mm = {0.1, 0.2, 0.4, 0.8};
  std::vector<double> angles_deg = {5, 15, 45, 90};
};

// The shapes, as positions of all nodes.
std::vector<Vec3> indented(const TissueModel& held, double depth_m);
std::vector<Vec3> bent(const TissueModel& model, double angle_rad);
std::vector<Vec3> turned(const TissueModel& model, double angle_rad);

// `held`: the lens with its fixed nodes; `floating`: the same without. `progress` as in chart_removals.
std::vector<WarpingPoint> chart_warping(const TissueModel& held, const TissueModel& floating,
                                        const WarpingSettings& settings,
                                        const std::function<bool(double, const std::string&)>& progress);

}  // namespace hapticd
