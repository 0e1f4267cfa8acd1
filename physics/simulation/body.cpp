#include "physics/simulation/body.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "physics/simulation/region/body_regions.h"

namespace hapticd {
namespace {

constexpr double sleeping_speed = 1e-5;  // [m/s]

TissueModel model_of(BodySettings& s, const Vec3& gravity) {
  TissueModel model;
  if (s.start) {
    model = s.start->model;
    model.corotational = s.corotational;
    model.dynamic = s.dynamic;
    return model;
  }
  if (s.deformable) {
    model = make_tissue_model(std::move(s.mesh), s.material, s.fixed_nodes, gravity, s.room);
    model.corotational = s.corotational;
    model.dynamic = s.dynamic;
    for (const TissueRegion& region : s.regions) set_region(model, region);
    set_springs(model, s.springs);
    return model;
  }
  model.mesh = std::move(s.mesh);
  return model;
}

double mean_edge(const TetMesh& mesh) {
  double sum = 0;
  int tets = 0;
  for (const Tet& t : mesh.tets) {
    if (t == no_tet) continue;
    ++tets;
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < a; ++b) sum += (mesh.nodes[t[a]] - mesh.nodes[t[b]]).norm();
  }
  return tets == 0 ? 0 : sum / (6.0 * tets);
}

double mean_volume_of(const TissueModel& model) {
  double sum = 0;
  for (int t = 0; t < model.tets_in_use; ++t) sum += model.volume[t];
  return sum / std::max(1, model.tets_in_use);
}

TissueState state_of(const TissueModel& model, bool deformable, const BodyStart* start) {
  if (start) {
    TissueState state = start->state;
    if (!model.corotational) std::fill(state.rotation.begin(), state.rotation.end(), Mat3::Identity());
    return state;
  }
  if (deformable) return rest_state(model);
  TissueState state;
  state.x = model.mesh.nodes;
  return state;
}

}  // namespace

Body::Body(BodySettings settings, double h, const Vec3& gravity, ComplianceMethod method,
           const ComplianceOptions& options)
    : name(std::move(settings.name)),
      deformable(settings.deformable),
      friction(settings.friction),
      removable(settings.removable),
      toughness(settings.deformable && !settings.start ? settings.toughness : 0),
      cutting_viscosity(settings.cutting_viscosity),
      tearing(settings.start ? TearSettings() : settings.tearing),
      model(model_of(settings, gravity)),
      edge(mean_edge(model.mesh)),
      mean_volume(deformable ? mean_volume_of(model) : 0),
      state(state_of(model, deformable, settings.start.get())),
      surface(settings.start ? settings.start->surface : BoundarySurface(model.mesh)),
      references(nullptr) {
  if (settings.start && !deformable)
    throw std::invalid_argument(name + ": a rigid body has no state to begin from");
  if (removable && !deformable) throw std::invalid_argument(name + ": a rigid body cannot be removable");
  if (removable && !model.dynamic)
    throw std::invalid_argument(name +
                                ": a static body cannot be removable: pieces cut loose need their mass");
  if (!deformable) return;
  if (settings.near && !settings.start) {
    if (settings.near->follows)
      regions = begin_regions(model, *settings.near);
    else
      condense_far(model, state, *settings.near);
  }
  if (regions) use_condensed(model, state, regions->in_use);
  if (settings.start) regions = settings.start->regions;
  compliance = make_compliance(method, model, h, options);
  references = as_reference_compliance(compliance.get());
  free.dx = VecX::Zero(3 * model.node_count());
  scratch.force = free.dx;
  times = options.times;
}

std::shared_ptr<const BodyStart> start_of(const Body& body) {
  return std::make_shared<const BodyStart>(BodyStart{body.model, body.state, body.surface});
}

std::shared_ptr<const BodyStart> first_start_of(const Body& body) {
  if (!body.model.condensed) return nullptr;
  if (!body.regions)  // nothing of what is condensed goes
    return std::make_shared<const BodyStart>(
        BodyStart{body.model, rest_state(body.model), BoundarySurface(body.model.mesh)});
  auto start =
      std::make_shared<BodyStart>(BodyStart{*body.regions->whole, rest_state(*body.regions->whole),
                                            BoundarySurface(body.model.mesh), as_at_first(*body.regions)});
  use_condensed(start->model, start->state, start->regions->in_use);
  return start;
}

bool at_rest(const Body& body) {
  return body.energy.bounded_steps == 0 &&
         std::all_of(body.state.v.begin(), body.state.v.end(),
                     [](const Vec3& v) { return v.squaredNorm() < sleeping_speed * sleeping_speed; });
}

std::vector<int> take_out(Body& body, std::span<const int> tets) {
  std::vector<int> went;
  for (const int t : tets)
    if (body.state.alive[t] && std::find(went.begin(), went.end(), t) == went.end()) went.push_back(t);
  body.surface.remove(tets);
  body.asleep = false;
  remove_tets(body.model, body.state, went);
  if (!went.empty()) body.energy.elastic.resize(0);
  return went;
}

int remove_from(Body& body, std::span<const int> tets) {
  const std::vector<int> went = take_out(body, tets);
  if (!went.empty()) body.compliance->remove(body.state, went);
  return static_cast<int>(went.size());
}

}  // namespace hapticd
