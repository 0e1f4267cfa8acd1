#include "tools/chart/step/chart_factor.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>
#include <vector>

#include "physics/compliance/factor/cholmod_factor.h"
#include "physics/compliance/factor/multifrontal_factor.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

double ms_of(const auto& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
}

std::vector<int> nearest_to_the_pole(const TissueModel& model, int count) {
  std::vector<int> nodes;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) nodes.push_back(n);
  const std::vector<Vec3>& x = model.mesh.nodes;
  const int pole =
      *std::max_element(nodes.begin(), nodes.end(), [&](int a, int b) { return x[a].z() < x[b].z(); });
  std::sort(nodes.begin(), nodes.end(),
            [&](int a, int b) { return (x[a] - x[pole]).norm() < (x[b] - x[pole]).norm(); });
  nodes.resize(std::min<std::size_t>(nodes.size(), count));
  return nodes;
}

template <class Factor>
double residual(Factor& factor, const SystemMatrix& A) {
  VecX b(3 * A.node_count());
  for (int i = 0; i < b.size(); ++i) b[i] = std::cos(0.7 * i);
  for (int n = 0; n < A.node_count(); ++n)
    factor.vector().template segment<3>(3 * factor.place(n)) = b.segment<3>(3 * n);
  factor.solve();
  VecX y(b.size());
  for (int n = 0; n < A.node_count(); ++n)
    y.segment<3>(3 * n) = factor.vector().template segment<3>(3 * factor.place(n));
  return (A.multiply(y) - b).norm() / b.norm();
}

}  // namespace

FactorFigures chart_factor(const TissueModel& model, int zone_nodes, int repeats) {
  const std::vector<int> zone = nearest_to_the_pole(model, zone_nodes);
  const NodeGraph graph = node_graph(model);
  SystemMatrix A(model, graph, 0.02);
  A.assemble(rest_state(model));
  const std::vector<int> order = zone_last_order(graph, fill_reducing_order(graph), zone);

  MultifrontalFactor own;
  CholmodFactor cholmod;
  std::vector<double> own_ms, cholmod_ms, plan_ms, cholmod_plan_ms;
  for (int k = 0; k < repeats; ++k) {
    plan_ms.push_back(ms_of([&] { own.set_order(A, order, {}, static_cast<int>(zone.size())); }));
    cholmod_plan_ms.push_back(ms_of([&] { cholmod.set_order(A, order); }));
    own.factor(A);
    cholmod.factor(A);
    own_ms.push_back(ms_of([&] { own.factor(A); }));
    cholmod_ms.push_back(ms_of([&] { cholmod.factor(A); }));
  }
  FactorFigures figures;
  figures.nodes = model.node_count();
  figures.zone_nodes = static_cast<int>(zone.size());
  figures.kernels = front_kernels().name;
  figures.own_ms = quantiles(own_ms).p50;
  figures.cholmod_ms = quantiles(cholmod_ms).p50;
  figures.plan_ms = quantiles(plan_ms).p50;
  figures.cholmod_plan_ms = quantiles(cholmod_plan_ms).p50;
  figures.own_residual = residual(own, A);
  figures.cholmod_residual = residual(cholmod, A);
  return figures;
}

}  // namespace hapticd
