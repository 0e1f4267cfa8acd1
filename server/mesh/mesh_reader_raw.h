// What the mesh formats have in common before it is checked: nodes by number, tetrahedra with their place
// in the file, groups by node number.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <unordered_map>
#include <vector>

#include "physics/tissue/mesh.h"
#include "server/files/input_error.h"

namespace hapticd {

// A place in a mesh file: its line, or in binary sections its byte.
struct MeshPlace {
  int line = 0;
  std::size_t byte = 0;
};

struct RawNode {
  std::uint64_t number;
  Vec3 x;
  MeshPlace place;
};

struct RawTet {
  std::array<std::uint64_t, 4> node;
  MeshPlace place;
};

struct RawGroup {
  std::string name;
  std::vector<std::uint64_t> nodes;
  std::vector<std::size_t> tets;  // into RawMesh::tets
};

struct RawMesh {
  std::filesystem::path file;
  std::string tet_section;  // for messages: $Elements, CELLS
  std::vector<RawNode> nodes;
  std::vector<RawTet> tets;
  std::vector<RawGroup> groups;

  RawGroup& group(const std::string& name);  // made when it does not exist yet

 private:
  std::unordered_map<std::string, std::size_t> group_index_;
};

InputError mesh_error(const std::filesystem::path& file, const MeshPlace& place, const std::string& section,
                      const std::string& what);

// "tetrahedron with nodes 1 2 3 4", by the file's numbers.
std::string describe_tet(const RawTet& tet);

// degenerate: |V| < 1e-12 L³, L its longest edge.
enum class TetShape { positive, inverted, degenerate };
TetShape tet_shape(const std::array<Vec3, 4>& corners);

// As it stands in the file: nothing is checked that can be read. Throws InputError.
RawMesh read_raw_mesh(const std::string& bytes, const std::filesystem::path& file);

// Checks, drops unused nodes, renumbers. Throws InputError.
TetMesh finish_mesh(const RawMesh& raw);

RawMesh read_gmsh(const std::string& bytes, const std::filesystem::path& file);
RawMesh read_vtk(const std::string& bytes, const std::filesystem::path& file);
std::string vtk_as_text(const std::string& bytes, const std::filesystem::path& file);  // of a binary one

}  // namespace hapticd
