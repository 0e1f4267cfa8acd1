#include "tools/chart/removal/chart_warping.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "physics/compliance/reference/warp_rotation.h"
#include "tools/chart/removal/chart_removal.h"

namespace hapticd {

namespace {

constexpr double mm = 1e-3;
constexpr double indenter = 0.6 * mm;

Vec3 anterior_pole(const TissueModel& model) {
  return *std::max_element(model.mesh.nodes.begin(), model.mesh.nodes.end(),
                           [](const Vec3& a, const Vec3& b) { return a.z() < b.z(); });
}

struct Variant {
  const char* name;
  ComplianceMethod method;
  Warping warping;
};
constexpr Variant variants[] = {
    {"zone", ComplianceMethod::zone, Warping::none},  {"zone", ComplianceMethod::zone, Warping::node},
    {"zone", ComplianceMethod::zone, Warping::piece}, {"lazy", ComplianceMethod::lazy, Warping::none},
    {"lazy", ComplianceMethod::lazy, Warping::node},  {"lazy", ComplianceMethod::lazy, Warping::piece}};

struct Shape {
  std::string name;
  double amount;
  const TissueModel* model;
  Vec3 place;  // of the patch, at rest
  std::vector<Vec3> x;
};

// The lens held at the end of its x axis, instead of all round.
TissueModel held_at_one_end(const TissueModel& floating) {
  const double end = std::min_element(floating.mesh.nodes.begin(), floating.mesh.nodes.end(),
                                      [](const Vec3& a, const Vec3& b) { return a.x() < b.x(); })
                         ->x();
  std::vector<int> fixed;
  for (int n = 0; n < floating.node_count(); ++n)
    if (floating.mesh.nodes[n].x() < 0.85 * end) fixed.push_back(n);
  return make_tissue_model(floating.mesh, floating.material, fixed, Vec3::Zero());
}

// The same arc, with its held end where it was.
std::vector<Vec3> cantilever(const TissueModel& model, double angle_rad) {
  std::vector<Vec3> x = bent(model, angle_rad);
  const Eigen::AngleAxisd back(-0.5 * angle_rad, Vec3::UnitY());
  for (Vec3& p : x) p = back * p;
  return x;
}

}  // namespace

std::vector<Vec3> indented(const TissueModel& held, double depth_m) {
  const TissueState state = rest_state(held);
  const auto compliance = make_compliance(ComplianceMethod::exact, held, 1e3);  // so slow that it is static
  compliance->update(state);
  const Vec3 pole = anterior_pole(held);
  VecX force = VecX::Zero(3 * held.node_count());
  for (int n = 0; n < held.node_count(); ++n)
    if ((held.mesh.nodes[n] - pole).norm() < indenter) force[3 * n + 2] = -1;
  VecX u(force.size());
  compliance->apply(force, u);
  double deepest = 0;
  for (int n = 0; n < held.node_count(); ++n) deepest = std::max(deepest, -u[3 * n + 2]);
  std::vector<Vec3> x = held.mesh.nodes;
  for (int n = 0; n < held.node_count(); ++n) x[n] += depth_m / deepest * u.segment<3>(3 * n);
  return x;
}

std::vector<Vec3> bent(const TissueModel& model, double angle_rad) {
  double half = 0;
  for (const Vec3& X : model.mesh.nodes) half = std::max(half, std::abs(X.x()));
  const double radius = 2 * half / angle_rad;
  std::vector<Vec3> x;
  for (const Vec3& X : model.mesh.nodes) {
    const double a = X.x() / radius;
    x.emplace_back((radius - X.z()) * std::sin(a), X.y(), radius - (radius - X.z()) * std::cos(a));
  }
  return x;
}

std::vector<Vec3> turned(const TissueModel& model, double angle_rad) {
  const Eigen::AngleAxisd turn(angle_rad, Vec3::UnitY());
  std::vector<Vec3> x;
  for (const Vec3& X : model.mesh.nodes) x.push_back(turn * X);
  return x;
}

std::vector<WarpingPoint> chart_warping(const TissueModel& held, const TissueModel& floating,
                                        const WarpingSettings& settings,
                                        const std::function<bool(double, const std::string&)>& progress) {
  constexpr double degree = std::numbers::pi / 180;
  const TissueModel clamped = held_at_one_end(floating);
  const Vec3 pole = anterior_pole(held);
  const Vec3 free_end = *std::max_element(held.mesh.nodes.begin(), held.mesh.nodes.end(),
                                          [](const Vec3& a, const Vec3& b) { return a.x() < b.x(); });
  std::vector<Shape> shapes;
  for (const double depth : settings.depths_mm)
    shapes.push_back({"indentation", depth, &held, pole, indented(held, depth * mm)});
  for (const double angle : settings.angles_deg)
    shapes.push_back({"bending", angle, &floating, pole, bent(floating, angle * degree)});
  for (const double angle : settings.angles_deg)
    shapes.push_back({"cantilever", angle, &clamped, free_end, cantilever(clamped, angle * degree)});
  for (const double angle : settings.angles_deg)
    shapes.push_back({"turning", angle, &floating, pole, turned(floating, angle * degree)});

  std::vector<WarpingPoint> points;
  for (const Shape& shape : shapes) {
    const TissueModel& model = *shape.model;
    const TissueState rest = rest_state(model);
    TissueState state = rest;
    state.x = shape.x;
    update_rotations(model, state);
    const std::vector<int> zone = nearest_live_nodes(model, rest, shape.place, settings.zone_nodes);
    const std::vector<int> patch = nearest_live_nodes(model, rest, shape.place, settings.patch_nodes);
    const int columns = std::min(settings.error_columns, 3 * static_cast<int>(patch.size()));
    const MatX oracle = oracle_columns(model, state, settings.h, patch, columns);
    WarpRotation turn(model);
    turn.set_reference(rest.rotation, model.tets_in_use);
    double largest = 0;
    for (const int n : patch) largest = std::max(largest, angle_of(turn(n, state)));

    for (const Variant& variant : variants) {
      ComplianceOptions options;
      options.warping = variant.warping;
      options.sample_every = 1 << 30;
      const auto compliance = make_compliance(variant.method, model, settings.h, options);
      compliance->move_zone(zone);
      compliance->update(rest);
      compliance->update(state);
      MatX block(3 * patch.size(), 3 * patch.size());
      compliance->patch(patch, block);
      points.push_back({shape.name, shape.amount, variant.name, variant.warping, largest,
                        (block.leftCols(columns) - oracle).norm() / oracle.norm()});
    }
    const double done =
        static_cast<double>(points.size()) / static_cast<double>(shapes.size() * std::size(variants));
    if (!progress(done, shape.name)) break;
  }
  return points;
}

}  // namespace hapticd
