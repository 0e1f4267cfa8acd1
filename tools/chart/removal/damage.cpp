#include "tools/chart/removal/damage.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace hapticd {
namespace {

constexpr double reach_of_tip = 1.5, shell = 2;                            // in element lengths …
constexpr double edge_of_blade = 3, strip = 0.25, apart = 1.5, gap = 0.5;  // … between layers

// Of a regular tetrahedron of the mean volume.
double element_length(const TissueModel& model) {
  const double volume = std::accumulate(model.volume.begin(), model.volume.begin() + model.tets_in_use, 0.0) /
                        model.tets_in_use;
  return std::cbrt(6 * std::sqrt(2.0) * volume);
}

Vec3 centroid(const TissueModel& model, int tet) {
  Vec3 sum = Vec3::Zero();
  for (const int n : model.mesh.tets[tet]) sum += 0.25 * model.mesh.nodes[n];
  return sum;
}

}  // namespace

std::vector<DamageStep> growing_hole(const TissueModel& model, int count) {
  Vec3 pole = model.mesh.nodes.front();
  for (int n = 0; n < model.nodes_in_use; ++n)
    if (model.mesh.nodes[n].z() > pole.z()) pole = model.mesh.nodes[n];
  const double edge = element_length(model), reach = reach_of_tip * edge;

  struct Left {
    int tet;
    int shell;
    Vec3 centre;
  };
  std::vector<Left> left(model.tets_in_use);
  for (int t = 0; t < model.tets_in_use; ++t) {
    const Vec3 centre = centroid(model, t);
    left[t] = {t, static_cast<int>((centre - pole).norm() / (shell * edge)), centre};
  }
  std::vector<DamageStep> hole;
  const auto wanted = std::min<std::size_t>(static_cast<std::size_t>(std::max(count, 0)), left.size());
  Vec3 tip = pole;
  while (hole.size() < wanted) {
    // Those in reach go first, nearest first; the others stay in their order.
    const auto distance = [&](const Left& l) { return (l.centre - tip).norm(); };
    const auto rest =
        std::stable_partition(left.begin(), left.end(), [&](const Left& l) { return distance(l) < reach; });
    std::sort(left.begin(), rest, [&](const Left& a, const Left& b) { return distance(a) < distance(b); });
    for (auto l = left.begin(); l != rest && hole.size() < wanted; ++l) {
      DamageStep step;
      step.tip = tip;
      step.tet = l->tet;
      hole.push_back(step);
    }
    left.erase(left.begin(), rest);
    if (left.empty()) break;
    tip = std::min_element(left.begin(), left.end(), [&](const Left& a, const Left& b) {
            return a.shell != b.shell ? a.shell < b.shell : distance(a) < distance(b);
          })->centre;
  }
  return hole;
}

BladeWay way_of_blade(const TissueModel& model, int count) {
  const double edge = element_length(model), length = edge_of_blade * edge;
  Eigen::AlignedBox3d box;
  for (int n = 0; n < model.nodes_in_use; ++n) box.extend(model.mesh.nodes[n]);
  Specimen body(model);
  BladeWay way;
  for (const int along : {0, 1})
    for (double top = box.max().z() + 0.5 * edge; top > box.min().z(); top -= length + gap * edge)
      for (double aside = box.min()[1 - along] + apart * edge; aside < box.max()[1 - along];
           aside += apart * edge) {
        const auto edge_at = [&](double at) {
          Vec3 upper = Vec3(0, 0, top);
          upper[along] = at;
          upper[1 - along] = aside;
          return std::array<Vec3, 2>{upper, upper - length * Vec3::UnitZ()};
        };
        bool begins = true;
        for (double at = box.min()[along] - edge; at < box.max()[along] + edge; at += strip * edge) {
          if (way.cuts == count) return way;
          DamageStep step;
          step.from = edge_at(at);
          step.to = edge_at(at + strip * edge);
          step.tip = 0.5 * (step.to[0] + step.to[1]);
          step.begins = begins;
          begins = false;
          step.counts = !body.apply(step).empty();
          way.cuts += step.counts;
          way.strips.push_back(step);
          way.used = {body.model().nodes_in_use - model.nodes_in_use,
                      body.model().tets_in_use - model.tets_in_use};
        }
      }
  return way;
}

Specimen::Cutting::Cutting(TissueModel& model)
    : work(model), change(model), blade(model), strip(1), surface(model.mesh) {}

Specimen::Specimen(const TissueModel& whole)
    : model_(std::make_unique<TissueModel>(whole)), state_(rest_state(*model_)) {
  if (model_->node_count() > model_->nodes_in_use) cutting_ = std::make_unique<Cutting>(*model_);
}

std::span<const int> Specimen::apply(const DamageStep& step) {
  if (step.tet >= 0) {
    gone_ = step.tet;
    remove_tets(*model_, state_, {&gone_, 1});
    return {&gone_, 1};
  }
  Cutting& c = *cutting_;
  if (step.begins) c.blade.start();
  c.strip.clear();
  c.strip.sweep(step.from, step.to);
  c.change.clear();
  const CutStatus status = c.blade.extend(*model_, state_, c.work, c.strip, c.change);
  if (status == CutStatus::no_room) throw std::runtime_error("the mesh has no room for another cut");
  if (c.change.empty()) return {};
  c.surface.follow(*model_, c.change.tets, c.change.opened);
  return c.change.tets;
}

}  // namespace hapticd
