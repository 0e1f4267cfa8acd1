#include "tools/offline/reference_cache.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "physics/simulation/body.h"
#include "server/files/paths.h"
#include "tools/cli/report.h"

namespace hapticd {

namespace {

class Hash {
 public:
  void bytes(const void* data, std::size_t size) {
    const auto* p = static_cast<const unsigned char*>(data);
    for (std::size_t i = 0; i < size; ++i) value_ = (value_ ^ p[i]) * 1099511628211u;
  }
  template <typename T>
  void number(T x) {
    static_assert(std::is_arithmetic_v<T>);
    bytes(&x, sizeof x);
  }
  void vector(const Vec3& v) { bytes(v.data(), sizeof(double) * 3); }
  void pose(const Pose& X) {
    vector(X.p);
    bytes(X.q.coeffs().data(), sizeof(double) * 4);
  }
  void start(const BodyStart& from) {
    for (const Tet& t : from.model.mesh.tets) bytes(t.data(), sizeof t);
    for (const Vec3& x : from.state.x) vector(x);
    for (const Vec3& v : from.state.v) vector(v);
    bytes(from.state.alive.data(), from.state.alive.size());
  }
  std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 14695981039346656037u;
};

std::uint64_t program_hash() {
  static const std::uint64_t value = [] {
    Hash h;
    const std::string program = read_bytes("/proc/self/exe");
    h.bytes(program.data(), program.size());
    return h.value();
  }();
  return value;
}

std::string to_csv(const OfflineResult& r) {
  std::ostringstream csv;
  const auto hands = std::count_if(r.hands.value.begin(), r.hands.value.end(),
                                   [](const std::vector<OfflineTick>& ticks) { return !ticks.empty(); });
  csv.precision(17);
  csv << r.removed << ',' << r.inverted << ',' << r.capped << ',' << r.dropped_samples << ','
      << r.memory_bytes << ',' << r.simulation.total << ',' << hands << ',' << r.ticks().size() << ','
      << r.cut_area << '\n';
  for (int i = 0; i < hands; ++i)
    for (const OfflineTick& t : r.hands[i]) {
      csv << t.t;
      for (int c = 0; c < 6; ++c) csv << ',' << t.wrench[c];
      csv << ',' << t.penetration << ',' << t.residual << ',' << t.active << '\n';
    }
  return csv.str();
}

bool parse(const std::string& line, std::vector<double>& values, std::size_t count) {
  values.clear();
  std::istringstream in(line);
  for (std::string word; std::getline(in, word, ',');) values.push_back(std::strtod(word.c_str(), nullptr));
  return values.size() == count;
}

bool read(const std::filesystem::path& file, OfflineResult& r) {
  std::ifstream in(file);
  std::string line;
  std::vector<double> v;
  if (!in || !std::getline(in, line) || !parse(line, v, 9)) return false;
  r.removed = static_cast<int>(v[0]);
  r.inverted = static_cast<int>(v[1]);
  r.capped = static_cast<int>(v[2]);
  r.dropped_samples = static_cast<int>(v[3]);
  r.memory_bytes = static_cast<std::size_t>(v[4]);
  r.simulation.total = v[5];
  const auto hands = static_cast<int>(v[6]);
  const auto count = static_cast<std::size_t>(v[7]);
  r.cut_area = v[8];
  std::size_t lines = 0;
  if (hands < 1 || hands > max_instruments) return false;
  for (; std::getline(in, line) && lines < hands * count; ++lines) {
    if (!parse(line, v, 10)) return false;
    OfflineTick t;
    t.t = v[0];
    for (int c = 0; c < 6; ++c) t.wrench[c] = v[1 + c];
    t.penetration = v[7];
    t.residual = v[8];
    t.active = static_cast<int>(v[9]);
    t.swapped = true;
    r.hands[static_cast<int>(lines / count)].push_back(t);
  }
  return lines == hands * count;
}

}  // namespace

std::uint64_t reference_key(const Scene& scene, const OfflineInput& input, double h) {
  Hash hash;
  hash.number(program_hash());
  hash.number(h);
  for (const SceneBody& b : scene.bodies) {
    hash.number(static_cast<int>(b.kind));
    for (const Vec3& x : b.mesh.nodes) hash.vector(x);
    for (const Tet& t : b.mesh.tets) hash.bytes(t.data(), sizeof t);
    for (const int n : b.fixed_nodes) hash.number(n);
    for (const double x :
         {b.material.young, b.material.poisson, b.material.density, b.material.rayleigh_mass,
          b.material.rayleigh_stiffness, b.friction, b.toughness, b.tearing.toughness, b.tearing.radius})
      hash.number(x);
    for (const TissueRegion& r : b.regions) {
      for (const double x : {r.material.young, r.material.poisson, r.material.density}) hash.number(x);
      hash.vector(r.stretch);
      hash.bytes(r.tets.data(), r.tets.size() * sizeof(int));
    }
    for (const NodeSpring& spring : b.springs) {
      hash.number(spring.stiffness);
      hash.vector(spring.anchor);
    }
    if (b.near) {
      hash.vector(b.near->centre);
      hash.number(b.near->radius);
      hash.number(b.near->follows);
    }
    hash.number(b.tearing.begins);
    hash.bytes(b.tearing.clefts.data(), b.tearing.clefts.size());
    hash.number(b.corotational);
    hash.number(b.max_new_nodes);
    if (b.start) hash.start(*b.start);
  }
  for (const ContactPair& p : scene.contacts) {
    hash.number(p.points);
    hash.number(p.faces);
    hash.number(p.friction);
  }
  for (const SceneInstrument& held : scene.instruments) {
    for (const Primitive& p : held.shape.primitives) {
      hash.number(static_cast<int>(p.shape));
      hash.number(p.radius);
      hash.number(p.half_length);
      hash.pose(p.placement);
      for (const Vec3& v : p.vertices) hash.vector(v);
    }
    const Port& port = held.shape.port;
    for (const double x : {port.radius, port.reach, port.vacuum, port.rise_time, port.flow, port.lumen})
      hash.number(x);
    hash.vector(port.position);
    hash.vector(port.direction);
    const Incision& ring = held.shape.incision;
    for (const double x : {ring.slack, ring.stiffness, ring.friction}) hash.number(x);
    hash.vector(ring.at);
    hash.vector(ring.axis);
    for (const Vec3& p : held.shape.blade.edge) hash.vector(p);
    hash.vector(held.shape.blade.direction);
    hash.number(held.shape.blade.sample.size());
    for (const double x :
         {held.coupling.stiffness, held.coupling.rotational_stiffness, held.coupling.damping_time})
      hash.number(x);
  }
  for (const double x : {scene.alarm_distance, scene.sample_spacing, scene.instrument_friction, input.from,
                         input.to, input.settle})
    hash.number(x);
  hash.vector(scene.gravity);
  hash.number(input.leads_in);
  hash.number(static_cast<int>(input.pedals));
  for (int i = 0; i < max_instruments; ++i) {
    hash.number(input.approach[i]);
    for (const TrajectorySample& s : input.motion[i].samples) {
      hash.number(s.t);
      hash.number(s.buttons);
      hash.pose(s.pose);
    }
  }
  for (const RemovalEvent& e : input.removals) {
    hash.number(e.t);
    hash.number(e.body);
    hash.number(e.time);
    for (const int t : e.tets) hash.number(t);
  }
  return hash.value();
}

OfflineResult cached_reference(const std::filesystem::path& directory, const Scene& scene,
                               const OfflineInput& input, double h, const OfflineProgress& progress) {
  if (directory.empty()) return run_reference(scene, input, h, progress);
  char name[40];
  std::snprintf(name, sizeof name, "%016llx.csv",
                static_cast<unsigned long long>(reference_key(scene, input, h)));
  const std::filesystem::path file = directory / name;
  OfflineResult result;
  if (read(file, result)) return result;
  bool whole = true;
  result = run_reference(scene, input, h, [&](double fraction) {
    whole = !progress || progress(fraction);
    return whole;
  });
  if (!whole) return result;
  std::filesystem::create_directories(directory);
  write_file(file.string(), to_csv(result));
  return result;
}

}  // namespace hapticd
