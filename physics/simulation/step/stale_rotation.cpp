#include "physics/simulation/step/stale_rotation.h"

#include <algorithm>

#include "physics/tissue/rotation.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

double change_of_force(const TissueModel& m, int t, double volume, const Mat3& F, const Mat3& R,
                       const Mat3& stale) {
  const auto [mu, lambda, density] = m.elastic[t];
  const Mat3 S = R.transpose() * F;
  const Mat3 held = 0.5 * R * (S + S.transpose());
  return (element_forces(F, stale, m.gradients[t], volume, mu, lambda) -
          element_forces(held, R, m.gradients[t], volume, mu, lambda))
      .norm();
}

}  // namespace

std::vector<StaleRotation> stale_rotations(const Body& body, const VecX& dx, double least) {
  const TissueModel& m = body.model;
  std::vector<std::uint8_t> known(body.state.x.size());
  for (int n = 0; n < m.node_count(); ++n)
    known[n] = body.state.live_tets_of_node[n] > 0 && body.compliance->zone_covers(std::span(&n, 1));

  std::vector<std::pair<double, StaleRotation>> found;
  for (int t = 0; t < m.tet_count(); ++t) {
    const Tet& tet = m.mesh.tets[t];
    if (!body.state.alive[t] || !std::all_of(tet.begin(), tet.end(), [&](int n) { return known[n]; }))
      continue;
    Corners x = corners_of(tet, body.state.x);
    for (int a = 0; a < 4; ++a)
      if (!m.fixed[tet[a]]) x.col(a) += dx.segment<3>(3 * tet[a]);
    const Mat3 F = deformation_gradient(x, m.gradients[t]);
    const Mat3 R = nearest_rotation(F, body.state.rotation[t]);
    const double change = change_of_force(m, t, volume_left(m, body.state, t), F, body.state.rotation[t], R);
    if (change > least) found.push_back({change, {t, R}});
  }
  std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first > b.first : a.second.tet < b.second.tet;
  });

  std::vector<StaleRotation> out;
  std::vector<std::uint8_t> named(body.state.x.size(), 0);
  long nodes = 0;
  for (const auto& [change, stale] : found) {
    const Tet& tet = m.mesh.tets[stale.tet];
    const auto more = std::count_if(tet.begin(), tet.end(), [&](int n) { return !named[n]; });
    if (nodes + more > most_stale_nodes) continue;
    nodes += more;
    for (const int n : tet) named[n] = 1;
    out.push_back(stale);
  }
  return out;
}

}  // namespace hapticd
