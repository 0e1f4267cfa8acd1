// Repairs of meshes: what was spoilt on purpose comes back as it was; what is written reads back the same.
#include "server/mesh/mesh_repair.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "physics/tissue/mesh_quality.h"
#include "server/files/paths.h"
#include "server/mesh/mesh_reader.h"
#include "server/mesh/mesh_writer.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

TetMesh box() { return box_mesh({3, 2, 1}, 3, 2, 1); }

RepairedMesh repaired(const TetMesh& mesh, bool merge = true) {
  return repair_mesh(read_raw_mesh(to_msh(mesh), "mesh.msh"), merge);
}

void expect_same(const TetMesh& a, const TetMesh& b) {
  ASSERT_EQ(a.nodes.size(), b.nodes.size());
  for (std::size_t n = 0; n < a.nodes.size(); ++n) EXPECT_EQ(a.nodes[n], b.nodes[n]);
  EXPECT_EQ(a.tets, b.tets);
  for (const MeshGroup& g : a.groups) {
    const MeshGroup* other = b.group(g.name);
    ASSERT_TRUE(other) << g.name;
    EXPECT_EQ(g.nodes, other->nodes) << g.name;
    EXPECT_EQ(g.tets, other->tets) << g.name;
  }
}

TEST(MeshWriter, WhatIsWrittenReadsBackTheSame) {
  const std::filesystem::path data = std::filesystem::path(SOURCE_DIR) / "tests/data";
  for (const char* name : {"tiny_22_ascii.msh", "tiny_41_binary.msh"}) {
    const TetMesh mesh = read_mesh_file(data / name);
    ASSERT_GE(mesh.groups.size(), 5u);
    expect_same(mesh, read_mesh(to_msh(mesh), "written.msh"));
  }
  TetMesh vtk = read_mesh_file(data / "tiny.vtk");
  for (MeshGroup& g : vtk.groups) g.tets.clear();  // groups of points have none
  expect_same(vtk, read_mesh(to_vtk(vtk), "written.vtk"));
  const TetMesh named = read_mesh(to_vtk(box()), "written.vtk");
  ASSERT_TRUE(named.group("bottom_1"));
  EXPECT_EQ(named.group("bottom_1")->nodes, box().group("bottom")->nodes);
}

TEST(MeshRepair, ACleanMeshIsLeftAlone) {
  const RepairedMesh r = repaired(box());
  EXPECT_TRUE(r.faults.clean());
  expect_same(box(), r.mesh);
}

TEST(MeshRepair, InvertedTetrahedraAreTurnedAndCounted) {
  TetMesh spoilt = box();
  for (const int t : {0, 7, 20}) std::swap(spoilt.tets[t][2], spoilt.tets[t][3]);
  // The boundary that the writer wants for groups does not care for orientation.
  const RepairedMesh r = repaired(spoilt);
  EXPECT_EQ(r.faults.inverted, 3);
  EXPECT_GT(r.faults.first_inverted_line, 0);
  EXPECT_TRUE(r.faults.refused());
  EXPECT_EQ(r.mesh.tets, box().tets);
  EXPECT_NEAR(measure_mesh(r.mesh).total_volume, 6, 1e-12);
}

// Every tetrahedron with four nodes of its own: merged, it is the box again, in one piece; kept apart, 36
// pieces.
TEST(MeshRepair, DuplicateNodesBecomeOne) {
  const TetMesh whole = box();
  TetMesh torn;
  for (const Tet& t : whole.tets) {
    const int first = static_cast<int>(torn.nodes.size());
    for (const int n : t) torn.nodes.push_back(whole.nodes[n]);
    torn.tets.push_back({first, first + 1, first + 2, first + 3});
  }
  const RepairedMesh r = repaired(torn);
  EXPECT_EQ(r.faults.duplicate_nodes, 4 * 36 - static_cast<int>(whole.nodes.size()));
  EXPECT_EQ(r.faults.pieces_before, 36);
  EXPECT_EQ(r.faults.pieces, 1);
  EXPECT_EQ(r.mesh.nodes.size(), whole.nodes.size());
  EXPECT_EQ(measure_mesh(r.mesh).boundary_faces, measure_mesh(whole).boundary_faces);
  EXPECT_EQ(repaired(torn, false).faults.pieces, 36);
}

TEST(MeshRepair, OrphansGoAndSoDoTetrahedraBetweenDuplicates) {
  TetMesh spoilt = box();
  spoilt.nodes.push_back({9, 9, 9});
  spoilt.nodes.push_back(spoilt.nodes[1]);  // one place, two numbers …
  const int twin = static_cast<int>(spoilt.nodes.size()) - 1;
  spoilt.tets.push_back({1, twin, 5, 6});  // … and a tetrahedron between them
  spoilt.groups.clear();
  const RepairedMesh r = repaired(spoilt);
  EXPECT_EQ(r.faults.orphan_nodes, 1);
  EXPECT_EQ(r.faults.duplicate_nodes, 1);
  EXPECT_EQ(r.faults.collapsed, 1);
  EXPECT_EQ(r.mesh.tets, box().tets);
}

TEST(MeshRepair, WhatNeedsAnotherMeshIsNamedByLine) {
  const std::string head =
      "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 "
      "0\n$EndNodes\n"
      "$Elements\n2\n1 4 0 1 2 3 4\n";
  try {
    repair_mesh(read_raw_mesh(head + "2 4 0 1 2 3 5\n$EndElements\n", "flat.msh"), true);
    FAIL() << "a flat tetrahedron was accepted";
  } catch (const InputError& e) {
    EXPECT_EQ(e.line(), 15);
    EXPECT_NE(std::string(e.what()).find("degenerate"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace hapticd
