// Implicit drag: v⁺ = v + h F/m and F = c (u − v⁺) give F = c (u − v) m/(m + h c), stable for any h. At the
// step's end v⁺ → u; with Rayleigh's mass damping α a piece comes to u c/(c + α m).
#include "physics/simulation/aspiration/inflow.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "physics/simulation/aspiration/lumen.h"
#include "physics/tissue/fragments.h"

namespace hapticd {
namespace {

constexpr double most_of_way = 0.5;  // between piece and opening, in one step

struct Piece {
  double mass = 0, volume = 0, gap = std::numeric_limits<double>::infinity();  // gap: to the opening
  Vec3 centre = Vec3::Zero(), momentum = Vec3::Zero();                         // centre: times mass
};

// Of those that nothing holds; of others zero.
std::vector<Piece> loose_pieces(const Body& body, const Pieces& pieces, const Port& port, const Pose& X) {
  std::vector<Piece> out(static_cast<std::size_t>(pieces.count()));
  for (int n = 0; n < body.model.nodes_in_use; ++n) {
    const int p = pieces.of_node[n];
    if (p < 0 || pieces.held[static_cast<std::size_t>(p)] || body.model.fixed[n]) continue;
    Piece& piece = out[static_cast<std::size_t>(p)];
    const double mass = body.state.mass[n];
    piece.mass += mass;
    piece.centre += mass * body.state.x[n];
    piece.momentum += mass * body.state.v[n];
    piece.gap = std::min(piece.gap, distance_to_opening(port, X.to_local(body.state.x[n])));
  }
  for (int t = 0; t < body.model.tets_in_use; ++t)
    if (const int p = pieces.of_tet[t]; p >= 0)
      out[static_cast<std::size_t>(p)].volume += volume_left(body.model, body.state, t);
  return out;
}

// The mean speed over a step of what flows with the fluid.
double carried(double r, double flow, double h) {
  const double left = r * r * r - 3 * flow * h / (2 * std::numbers::pi);
  return (r - std::cbrt(std::max(0.0, left))) / h;
}

Vec3 drag_on(const Piece& piece, const Port& port, const Pose& X, double flow, double h) {
  const Vec3 from = piece.centre / piece.mass - X.to_world(port.position);
  const double r = from.norm();
  if (!(from.dot(X.q * port.direction) > 0)) return Vec3::Zero();
  const double radius = std::cbrt(3 * piece.volume / (4 * std::numbers::pi));
  const double c = 6 * std::numbers::pi * fluid_viscosity * radius;
  const double speed = std::min(carried(r, flow, h), most_of_way * piece.gap / h);
  const Vec3 u = -speed / r * from, v = piece.momentum / piece.mass;
  return c * (u - v) * (piece.mass / (piece.mass + h * c));
}

}  // namespace

double flow_into(const Port& port, const InstrumentSample& sample, double occlusion) noexcept {
  return sample.present && sample.aspiration && port.radius > 0 ? port.flow * (1 - occlusion) : 0;
}

void carry_along(Bodies& bodies, Instruments instruments, const InstrumentPoses& X,
                 const EachInstrument<double>& flow, double h) {
  for (Body& body : bodies) {
    body.state.load.clear();
    if (!body.deformable || !body.model.dynamic) continue;
    for (int i = 0; i < instruments.count(); ++i) {
      if (!X.present[i] || !(flow[i] > 0)) continue;
      const Pieces pieces = find_pieces(body.model, body.state);
      const std::vector<Piece> loose = loose_pieces(body, pieces, instruments[i].port, X[i]);
      std::vector<Vec3> per_mass(loose.size(), Vec3::Zero());
      bool any = false;
      for (std::size_t p = 0; p < loose.size(); ++p) {
        if (!(loose[p].mass > 0)) continue;
        per_mass[p] = drag_on(loose[p], instruments[i].port, X[i], flow[i], h) / loose[p].mass;
        any = any || !per_mass[p].isZero(0);
      }
      if (!any) continue;
      body.state.load.resize(body.state.x.size(), Vec3::Zero());
      for (int n = 0; n < body.model.nodes_in_use; ++n)
        if (const int p = pieces.of_node[n]; p >= 0)
          body.state.load[static_cast<std::size_t>(n)] +=
              body.state.mass[n] * per_mass[static_cast<std::size_t>(p)];
      body.asleep = false;
    }
  }
}

}  // namespace hapticd
