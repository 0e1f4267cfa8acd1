// Worlds of bodies that touch one another, for tests: blocks, inclines, walls.
//
// Units: SI.
#pragma once

#include <memory>
#include <vector>

#include "physics/simulation/world.h"

namespace hapticd {

// A sphere that holds its place, and one far from everything.
Instrument ball(double radius);
InstrumentSample at(const Vec3& p);
InstrumentSample nobody();

// A floating block [0, size] of this material, n cells each way, then moved: x ← q x + p.
BodySettings block(const std::string& name, const Vec3& size, const std::array<int, 3>& n,
                   const Material& material, const Pose& place = {});

// A fixed obstacle of the same kind.
BodySettings slab(const std::string& name, const Vec3& size, const std::array<int, 3>& n,
                  const Pose& place = {});

// h = 20 ms, no gravity, no alarm, these pairs.
WorldSettings contact_world(std::vector<ContactPair> pairs);

double mass_of(const Body& body);       // [kg]
Vec3 centre_of(const Body& body);       // of mass [m]
Vec3 velocity_of(const Body& body);     // of the centre of mass [m/s]
double fastest_node(const Body& body);  // [m/s]

// How deep the surface nodes of one body are inside another, by looking at every face; 0: none is [m].
double deepest_inside(const Body& points, const Body& faces);

}  // namespace hapticd
