#include "server/record/contact_capture_file.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <tuple>

#include "server/files/input_error.h"

namespace hapticd {
namespace {

constexpr char magic[8] = {'H', 'A', 'P', 'T', 'I', 'C', 'L', 'C'};
constexpr std::uint32_t version = 7, byte_order = 0x01020304;
constexpr std::uint32_t max_primitives = 64, max_vertices = 4096;

// One description of the layout for both directions: `put` of the writer appends, of the reader takes.
class FileWriter {
 public:
  template <typename T>
  void put(T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    const auto* bytes = reinterpret_cast<const char*>(&value);
    bytes_.insert(bytes_.end(), bytes, bytes + sizeof value);
  }
  void numbers(double* first, std::size_t count) {
    const auto* bytes = reinterpret_cast<const char*>(first);
    bytes_.insert(bytes_.end(), bytes, bytes + count * sizeof(double));
  }
  std::uint32_t length(std::size_t count, std::uint32_t, const char*) {
    auto n = static_cast<std::uint32_t>(count);
    put(n);
    return n;
  }
  void expect(bool, const char*) {}
  std::uint32_t written_as() const { return version; }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

class FileReader {
 public:
  FileReader(std::filesystem::path file, std::string bytes)
      : file_(std::move(file)), bytes_(std::move(bytes)) {}

  template <typename T>
  void put(T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    std::memcpy(&value, take(sizeof value), sizeof value);
    if constexpr (std::is_floating_point_v<T>) expect(std::isfinite(value), "a number is not finite");
  }
  void numbers(double* first, std::size_t count) {
    std::memcpy(first, take(count * sizeof(double)), count * sizeof(double));
    for (std::size_t k = 0; k < count; ++k) expect(std::isfinite(first[k]), "a number is not finite");
  }
  std::uint32_t length(std::size_t, std::uint32_t most, const char* of) {
    std::uint32_t n = 0;
    put(n);
    if (n > most)
      fail(std::string(of) + ": " + std::to_string(n) + ", more than the " + std::to_string(most) +
           " there may be");
    return n;
  }
  void expect(bool holds, const char* otherwise) {
    if (!holds) fail(otherwise);
  }
  void finish() { expect(at_ == bytes_.size(), "longer than a captured problem of its lengths"); }
  std::uint32_t written_as() const { return written_as_; }
  void set_written_as(std::uint32_t file_version) { written_as_ = file_version; }
  [[noreturn]] void fail(const std::string& what) const { throw InputError(file_, 0, "", what); }

 private:
  const char* take(std::size_t count) {
    expect(count <= bytes_.size() - at_, "ends in the middle of a captured problem");
    at_ += count;
    return bytes_.data() + at_ - count;
  }

  std::filesystem::path file_;
  std::string bytes_;
  std::size_t at_ = 0;
  std::uint32_t written_as_ = version;
};

template <typename File>
void layout(File& f, Vec3& v) {
  f.numbers(v.data(), 3);
}

template <typename File>
void layout(File& f, Pose& X) {
  f.numbers(X.p.data(), 3);
  f.numbers(X.q.coeffs().data(), 4);
  f.expect(std::abs(X.q.norm() - 1) < 1e-6, "an orientation is not a unit quaternion");
}

template <typename File>
void layout(File& f, Primitive& p) {
  f.put(p.shape);
  f.expect(p.shape >= Shape::sphere && p.shape <= Shape::convex, "a primitive of an unknown shape");
  f.put(p.radius);
  f.put(p.half_length);
  layout(f, p.placement);
  p.vertices.resize(f.length(p.vertices.size(), max_vertices, "vertices of a primitive"));
  for (Vec3& v : p.vertices) layout(f, v);
  p.planes.resize(f.length(p.planes.size(), max_vertices, "planes of a primitive"));
  for (Eigen::Vector4d& n : p.planes) f.numbers(n.data(), 4);
}

template <typename File>
void layout(File& f, Incision& ring) {
  layout(f, ring.at);
  layout(f, ring.axis);
  f.put(ring.slack);
  f.put(ring.stiffness);
  f.put(ring.friction);
  f.expect(ring.slack >= 0 && ring.stiffness >= 0 && ring.friction >= 0,
           "an incision with a negative number");
}

template <typename File>
void layout(File& f, PatchSample& s, int nodes) {
  f.put(s.id);
  for (int a = 0; a < 3; ++a) f.put(s.node[a]);
  for (const std::int32_t n : s.node)
    f.expect(s.node[0] < 0 || (n >= 0 && n < nodes), "a sample of a node that is not there");
  f.numbers(s.weight.data(), 3);
  layout(f, s.free);
  layout(f, s.outward);
  f.put(s.friction);
}

template <typename File>
void layout(File& f, EdgeSample& e, int nodes, int instruments) {
  f.put(e.id);
  f.put(e.instrument);
  f.expect(is_edge(e.id) && e.instrument >= 0 && e.instrument < instruments,
           "an edge of an instrument that is not there");
  f.put(e.body);
  for (std::int32_t& n : e.node) {
    f.put(n);
    f.expect(n >= 0 && n < nodes, "an edge at a node that is not there");
  }
  f.numbers(e.weight.data(), 4);
  layout(f, e.place);
  layout(f, e.direction);
  f.put(e.limit);
  f.expect(e.limit >= 0, "an edge with a limit below zero");
  f.put(e.advance);
  if (f.written_as() >= 5) f.put(e.viscosity);
}

template <typename File>
void layout(File& f, VirtualCoupling& c) {
  f.put(c.stiffness);
  f.put(c.rotational_stiffness);
  f.put(c.damping_time);
}

template <typename File>
void layout(File& f, CondensedProblem& p, int instruments) {
  f.put(p.step);
  f.put(p.published_ns);
  layout(f, p.instrument[0].X_ref);
  f.put(p.renewal);
  f.expect(p.renewal == Renewal::frozen || p.renewal == Renewal::renewed, "an unknown renewal");
  std::uint8_t changed = p.topology_changed;
  f.put(changed);
  p.topology_changed = changed != 0;
  f.put(p.alarm_distance);
  layout(f, p.instrument[0].coupling);
  for (int i = 1; i < instruments; ++i) {
    layout(f, p.instrument[i].X_ref);
    layout(f, p.instrument[i].coupling);
  }
  if (f.written_as() >= 3) f.put(p.instrument_friction);
  f.put(p.dropped_samples);
  p.nodes = static_cast<int>(f.length(static_cast<std::size_t>(p.nodes), max_patch_nodes, "patch nodes"));
  for (int n = 0; n < p.nodes; ++n) layout(f, p.x_free[n]);
  for (int n = 0; n < p.nodes; ++n) layout(f, p.x_now[n]);
  f.numbers(p.C_pp.data(), static_cast<std::size_t>(9 * p.nodes * p.nodes));
  p.samples =
      static_cast<int>(f.length(static_cast<std::size_t>(p.samples), max_patch_samples, "patch samples"));
  for (int k = 0; k < p.samples; ++k) {
    layout(f, p.sample[k], p.nodes);
    f.expect(k == 0 || p.sample[k - 1].id < p.sample[k].id, "samples that are not in the order of their ids");
  }
  if (f.written_as() < 4) return;
  p.edges = static_cast<int>(f.length(static_cast<std::size_t>(p.edges), max_edge_samples, "edge samples"));
  for (int k = 0; k < p.edges; ++k) {
    layout(f, p.edge[k], p.nodes, instruments);
    f.expect(k == 0 || p.edge[k - 1].id < p.edge[k].id, "edges that are not in the order of their ids");
  }
}

template <typename File>
void layout(File& f, ContactState& s, const std::vector<Instrument>& instruments) {
  ContactMemory& m = s.memory;
  m.count =
      static_cast<int>(f.length(static_cast<std::size_t>(m.count), max_contacts, "remembered contacts"));
  for (int k = 0; k < m.count; ++k) {
    ContactMemory::Entry& e = m.entry[k];
    f.put(e.id);
    if (f.written_as() >= 2)
      f.put(e.primitive);
    else
      e.primitive = 0;
    if (f.written_as() >= 3)
      f.put(e.instrument);
    else
      e.instrument = 0;
    f.expect(e.instrument >= 0 && static_cast<std::size_t>(e.instrument) < instruments.size(),
             "a contact of an instrument that is not there");
    const auto& primitives = instruments[static_cast<std::size_t>(e.instrument)].primitives;
    f.expect(
        e.primitive >= 0 && (e.primitive == 0 || static_cast<std::size_t>(e.primitive) < primitives.size() ||
                             (is_edge(e.id) && e.primitive == 1)),  // of a viscous edge
        "a contact of a primitive that is not there");
    layout(f, e.lambda);
    layout(f, e.anchor);
    if (f.written_as() >= 3) layout(f, e.other_anchor);
    if (f.written_as() >= 4) f.put(e.advance);
    std::uint8_t sticking = e.sticking;
    f.put(sticking);
    e.sticking = sticking != 0;
    const auto key = [](const ContactMemory::Entry& of) {
      return std::tuple(of.id, of.instrument, of.primitive);
    };
    f.expect(k == 0 || key(m.entry[k - 1]) < key(e), "contacts that are not in the order of their ids");
  }
  for (std::size_t i = 0; i < instruments.size(); ++i) {
    f.numbers(s.coupling_offset.value[i].data(), 6);
    std::uint8_t outside = m.outside.value[i];
    if (f.written_as() >= 6)
      f.put(outside);
    else
      outside = 0;
    m.outside.value[i] = outside != 0;
  }
}

template <typename File>
void layout(File& f, CapturedProblem& c) {
  if (f.written_as() >= 3)
    c.instruments.resize(f.length(c.instruments.size(), max_instruments, "instruments"));
  else
    c.instruments.resize(1);
  f.expect(!c.instruments.empty(), "no instrument");
  for (Instrument& i : c.instruments) {
    i.primitives.resize(f.length(i.primitives.size(), max_primitives, "primitives of the instrument"));
    for (Primitive& p : i.primitives) layout(f, p);
    f.put(i.tip);
    if (f.written_as() >= 7) layout(f, i.incision);
  }
  layout(f, c.capture.problem, static_cast<int>(c.instruments.size()));
  layout(f, c.capture.state, c.instruments);
  for (int i = 0; i < static_cast<int>(c.instruments.size()); ++i) {
    layout(f, c.capture.X[i]);
    std::uint8_t present = c.capture.X.present[i];
    if (f.written_as() >= 3)
      f.put(present);
    else
      present = 1;
    c.capture.X.present[i] = present != 0;
  }
  f.put(c.capture.period);
  f.put(c.capture.margin);
  f.put(c.capture.linearisations);
  f.put(c.capture.tolerance);
  f.expect(c.capture.period > 0 && c.capture.tolerance > 0 && c.capture.linearisations > 0 &&
               c.capture.linearisations <= 100,
           "settings of the solve out of range");
  f.put(c.capture.status);
  f.expect(c.capture.status <= SolveStatus::too_large, "an unknown status");
  f.put(c.capture.residual);
  for (std::size_t i = 0; i < c.instruments.size(); ++i) f.numbers(c.capture.wrench.value[i].data(), 6);
}

}  // namespace

void write_capture(const std::filesystem::path& file, const std::vector<Instrument>& instruments,
                   const ContactCapture& capture) {
  const auto copy = std::make_unique<CapturedProblem>(CapturedProblem{instruments, capture});
  FileWriter bytes;
  layout(bytes, *copy);
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out.write(magic, sizeof magic);
  for (const std::uint32_t word : {version, byte_order})
    out.write(reinterpret_cast<const char*>(&word), sizeof word);
  out.write(bytes.bytes().data(), static_cast<std::streamsize>(bytes.bytes().size()));
  out.close();
  if (!out) throw std::runtime_error(file.string() + ": cannot be written");
}

std::unique_ptr<CapturedProblem> read_capture(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw InputError(file, 0, "", "cannot be read");
  FileReader reader(file, {std::istreambuf_iterator<char>(in), {}});
  char start[sizeof magic];
  for (char& c : start) reader.put(c);
  reader.expect(std::equal(start, start + sizeof magic, magic), "is not a captured contact problem");
  std::uint32_t file_version = 0, order = 0;
  reader.put(file_version);
  reader.put(order);
  reader.expect(order == byte_order, "was written on a machine of another byte order");
  if (file_version < 1 || file_version > version)
    reader.fail("has version " + std::to_string(file_version) + ", not 1 to " + std::to_string(version));
  reader.set_written_as(file_version);
  auto captured = std::make_unique<CapturedProblem>();
  layout(reader, *captured);
  reader.finish();
  return captured;
}

std::vector<std::filesystem::path> capture_files(const std::filesystem::path& directory) {
  std::vector<std::filesystem::path> files;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(directory, error))
    if (entry.path().extension() == ".contact") files.push_back(entry.path());
  if (error) throw InputError(directory, 0, "", "cannot be read: " + error.message());
  if (files.empty()) throw InputError(directory, 0, "", "has no captured problem (*.contact)");
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace hapticd
