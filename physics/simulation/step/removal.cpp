#include "physics/simulation/step/removal.h"

#include <algorithm>

#include <ccd/ccd.h>

#include "physics/simulation/aspiration/lumen.h"
#include "physics/tissue/fragments.h"

namespace hapticd {
namespace {

struct GrownPrimitive {
  const Primitive* primitive;
  Pose X;  // of the instrument
  double stroke;
};

Vec3 from_ccd(const ccd_vec3_t* v) { return {ccdVec3X(v), ccdVec3Y(v), ccdVec3Z(v)}; }

void support_tet(const void* object, const ccd_vec3_t* direction, ccd_vec3_t* out) {
  const auto& corners = *static_cast<const std::array<Vec3, 4>*>(object);
  const Vec3 d = from_ccd(direction);
  const Vec3* best = &corners[0];
  for (const Vec3& c : corners)
    if (c.dot(d) > best->dot(d)) best = &c;
  ccdVec3Set(out, best->x(), best->y(), best->z());
}

void support_primitive(const void* object, const ccd_vec3_t* direction, ccd_vec3_t* out) {
  const auto& grown = *static_cast<const GrownPrimitive*>(object);
  const Vec3 d = from_ccd(direction);
  const Vec3 p = support(*grown.primitive, grown.X, d) + grown.stroke * d.normalized();
  ccdVec3Set(out, p.x(), p.y(), p.z());
}

double size_of(const Primitive& p) {
  double r = p.radius;
  for (const Vec3& v : p.vertices) r = std::max(r, v.norm());
  return r > 0 ? r : 1.0;
}

Primitive scaled(Primitive p, double s) {
  p.radius *= s;
  p.half_length *= s;
  p.placement.p *= s;
  for (Vec3& v : p.vertices) v *= s;
  for (auto& plane : p.planes) plane[3] *= s;
  return p;
}

// The tip in coordinates centred on it and in units of its size: libccd's tolerances are absolute.
class TipFrame {
 public:
  TipFrame(const Primitive& tip, const Pose& X, double stroke)
      : scale_(1.0 / size_of(tip)),
        centre_(X.to_world(tip.placement.p)),
        primitive_(scaled(tip, scale_)),
        grown_{&primitive_, {scale_ * (X.p - centre_), X.q}, scale_ * stroke} {}
  TipFrame(const TipFrame&) = delete;
  TipFrame& operator=(const TipFrame&) = delete;

  bool touches(const std::array<Vec3, 4>& corners) const {
    std::array<Vec3, 4> local;
    for (int a = 0; a < 4; ++a) local[a] = scale_ * (corners[a] - centre_);
    ccd_t ccd;
    CCD_INIT(&ccd);
    ccd.support1 = support_tet;
    ccd.support2 = support_primitive;
    ccd.max_iterations = 100;
    return ccdGJKIntersect(&local, &grown_, &ccd) != 0;
  }

 private:
  double scale_;
  Vec3 centre_;
  Primitive primitive_;
  GrownPrimitive grown_;
};

std::array<Vec3, 4> corners_of(const TissueModel& model, const TissueState& state, int e) {
  const Tet& t = model.mesh.tets[e];
  return {state.x[t[0]], state.x[t[1]], state.x[t[2]], state.x[t[3]]};
}

}  // namespace

bool intersects(const std::array<Vec3, 4>& corners, const Primitive& primitive, const Pose& X,
                double stroke) {
  return TipFrame(primitive, X, stroke).touches(corners);
}

std::vector<int> tets_at_tip(const TissueModel& model, const TissueState& state, const Instrument& instrument,
                             const Pose& X, double stroke) {
  const Primitive& tip = instrument.primitives[instrument.tip];
  const TipFrame frame(tip, X, stroke);
  Eigen::AlignedBox3d box;
  for (int axis = 0; axis < 3; ++axis) {
    box.extend(support(tip, X, Vec3::Unit(axis)) + stroke * Vec3::Unit(axis));
    box.extend(support(tip, X, -Vec3::Unit(axis)) - stroke * Vec3::Unit(axis));
  }

  std::vector<std::pair<double, int>> found;
  for (int e = 0; e < model.tet_count(); ++e) {
    if (!state.alive[e]) continue;
    const auto corners = corners_of(model, state, e);
    Eigen::AlignedBox3d tet_box;
    for (const Vec3& c : corners) tet_box.extend(c);
    if (!box.intersects(tet_box) || !frame.touches(corners)) continue;
    const Vec3 centroid = 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
    const Vec3 local = tip.placement.to_local(X.to_local(centroid));
    found.emplace_back(gap_at(tip, local).distance, e);
  }
  std::sort(found.begin(), found.end());
  std::vector<int> tets(found.size());
  std::transform(found.begin(), found.end(), tets.begin(), [](const auto& f) { return f.second; });
  return tets;
}

bool aspirates(const Instrument& instrument, const RemovalSettings& settings) noexcept {
  return instrument.port.lumen > 0 ? settings.aspiration_reach > 0 : settings.aspiration_max_tets > 0;
}

Aspirated fragments_at_tip(const TissueModel& model, const TissueState& state, const Instrument& instrument,
                           const Pose& X, const RemovalSettings& settings) {
  const Primitive& tip = instrument.primitives[instrument.tip];
  const Port& port = instrument.port;
  const auto reached = [&](int node) {
    const Vec3 local = X.to_local(state.x[node]);
    const double distance = port.lumen > 0 ? distance_to_opening(port, local)
                                           : gap_at(tip, tip.placement.to_local(local)).distance;
    return distance < settings.aspiration_reach;
  };
  Aspirated out;
  for (const Fragment& fragment : find_fragments(model, state)) {
    if (fragment.held ||
        (port.lumen <= 0 && static_cast<int>(fragment.tets.size()) > settings.aspiration_max_tets))
      continue;
    const bool near = std::any_of(fragment.tets.begin(), fragment.tets.end(), [&](int e) {
      const Tet& t = model.mesh.tets[e];
      return std::any_of(t.begin(), t.end(), reached);
    });
    if (!near) continue;
    if (port.lumen > 0) {
      const double radius = passing_radius(nodes_of(model, state, fragment.tets), port.lumen);
      if (radius > port.lumen) {
        out.too_wide = out.too_wide > 0 ? std::min(out.too_wide, radius) : radius;
        continue;
      }
    }
    out.tets.insert(out.tets.end(), fragment.tets.begin(), fragment.tets.end());
    for (const int t : fragment.tets) out.volume += volume_left(model, state, t);
    ++out.fragments;
  }
  return out;
}

}  // namespace hapticd
