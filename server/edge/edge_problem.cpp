#include "server/edge/edge_problem.h"

#include <algorithm>
#include <cmath>

#include "haptic/contact/problem_check.h"
#include "server/dds/borrowed.h"
#include "server/edge/edge_topics.h"

namespace hapticd {
namespace {

constexpr std::uint8_t no_node = 255;
constexpr double whole = 32767;  // c_ij of 1
static_assert(max_patch_nodes < no_node);
// The bounds in idl/edge.idl.
static_assert(max_patch_nodes == 192 && max_patch_samples == 2048 && max_edge_samples == 32 &&
              max_instruments == 4);

template <int N>
void put(const Eigen::Matrix<double, N, 1>& from, double* to) {
  for (int i = 0; i < N; ++i) to[i] = from[i];
}

void put(const Vec3& from, std::vector<float>& to) {
  for (int i = 0; i < 3; ++i) to.push_back(static_cast<float>(from[i]));
}

Vec3 vec3(const float* from) noexcept { return {from[0], from[1], from[2]}; }
Vec3 vec3(const double* from) noexcept { return {from[0], from[1], from[2]}; }

hapticd_msg_ProblemInstrument message_of(const InstrumentReference& i) {
  hapticd_msg_ProblemInstrument m{};
  put<3>(i.X_ref.p, m.position);
  put<4>(i.X_ref.q.coeffs(), m.orientation);
  m.stiffness = i.coupling.stiffness;
  m.rotational_stiffness = i.coupling.rotational_stiffness;
  m.damping_time = i.coupling.damping_time;
  put<6>(i.load, m.load);
  put<6>(i.way, m.way);
  return m;
}

InstrumentReference instrument_of(const hapticd_msg_ProblemInstrument& m) noexcept {
  InstrumentReference i;
  i.X_ref.p = vec3(m.position);
  i.X_ref.q.coeffs() = Eigen::Map<const Eigen::Vector4d>(m.orientation);
  i.coupling = {m.stiffness, m.rotational_stiffness, m.damping_time};
  i.load = Eigen::Map<const Vec6>(m.load);
  i.way = Eigen::Map<const Vec6>(m.way);
  return i;
}

hapticd_msg_ProblemEdge message_of(const EdgeSample& e) {
  hapticd_msg_ProblemEdge m{};
  m.id = e.id;
  m.instrument = static_cast<std::uint8_t>(e.instrument);
  m.body = static_cast<std::uint32_t>(e.body);
  for (int a = 0; a < 4; ++a) {
    m.node[a] = static_cast<std::uint8_t>(e.node[a]);
    m.weight[a] = e.weight[a];
  }
  put<3>(e.place, m.place);
  put<3>(e.direction, m.direction);
  m.limit = e.limit;
  m.advance = e.advance;
  m.viscosity = e.viscosity;
  return m;
}

EdgeSample edge_of(const hapticd_msg_ProblemEdge& m) noexcept {
  EdgeSample e{};
  e.id = m.id;
  e.instrument = m.instrument;
  e.body = static_cast<std::int32_t>(m.body & 0x7fffffff);
  for (int a = 0; a < 4; ++a) {
    e.node[a] = m.node[a];
    e.weight[a] = m.weight[a];
  }
  e.place = vec3(m.place);
  e.direction = vec3(m.direction);
  e.limit = m.limit;
  e.advance = m.advance;
  e.viscosity = m.viscosity;
  return e;
}

bool share_a_face(const PatchSample& a, const PatchSample& b) {
  return a.node == b.node && a.outward == b.outward && a.friction == b.friction;
}

// A face that samples begin with.
hapticd_msg_ProblemFace face_of(const PatchSample& s) {
  hapticd_msg_ProblemFace f{};
  f.first_id = s.id;
  for (int i = 0; i < 3; ++i) {
    f.outward[i] = static_cast<float>(s.outward[i]);
    f.node[i] = s.node[i] < 0 ? no_node : static_cast<std::uint8_t>(s.node[i]);
  }
  f.friction = static_cast<float>(s.friction);
  return f;
}

template <typename Sequence>
bool has(const Sequence& sequence, std::size_t length) noexcept {
  return sequence._length == length && (length == 0 || sequence._buffer);
}

bool lengths_fit(const hapticd_msg_EdgeProblem& m, int instruments) noexcept {
  const std::size_t n = m.nodes;
  return n <= max_patch_nodes && has(m.instruments, static_cast<std::size_t>(instruments)) &&
         has(m.positions, 6 * n) && (m.pull._length == 0 || has(m.pull, 3 * n)) && has(m.own, 3 * n) &&
         has(m.shared, 3 * n * (n > 0 ? 3 * n - 1 : 0) / 2) && m.edges._length <= max_edge_samples &&
         has(m.edges, m.edges._length) && m.offsets._length <= max_patch_samples &&
         has(m.offsets, m.offsets._length) && m.faces._length <= m.offsets._length &&
         has(m.faces, m.faces._length) && has(m.places, m.places._length);
}

// False where faces, samples and places do not come out even, or ids do not rise.
bool read_samples(const hapticd_msg_EdgeProblem& m, const Vec3& origin, CondensedProblem& p) noexcept {
  std::uint32_t place = 0;
  p.samples = 0;
  for (std::uint32_t f = 0; f < m.faces._length; ++f) {
    const hapticd_msg_ProblemFace& face = m.faces._buffer[f];
    const bool obstacle = face.node[0] == no_node;
    const std::uint32_t each = obstacle ? 3 : 2;
    if (p.samples + face.samples > static_cast<int>(m.offsets._length) ||
        place + each * face.samples > m.places._length)
      return false;
    for (int k = 0; k < face.samples; ++k, place += each) {
      PatchSample& s = p.sample[static_cast<std::size_t>(p.samples)];
      const float* at = m.places._buffer + place;
      s.id = face.first_id + m.offsets._buffer[p.samples];
      if (p.samples > 0 && s.id <= p.sample[static_cast<std::size_t>(p.samples) - 1].id) return false;
      for (int i = 0; i < 3; ++i) s.node[i] = obstacle ? -1 : face.node[i];
      s.weight = {at[0], at[1], 1 - double{at[0]} - double{at[1]}};
      s.free.setZero();
      if (obstacle) {
        s.weight = {1, 0, 0};
        s.free = origin + vec3(at);
      }
      s.outward = vec3(face.outward);
      s.friction = face.friction;
      ++p.samples;
    }
  }
  return p.samples == static_cast<int>(m.offsets._length) && place == m.places._length;
}

// False where √C_ii is below zero or NaN.
bool read_compliance(const hapticd_msg_EdgeProblem& m, CondensedProblem& p) noexcept {
  const float* const own = m.own._buffer;
  const std::int16_t* next = m.shared._buffer;
  auto C = p.C();
  for (int j = 0; j < 3 * p.nodes; ++j) {
    if (!(own[j] >= 0)) return false;
    C(j, j) = double{own[j]} * own[j];
    for (int i = j + 1; i < 3 * p.nodes; ++i) C(i, j) = C(j, i) = *next++ / whole * own[i] * own[j];
  }
  return true;
}

}  // namespace

void PackedProblem::put_samples(const CondensedProblem& p) {
  faces_.clear();
  offsets_.clear();
  places_.clear();
  for (int k = 0; k < p.samples; ++k) {
    const PatchSample& s = p.sample[static_cast<std::size_t>(k)];
    const bool goes_on = k > 0 && share_a_face(p.sample[static_cast<std::size_t>(k) - 1], s) &&
                         s.id - faces_.back().first_id <= 0xffff;
    if (!goes_on) faces_.push_back(face_of(s));
    ++faces_.back().samples;
    offsets_.push_back(static_cast<std::uint16_t>(s.id - faces_.back().first_id));
    if (s.node[0] < 0) {
      put(s.free - origin_, places_);
    } else {
      places_.push_back(static_cast<float>(s.weight[0]));
      places_.push_back(static_cast<float>(s.weight[1]));
    }
  }
}

// What is no number is sent as one that the reader refuses.
void PackedProblem::put_compliance(const CondensedProblem& p) {
  const auto C = p.C();
  const int size = 3 * p.nodes;
  own_.resize(static_cast<std::size_t>(size));
  shared_.resize(static_cast<std::size_t>(size) * static_cast<std::size_t>(std::max(0, size - 1)) / 2);
  bool numbers = true;
  for (int i = 0; i < size; ++i) own_[static_cast<std::size_t>(i)] = static_cast<float>(std::sqrt(C(i, i)));
  std::int16_t* next = shared_.data();
  for (int j = 0; j < size; ++j)
    for (int i = j + 1; i < size; ++i) {
      const double both = double{own_[static_cast<std::size_t>(i)]} * own_[static_cast<std::size_t>(j)];
      const double c = both > 0 ? 0.5 * (C(i, j) + C(j, i)) / both : 0;
      numbers = numbers && std::isfinite(c);
      *next++ =
          std::isfinite(c) ? static_cast<std::int16_t>(std::lround(whole * std::clamp(c, -1.0, 1.0))) : 0;
    }
  if (!numbers) own_[0] = -1;
}

hapticd_msg_EdgeProblem& PackedProblem::pack(const CondensedProblem& p, int instruments) {
  hapticd_msg_EdgeProblem& m = message_;
  origin_ = p.nodes > 0 ? p.x_now[0] : p.instrument[0].X_ref.p;
  instruments_.clear();
  for (int i = 0; i < instruments; ++i) instruments_.push_back(message_of(p.instrument[i]));
  positions_.clear();
  pull_.clear();
  bool pulled = false;
  for (int n = 0; n < p.nodes; ++n) {
    const auto k = static_cast<std::size_t>(n);
    put(p.x_free[k] - origin_, positions_);
    put(p.x_now[k] - origin_, positions_);
    put(p.pull[k], pull_);
    pulled = pulled || !p.pull[k].isZero(0);
  }
  if (!pulled) pull_.clear();
  put_samples(p);
  put_compliance(p);
  edges_.clear();
  for (int k = 0; k < p.edges; ++k) edges_.push_back(message_of(p.edge[static_cast<std::size_t>(k)]));

  m.version = edge_version;
  m.number = p.step;
  m.published_ns = p.published_ns;
  m.frozen = p.renewal == Renewal::frozen;
  m.topology_changed = p.topology_changed;
  m.thinned = p.thinned;
  m.nodes = static_cast<std::uint16_t>(p.nodes);
  m.dropped_samples = static_cast<std::uint32_t>(p.dropped_samples);
  m.alarm_distance = p.alarm_distance;
  m.instrument_friction = p.instrument_friction;
  put<3>(origin_, m.origin);
  m.instruments = borrowed<decltype(m.instruments)>(instruments_);
  m.positions = borrowed<decltype(m.positions)>(positions_);
  m.pull = borrowed<decltype(m.pull)>(pull_);
  m.faces = borrowed<decltype(m.faces)>(faces_);
  m.offsets = borrowed<decltype(m.offsets)>(offsets_);
  m.places = borrowed<decltype(m.places)>(places_);
  m.edges = borrowed<decltype(m.edges)>(edges_);
  m.own = borrowed<decltype(m.own)>(own_);
  m.shared = borrowed<decltype(m.shared)>(shared_);
  return m;
}

std::size_t PackedProblem::bytes() const noexcept {
  constexpr std::size_t head = 144, edge = 152;  // with the sequences' lengths and what aligns them
  return head + sizeof(hapticd_msg_ProblemInstrument) * instruments_.size() +
         4 * (positions_.size() + pull_.size() + places_.size() + own_.size()) + 2 * shared_.size() +
         32 * faces_.size() + 2 * offsets_.size() + edge * edges_.size();
}

const char* to_string(ProblemFault fault) noexcept {
  switch (fault) {
    case ProblemFault::none:
      return "none";
    case ProblemFault::version:
      return "of another version";
    case ProblemFault::counts:
      return "counts that do not belong together";
    case ProblemFault::unsound:
      return "unsound";
  }
  return "";
}

ProblemFault read_problem(const hapticd_msg_EdgeProblem& m, int instruments, CondensedProblem& p) noexcept {
  if (m.version != edge_version) return ProblemFault::version;
  if (m.number == 0 || !lengths_fit(m, instruments)) return ProblemFault::counts;
  const Vec3 origin = vec3(m.origin);
  p.step = m.number;
  p.published_ns = m.published_ns;
  p.renewal = m.frozen ? Renewal::frozen : Renewal::renewed;
  p.topology_changed = m.topology_changed;
  p.thinned = m.thinned;
  p.nodes = m.nodes;
  p.dropped_samples = static_cast<int>(std::min<std::uint32_t>(m.dropped_samples, 1u << 30));
  p.alarm_distance = m.alarm_distance;
  p.instrument_friction = m.instrument_friction;
  p.instrument = {};
  p.known.count = 0;
  p.known.outside = {};
  for (int i = 0; i < instruments; ++i) p.instrument[i] = instrument_of(m.instruments._buffer[i]);
  for (int n = 0; n < p.nodes; ++n) {
    const auto k = static_cast<std::size_t>(n);
    p.x_free[k] = origin + vec3(m.positions._buffer + 6 * n);
    p.x_now[k] = origin + vec3(m.positions._buffer + 6 * n + 3);
    p.pull[k] = m.pull._length == 0 ? Vec3(Vec3::Zero()) : vec3(m.pull._buffer + 3 * n);
  }
  if (!read_samples(m, origin, p)) return ProblemFault::counts;
  p.edges = static_cast<int>(m.edges._length);
  for (int k = 0; k < p.edges; ++k) p.edge[static_cast<std::size_t>(k)] = edge_of(m.edges._buffer[k]);
  return read_compliance(m, p) && is_sound(p) ? ProblemFault::none : ProblemFault::unsound;
}

}  // namespace hapticd
