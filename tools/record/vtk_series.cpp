#include "tools/record/vtk_series.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include <zlib.h>

#include "physics/tissue/strain.h"
#include "physics/tissue/tetrahedron.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

constexpr std::uint8_t vtk_tetrahedron = 10;

std::string base64(std::span<const unsigned char> bytes) {
  constexpr const char* letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t n = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 3; ++k) word = word << 8 | (k < n ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= n ? letters[word >> (18 - 6 * k) & 63u] : '=';
  }
  return out;
}

// One block, with the header that vtkZLibDataCompressor reads: blocks, bytes of a block, of the last one if
// it is shorter, of each when compressed.
std::string compressed(const void* data, std::size_t bytes) {
  constexpr int fast = 3;
  uLongf size = compressBound(static_cast<uLong>(bytes));
  std::vector<unsigned char> packed(size);
  if (compress2(packed.data(), &size, static_cast<const Bytef*>(data), static_cast<uLong>(bytes), fast) !=
      Z_OK)
    throw std::runtime_error("zlib: no memory");
  packed.resize(size);
  const std::uint32_t header[] = {bytes > 0 ? 1u : 0u, static_cast<std::uint32_t>(bytes), 0,
                                  static_cast<std::uint32_t>(size)};
  const auto* begin = reinterpret_cast<const unsigned char*>(header);
  return base64({begin, bytes > 0 ? sizeof header : sizeof header - sizeof header[0]}) +
         (bytes > 0 ? base64(packed) : "");
}

template <typename T>
std::string array(const char* type, const char* name, int components, const std::vector<T>& values) {
  return std::string("<DataArray type=\"") + type + "\" Name=\"" + name + "\" NumberOfComponents=\"" +
         std::to_string(components) + "\" format=\"binary\">" +
         compressed(values.data(), sizeof(T) * values.size()) + "</DataArray>\n";
}

void push(std::vector<float>& out, const Vec3& v) {
  for (int i = 0; i < 3; ++i) out.push_back(static_cast<float>(v[i]));
}

std::string file_of(const char* type, const std::string& content) {
  return std::string("<?xml version=\"1.0\"?>\n<VTKFile type=\"") + type +
         "\" version=\"0.1\" byte_order=\"LittleEndian\" header_type=\"UInt32\" "
         "compressor=\"vtkZLibDataCompressor\">\n<" +
         type + ">\n" + content + "</" + type + ">\n</VTKFile>\n";
}

// The tetrahedra chosen, and the nodes that they use.
// To eleven bits of mantissa, one part in 4000, which zlib makes half as large: what is drawn in colours needs no more.
float coarse(double x) {
  const auto bits = std::bit_cast<std::uint32_t>(static_cast<float>(x));
  return std::bit_cast<float>((bits + 0x800) & 0xfffff000u);
}

double strain_of(const TetMesh& mesh, std::span<const Vec3> nodes, const Tet& t) {
  const auto rest = [&](int a) -> const Vec3& {
    return mesh.nodes[static_cast<std::size_t>(t[static_cast<std::size_t>(a)])];
  };
  if (!(std::abs(signed_volume(rest(0), rest(1), rest(2), rest(3))) > 0)) return 0;
  Corners corners;
  for (int a = 0; a < 4; ++a)
    corners.col(a) = nodes[static_cast<std::size_t>(t[static_cast<std::size_t>(a)])];
  return equivalent_strain(
      deformation_gradient(corners, rest_shape(rest(0), rest(1), rest(2), rest(3)).gradients));
}

std::string grid(const TetMesh& mesh, std::span<const Vec3> nodes, const std::vector<int>& tets,
                 double shear) {
  std::vector<int> point_of(mesh.nodes.size(), -1);
  std::vector<float> points, displacement, strain, stress;
  std::vector<std::int32_t> connectivity, offsets, element;
  int count = 0;
  for (const int e : tets) {
    for (const int n : mesh.tets[static_cast<std::size_t>(e)]) {
      const auto i = static_cast<std::size_t>(n);
      if (point_of[i] < 0) {
        point_of[i] = count++;
        push(points, nodes[i]);
        push(displacement, nodes[i] - mesh.nodes[i]);
      }
      connectivity.push_back(point_of[i]);
    }
    offsets.push_back(static_cast<std::int32_t>(connectivity.size()));
    element.push_back(e);
    const double eps = strain_of(mesh, nodes, mesh.tets[static_cast<std::size_t>(e)]);
    strain.push_back(coarse(eps));
    stress.push_back(coarse(3 * shear * eps));
  }
  const std::vector<std::uint8_t> types(tets.size(), vtk_tetrahedron);
  return file_of("UnstructuredGrid",
                 "<Piece NumberOfPoints=\"" + std::to_string(count) + "\" NumberOfCells=\"" +
                     std::to_string(tets.size()) + "\">\n<PointData Vectors=\"displacement\">\n" +
                     array("Float32", "displacement", 3, displacement) +
                     "</PointData>\n<CellData Scalars=\"element\">\n" +
                     array("Int32", "element", 1, element) + array("Float32", "strain", 1, strain) +
                     (shear > 0 ? array("Float32", "stress", 1, stress) : "") + "</CellData>\n<Points>\n" +
                     array("Float32", "Points", 3, points) + "</Points>\n<Cells>\n" +
                     array("Int32", "connectivity", 1, connectivity) + array("Int32", "offsets", 1, offsets) +
                     array("UInt8", "types", 1, types) + "</Cells>\n</Piece>\n");
}

std::string points_file(const VtkContact& c) {
  std::vector<float> points, force, gap;
  std::vector<std::int32_t> kind, instrument;
  for (const VtkInstrument& i : c.instruments) {
    push(points, i.pose.p);
    push(force, i.force);
    gap.push_back(0);
    instrument.push_back(static_cast<std::int32_t>(kind.size()));
    kind.push_back(0);
  }
  for (const ContactForce& f : c.contacts) {
    instrument.push_back(f.instrument);
    push(points, f.place);
    push(force, f.force);
    gap.push_back(static_cast<float>(f.gap));
    kind.push_back(1);
  }
  const std::size_t n = kind.size();
  std::vector<std::int32_t> each(n), ends(n);
  for (std::size_t i = 0; i < n; ++i) {
    each[i] = static_cast<std::int32_t>(i);
    ends[i] = each[i] + 1;
  }
  const std::string whose = c.instruments.size() > 1 ? array("Int32", "instrument", 1, instrument) : "";
  return file_of("PolyData", "<Piece NumberOfPoints=\"" + std::to_string(n) + "\" NumberOfVerts=\"" +
                                 std::to_string(n) +
                                 "\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"0\">\n"
                                 "<PointData Vectors=\"force\">\n" +
                                 array("Float32", "force", 3, force) + array("Float32", "gap", 1, gap) +
                                 array("Int32", "kind", 1, kind) + whose + "</PointData>\n<Points>\n" +
                                 array("Float32", "Points", 3, points) + "</Points>\n<Verts>\n" +
                                 array("Int32", "connectivity", 1, each) +
                                 array("Int32", "offsets", 1, ends) + "</Verts>\n</Piece>\n");
}

std::string surfaces_file(const std::vector<VtkInstrument>& instruments) {
  std::vector<float> points;
  std::vector<std::int32_t> whose, corner, ends;
  for (std::size_t i = 0; i < instruments.size(); ++i)
    for (const Vec3& x : instruments[i].surface) {
      corner.push_back(static_cast<std::int32_t>(corner.size()));
      push(points, instruments[i].pose.p + instruments[i].pose.q * x);
      if (corner.size() % 3 != 0) continue;
      whose.push_back(static_cast<std::int32_t>(i));
      ends.push_back(static_cast<std::int32_t>(corner.size()));
    }
  return file_of("PolyData",
                 "<Piece NumberOfPoints=\"" + std::to_string(corner.size()) +
                     "\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"" +
                     std::to_string(ends.size()) + "\">\n<CellData Scalars=\"instrument\">\n" +
                     array("Int32", "instrument", 1, whose) + "</CellData>\n<Points>\n" +
                     array("Float32", "Points", 3, points) + "</Points>\n<Polys>\n" +
                     array("Int32", "connectivity", 1, corner) + array("Int32", "offsets", 1, ends) +
                     "</Polys>\n</Piece>\n");
}

std::string numbered(const std::string& name, int n, const char* ending) {
  char number[16];
  std::snprintf(number, sizeof number, "_%06d", n);
  return as_file_name(name) + number + ending;
}

}  // namespace

VtkSeries::VtkSeries(const std::filesystem::path& directory) : directory_(directory) {
  std::filesystem::create_directories(directory);
}

void VtkSeries::part(int index, const std::string& file) {
  char line[96];
  std::snprintf(line, sizeof line, "<DataSet timestep=\"%.6f\" part=\"%d\" file=\"", t_, index);
  parts_ += line + file + "\"/>\n";
}

void VtkSeries::add_body(std::size_t b, const VtkBody& body) {
  const bool still = body.nodes.empty();
  std::vector<int> living, gone;
  for (std::size_t e = 0; e < body.mesh->tets.size(); ++e) {
    if (body.mesh->tets[e] == no_tet) continue;
    (body.alive.empty() || body.alive[e] ? living : gone).push_back(static_cast<int>(e));
  }
  if (!still || still_file_[b].empty()) {
    const std::string file = numbered(body.name, frames_, ".vtu");
    write_file((directory_ / file).string(),
               grid(*body.mesh, still ? std::span<const Vec3>(body.mesh->nodes) : body.nodes, living,
                    body.shear_modulus));
    still_file_[b] = file;
  }
  part(static_cast<int>(2 * b), still_file_[b]);
  if (gone.empty()) return;
  if (const std::vector<std::uint8_t> alive(body.alive.begin(), body.alive.end());
      alive != removed_seen_[b]) {
    removed_file_[b] = numbered(body.name + "_removed", frames_, ".vtu");
    write_file((directory_ / removed_file_[b]).string(), grid(*body.mesh, body.mesh->nodes, gone, 0));
    removed_seen_[b] = alive;
  }
  part(static_cast<int>(2 * b + 1), removed_file_[b]);
}

void VtkSeries::add(double t, const std::vector<VtkBody>& bodies, const VtkContact& contact) {
  t_ = t;
  removed_seen_.resize(bodies.size());
  removed_file_.resize(bodies.size());
  still_file_.resize(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) add_body(b, bodies[b]);
  const std::string file = numbered("contact", frames_, ".vtp");
  write_file((directory_ / file).string(), points_file(contact));
  part(static_cast<int>(2 * bodies.size()), file);
  if (std::any_of(contact.instruments.begin(), contact.instruments.end(),
                  [](const VtkInstrument& i) { return !i.surface.empty(); })) {
    const std::string surfaces = numbered("instrument", frames_, ".vtp");
    write_file((directory_ / surfaces).string(), surfaces_file(contact.instruments));
    part(static_cast<int>(2 * bodies.size() + 1), surfaces);
  }
  ++frames_;
}

void VtkSeries::finish() const {
  write_file(
      (directory_ / "scene.pvd").string(),
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n"
      "<Collection>\n" +
          parts_ + "</Collection>\n</VTKFile>\n");
}

}  // namespace hapticd
