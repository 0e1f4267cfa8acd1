#include "tools/chart/cut/cut_cost.h"

#include <algorithm>
#include <chrono>
#include <numeric>
#include <vector>

#include "physics/compliance/reference_compliance.h"
#include "physics/cutting/mesh_check.h"
#include "physics/cutting/opening.h"
#include "physics/cutting/subdivision.h"
#include "physics/tissue/mesh_quality.h"
#include "tools/chart/removal/chart_removal.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int zone_nodes = 200, halo_nodes = 200, patch_nodes = 60;  // the daemon's largest zone and halo
constexpr int most_carried = 48;  // changed elements not wholly inside the zone
constexpr double quality_bound = 0.05;
constexpr double edge_width = 0.5e-3;  // of the blade [m]

double us_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::micro>(Clock::now() - begin).count();
}

double volume_of(const TissueModel& model, const TissueState& state) {
  double sum = 0;
  for (int t = 0; t < model.tet_count(); ++t)
    if (state.alive[t]) sum += model.volume[t];
  return sum;
}

// A body that is cut, with its factor kept as the daemon keeps it.
class CutRun {
 public:
  CutRun(TissueModel model, double h)
      : model_(std::move(model)),
        state_(rest_state(model_)),
        surface_(model_.mesh),
        work_(model_),
        change_(model_),
        h_(h) {
    ComplianceOptions options;
    options.sample_every = 1 << 30;
    compliance_ = make_zone_compliance(model_, h, options);
  }

  void start(const Vec3& blade) {
    move_zone(blade);
    compliance_->update(state_);
  }

  // Times one update; false: the operation did nothing.
  template <class Cut>
  bool update(const Vec3& blade, const Cut& cut, std::vector<double>& us) {
    follow(blade);
    change_.clear();
    const auto begin = Clock::now();
    const CutStatus status = cut(model_, state_, work_, change_);
    if (status != CutStatus::done || change_.empty()) return false;
    surface_.follow(model_, change_.tets, change_.opened);
    compliance_->reshape(state_, change_.tets);
    us.push_back(us_since(begin));
    for (const int t : change_.tets)
      carried_ += std::any_of(model_.mesh.tets[t].begin(), model_.mesh.tets[t].end(), [&](int n) {
        return n < static_cast<int>(in_zone_.size()) && !model_.fixed[n] && !in_zone_[n];
      });
    appended_ += static_cast<int>(change_.nodes.size());
    return true;
  }

  double error(const Vec3& blade) {
    compliance_->update(state_);
    const std::vector<int> patch = nearest_live_nodes(model_, state_, blade, patch_nodes);
    const auto size = static_cast<Eigen::Index>(3 * patch.size());
    MatX block(size, size);
    compliance_->patch(patch, block);
    const int columns = 36;
    const MatX oracle = oracle_columns(model_, state_, h_, patch, columns);
    return (block.leftCols(columns) - oracle).norm() / oracle.norm();
  }

  TissueModel& model() { return model_; }
  const TissueState& state() const { return state_; }
  std::string check() { return check_mesh(model_, state_, work_, &surface_); }
  int references() const { return references_; }
  const TopologyChange& change() const { return change_; }

 private:
  void move_zone(const Vec3& blade) {
    const std::vector<int> near = nearest_live_nodes(model_, state_, blade, zone_nodes + halo_nodes);
    const std::span<const int> zone = std::span(near).first(zone_nodes);
    in_zone_.assign(model_.nodes_in_use, 0);
    for (const int n : zone) in_zone_[n] = 1;
    compliance_->move_zone(zone);
    compliance_->move_halo(std::span(near).subspan(zone_nodes));
  }

  void follow(const Vec3& blade) {
    const std::vector<int> near = nearest_live_nodes(model_, state_, blade, patch_nodes);
    const bool covered = std::all_of(near.begin(), near.end(), [&](int n) {
      return n >= static_cast<int>(in_zone_.size()) || in_zone_[n] != 0;
    });
    if (covered && carried_ < most_carried && appended_ < 64) return;
    move_zone(blade);
    std::unique_ptr<ReferenceFactor> reference = compliance_->snapshot_reference(state_);
    reference->make();
    compliance_->adopt_reference(std::move(reference), state_);
    compliance_->update(state_);
    carried_ = appended_ = 0;
    ++references_;
  }

  TissueModel model_;
  TissueState state_;
  BoundarySurface surface_;
  CutWorkspace work_;
  TopologyChange change_;
  double h_;
  std::unique_ptr<ReferenceCompliance> compliance_;
  std::vector<std::uint8_t> in_zone_;
  int carried_ = 0, appended_ = 0, references_ = 0;
};

CutCost summed(const std::vector<double>& us, int count, double before, double after) {
  CutCost cost;
  cost.count = count;
  cost.updates = static_cast<int>(us.size());
  const auto q = quantiles(us);
  cost.update_us_median = q.p50;
  cost.update_us_p99 = q.p99;
  cost.update_us_max = q.max;
  const std::size_t tenth = std::max<std::size_t>(us.size() / 10, 1);
  cost.flatness = quantiles({us.end() - static_cast<std::ptrdiff_t>(tenth), us.end()}).p50 /
                  quantiles({us.begin(), us.begin() + static_cast<std::ptrdiff_t>(tenth)}).p50;
  cost.volume_rel_error = std::abs(after - before) / before;
  return cost;
}

// Where a blade is that goes to and fro along x: in planes of constant z, from the highest down, and there in
// lanes that its edge covers, one beside the other.
struct Place {
  Place(int in_plane, const Vec3& x)
      : plane(in_plane), lane(static_cast<int>(std::floor(x.y() / edge_width))), at(x) {}
  int plane, lane;
  Vec3 at;
  double along() const { return (plane + lane) % 2 == 0 ? at.x() : -at.x(); }
  bool operator<(const Place& o) const {
    if (plane != o.plane) return plane < o.plane;
    if (lane != o.lane) return plane % 2 == 0 ? lane < o.lane : lane > o.lane;
    return along() < o.along();
  }
};

struct Planes {
  double top, distance;
  int of(double z) const { return static_cast<int>(std::floor((top - z) / distance)); }
  double middle(int plane) const { return top - (plane + 0.5) * distance; }
};

Planes planes_of(const TissueModel& model, int count) {
  double low = model.mesh.nodes[0].z(), high = low;
  for (int n = 0; n < model.nodes_in_use; ++n) {
    low = std::min(low, model.mesh.nodes[n].z());
    high = std::max(high, model.mesh.nodes[n].z());
  }
  return {high, (high - low) / count};
}

}  // namespace

CutCostFigures chart_cut_cost(TissueModel model_with_room, int count, double h,
                              const std::function<bool(double)>& progress) {
  CutRun run(std::move(model_with_room), h);
  TissueModel& model = run.model();
  CutCostFigures figures;
  figures.nodes = model.nodes_in_use;
  figures.tets = model.tets_in_use;
  figures.quality_before = least_quality(model, run.state());
  const double volume = volume_of(model, run.state());

  // Faces about level, in planes an eighth of the lens apart.
  const Planes planes = planes_of(model, 8);
  struct Face {
    Place place;
    int id;
  };
  std::vector<Face> faces;
  for (int id = 0; id < 4 * model.tets_in_use; ++id) {
    if (model.across[id] < id) continue;
    const Triangle f = outward_face(model.mesh.tets[id / 4], id % 4);
    const auto& X = model.mesh.nodes;
    const Vec3 middle = (X[f[0]] + X[f[1]] + X[f[2]]) / 3;
    const Vec3 normal = (X[f[1]] - X[f[0]]).cross(X[f[2]] - X[f[0]]).normalized();
    const int plane = planes.of(middle.z());
    if (std::abs(normal.z()) < 0.5 || std::abs(middle.z() - planes.middle(plane)) > 0.5 * planes.distance)
      continue;
    faces.push_back({{plane, middle}, id});
  }
  std::sort(faces.begin(), faces.end(), [](const Face& a, const Face& b) { return a.place < b.place; });
  if (faces.empty()) return figures;

  std::vector<double> us;
  Vec3 blade = faces.front().place.at;
  run.start(blade);
  int opened = 0;
  for (const Face& f : faces) {
    if (opened >= count || !progress(0.5 * opened / count)) break;
    blade = f.place.at;
    if (run.update(
            blade,
            [&](TissueModel& m, TissueState& s, CutWorkspace& w, TopologyChange& c) {
              return open_faces(m, s, w, std::span(&f.id, 1), c);
            },
            us))
      ++opened;
  }
  figures.openings = summed(us, opened, volume, volume_of(model, run.state()));
  figures.c_rel_error = run.error(blade);

  // Edges that cross planes half-way between those.
  struct Crossed {
    Place place;
    int a, b;
    double s;
  };
  std::vector<Crossed> edges;
  for (int t = 0; t < model.tets_in_use; ++t)
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < i; ++j) {
        int a = model.mesh.tets[t][i], b = model.mesh.tets[t][j];
        if (a > b) std::swap(a, b);
        const Vec3 &p = model.mesh.nodes[a], &q = model.mesh.nodes[b];
        const int plane = planes.of(0.5 * (p.z() + q.z()));
        const double z = planes.middle(plane) - 0.5 * planes.distance;
        if ((p.z() - z) * (q.z() - z) >= 0) continue;
        const double s = (z - p.z()) / (q.z() - p.z());
        if (s < 0.25 || s > 0.75) continue;
        const Vec3 at = p + s * (q - p);
        edges.push_back({{plane, at}, a, b, s});
      }
  std::sort(edges.begin(), edges.end(), [](const Crossed& l, const Crossed& r) {
    if (l.place < r.place || r.place < l.place) return l.place < r.place;
    return std::pair(l.a, l.b) < std::pair(r.a, r.b);
  });
  edges.erase(std::unique(edges.begin(), edges.end(),
                          [](const Crossed& l, const Crossed& r) { return l.a == r.a && l.b == r.b; }),
              edges.end());
  us.clear();
  const int first_new = model.tets_in_use;
  const double opened_volume = volume_of(model, run.state());
  int subdivided = 0;
  for (const Crossed& e : edges) {
    if (subdivided >= count || !progress(0.5 + 0.5 * subdivided / count)) break;
    blade = e.place.at;
    const int before = model.tets_in_use;
    if (run.update(
            blade,
            [&](TissueModel& m, TissueState& s, CutWorkspace& w, TopologyChange& c) {
              return split_edge(m, s, w, {e.a, e.b, e.s}, quality_bound, c);
            },
            us))
      subdivided += model.tets_in_use - before;
  }
  figures.subdivisions = summed(us, subdivided, opened_volume, volume_of(model, run.state()));
  figures.c_rel_error = std::max(figures.c_rel_error, run.error(blade));

  figures.nodes_after = model.nodes_in_use;
  figures.tets_after = model.tets_in_use;
  figures.quality_min = 1;
  for (int t = 0; t < model.tets_in_use; ++t) {
    if (!run.state().alive[t]) continue;
    const Tet& n = model.mesh.tets[t];
    const auto& X = model.mesh.nodes;
    figures.inverted += !(signed_volume(X[n[0]], X[n[1]], X[n[2]], X[n[3]]) > 0);
    if (t >= first_new)
      figures.quality_min =
          std::min(figures.quality_min, dihedral_quality(X[n[0]], X[n[1]], X[n[2]], X[n[3]]));
  }
  figures.invalid = run.check();
  figures.references = run.references();
  return figures;
}

}  // namespace hapticd
