// The readers agree on one mesh in every format, name what is wrong and where, and survive any bytes.
#include "server/mesh/mesh_reader.h"

#include <gtest/gtest.h>

#include <bit>

#include <algorithm>
#include <random>
#include <set>

#include "server/files/input_error.h"
#include "server/files/paths.h"

namespace hapticd {
namespace {

std::string data(const std::string& name) { return std::string(SOURCE_DIR) + "/tests/data/" + name; }

void expect_equal(const TetMesh& a, const TetMesh& b) {
  ASSERT_EQ(a.nodes.size(), b.nodes.size());
  for (std::size_t n = 0; n < a.nodes.size(); ++n) EXPECT_LT((a.nodes[n] - b.nodes[n]).norm(), 1e-15);
  EXPECT_EQ(a.tets, b.tets);
  ASSERT_EQ(a.groups.size(), b.groups.size());
  for (const MeshGroup& g : a.groups) {
    ASSERT_NE(b.group(g.name), nullptr) << g.name;
    EXPECT_EQ(g.nodes, b.group(g.name)->nodes) << g.name;
    EXPECT_EQ(g.tets, b.group(g.name)->tets) << g.name;
  }
}

double volume(const TetMesh& mesh) {
  double sum = 0;
  for (const Tet& t : mesh.tets)
    sum += signed_volume(mesh.nodes[t[0]], mesh.nodes[t[1]], mesh.nodes[t[2]], mesh.nodes[t[3]]);
  return sum;
}

// Two tetrahedra, five nodes, MSH 2.2; elements on lines 14 and on.
std::string two_tets(const std::string& elements,
                     const std::string& nodes = "1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n") {
  const auto lines = [](const std::string& s) {
    return std::to_string(std::count(s.begin(), s.end(), '\n'));
  };
  return "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n" + lines(nodes) + "\n" + nodes +
         "$EndNodes\n$Elements\n" + lines(elements) + "\n" + elements + "$EndElements\n";
}

// Reads it, and says what the error was: "line key what".
std::string fault(const std::string& bytes) {
  try {
    read_mesh(bytes, "m.msh");
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("m.msh"), std::string::npos);
    return std::to_string(e.line()) + " " + e.key() + " " + e.what();
  }
  return "none";
}

void expect_fault(const std::string& bytes, const std::string& begin, const std::string& within) {
  const std::string text = fault(bytes);
  EXPECT_TRUE(text.starts_with(begin)) << text;
  EXPECT_NE(text.find(within), std::string::npos) << text;
}

TEST(MeshReader, FourGmshFormatsGiveTheSameMesh) {
  const TetMesh mesh = read_mesh_file(data("tiny_41_ascii.msh"));
  for (const char* other : {"tiny_41_binary.msh", "tiny_22_ascii.msh", "tiny_22_binary.msh"}) {
    SCOPED_TRACE(other);
    expect_equal(mesh, read_mesh_file(data(other)));
  }
}

TEST(MeshReader, GroupsOfEveryDimension) {
  const TetMesh mesh = read_mesh_file(data("tiny_41_binary.msh"));
  EXPECT_NEAR(volume(mesh), 2.0, 1e-12);
  ASSERT_EQ(mesh.groups.size(), 5u);
  EXPECT_EQ(mesh.group("corner")->nodes.size(), 1u);
  EXPECT_EQ(mesh.group("edge")->nodes.size(), 2u);
  for (int n : mesh.group("bottom")->nodes) EXPECT_EQ(mesh.nodes[n].z(), 0);
  EXPECT_EQ(mesh.group("bottom")->tets.size(), 0u);
  EXPECT_EQ(mesh.group("left")->tets.size() + mesh.group("right")->tets.size(), mesh.tets.size());
  for (int n : mesh.group("left")->nodes) EXPECT_LE(mesh.nodes[n].x(), 1);
}

TEST(MeshReader, VtkHoldsTheSameTetrahedra) {
  const TetMesh vtk = read_mesh_file(data("tiny.vtk")), msh = read_mesh_file(data("tiny_22_ascii.msh"));
  expect_equal({msh.nodes, msh.tets, {}}, {vtk.nodes, vtk.tets, {}});
}

TEST(MeshReader, VtkArraysMakeGroups) {
  const std::string head =
      "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n0 0 0 1 0 0 0 1 0 0 "
      "0 1 1 1 1\n";
  const std::string data_part =
      "CELL_DATA 2\nSCALARS group int 1\nLOOKUP_TABLE default\n0 7\nSCALARS heat float\nLOOKUP_TABLE "
      "default\n1 2\n"
      "POINT_DATA 5\nFIELD f 1\nheld 1 5 int\n1 0 0 0 1\n";
  const TetMesh mesh =
      read_mesh(head + "CELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10\n10\n" + data_part, "m.vtk");
  ASSERT_EQ(mesh.groups.size(), 2u);
  EXPECT_EQ(mesh.group("group_7")->tets, std::vector<int>{1});
  EXPECT_EQ(mesh.group("group_7")->nodes, (std::vector<int>{1, 2, 3, 4}));
  EXPECT_EQ(mesh.group("held_1")->nodes, (std::vector<int>{0, 4}));
  // The layout of VTK 5.
  const TetMesh five = read_mesh(head +
                                     "CELLS 3 8\nOFFSETS vtktypeint64\n0 4 8\nCONNECTIVITY vtktypeint64\n"
                                     "0 1 2 3 1 2 3 4\nCELL_TYPES 2\n10\n10\n" +
                                     data_part,
                                 "m.vtk");
  expect_equal(mesh, five);
}

// A table of colours of one's own after the values that name it: numbers in text, four bytes each in binary.
TEST(MeshReader, VtkLookupTablesAreSkipped) {
  const std::string head = "# vtk DataFile Version 3.0\nx\n",
                    text =
                        "ASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\nCELLS 1 "
                        "5\n4 0 1 2 3\nCELL_TYPES 1\n10\n"
                        "POINT_DATA 4\nSCALARS heat float 1\nLOOKUP_TABLE mine\n0 1 2 3\nLOOKUP_TABLE mine "
                        "2\n0 0 0 1 1 1 1 1\n"
                        "FIELD f 1\nheld 1 4 int\n1 0 0 1\n";
  const auto big = [](std::uint32_t word) {
    return std::string{static_cast<char>(word >> 24), static_cast<char>(word >> 16),
                       static_cast<char>(word >> 8), static_cast<char>(word)};
  };
  const auto floats = [&](std::initializer_list<float> values) {
    std::string out;
    for (const float v : values) out += big(std::bit_cast<std::uint32_t>(v));
    return out + '\n';
  };
  const std::string binary =
      "BINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n" + floats({0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}) +
      "CELLS 1 5\n" + big(4) + big(0) + big(1) + big(2) + big(3) + "\nCELL_TYPES 1\n" + big(10) +
      "\nPOINT_DATA 4\nSCALARS heat float 1\nLOOKUP_TABLE mine\n" + floats({0, 1, 2, 3}) +
      "LOOKUP_TABLE mine 2\n" + std::string("\0\n \xff\x01\x02\x03\x04", 8) + "\nFIELD f 1\nheld 1 4 int\n" +
      big(1) + big(0) + big(0) + big(1) + "\n";
  const TetMesh a = read_mesh(head + text, "a.vtk"), b = read_mesh(head + binary, "b.vtk");
  ASSERT_EQ(a.tets.size(), 1u);
  EXPECT_EQ(a.group("held_1")->nodes, (std::vector<int>{0, 3}));
  expect_equal(a, b);
}

TEST(MeshReader, UnusedNodesAreDroppedInOrder) {
  const TetMesh mesh = read_mesh(
      two_tets("1 4 2 3 1 30 20 10 40\n2 15 2 9 1 7\n", "30 0 0 0\n7 5 5 5\n20 1 0 0\n10 0 1 0\n40 0 0 1\n"),
      "m.msh");
  ASSERT_EQ(mesh.nodes.size(), 4u);
  EXPECT_EQ(mesh.nodes[0], Vec3(0, 1, 0));  // number 10 comes first
  EXPECT_EQ(mesh.tets[0], (Tet{2, 1, 0, 3}));
  EXPECT_EQ(mesh.group("3")->tets, std::vector<int>{0});
  EXPECT_TRUE(mesh.group("9")->nodes.empty());
}

TEST(MeshReader, ATetrahedronInTwoGroupsIsOne) {
  const TetMesh mesh = read_mesh(two_tets("1 4 2 1 1 1 2 3 4\n2 4 2 2 1 1 2 3 4\n"), "m.msh");
  EXPECT_EQ(mesh.tets.size(), 1u);
  EXPECT_EQ(mesh.group("1")->tets, mesh.group("2")->tets);
}

TEST(MeshReader, NamesFileLineAndSection) {
  const std::string good = "1 4 2 1 1 1 2 3 4\n";
  EXPECT_EQ(fault(two_tets(good)), "none");
  expect_fault(two_tets(good + "2 4 2 1 1 1 3 2 5\n"), "15 $Elements", "inverted");
  expect_fault(two_tets(good + "2 4 2 1 1 1 3 2 3\n"), "15 $Elements", "degenerate");
  expect_fault(two_tets(good + "2 4 2 1 1 1 3 2 9\n"), "15 $Elements", "there is no node 9");
  expect_fault(two_tets(good + "2 5 2 1 1 1 2 3 4 1 2 3 4\n"), "15 $Elements", "hexahedron");
  expect_fault(two_tets(good + "2 4 2 1 1 1 x 2 3\n"), "15 $Elements", "not a whole number");
  expect_fault(two_tets("1 2 2 1 1 1 2 3\n"), "0 $Elements", "no tetrahedra");
  expect_fault(two_tets(good, "1 0 0 0\n2 1 0 0\n3 0 nan 0\n4 0 0 1\n"), "8 nodes", "not finite");
  expect_fault(two_tets(good, "1 0 0 0\n2 1 0 0\n3 0 1e999 0\n4 0 0 1\n"), "8 nodes", "not finite");
  expect_fault(two_tets(good, "1 0 0 0\n2 1 0 0\n2 0 1 0\n4 0 0 1\n"), "8 nodes", "twice");
  const std::string whole = two_tets(good);
  expect_fault(whole.substr(0, whole.find("$Elements")), "0 $Elements", "missing");
  expect_fault("$MeshFormat\n3.0 0 8\n$EndMeshFormat\n", "2 $MeshFormat", "msh41");
  expect_fault("solid cube\n", "1 ", "an STL surface");
  expect_fault("", "1 ", "neither");
}

TEST(MeshReader, DegenerateIsMeasuredAgainstItsSize) {
  // A flat tetrahedron of 1 km with a height of 1 µm has V/L³ near 1e-10; of a height of 1 nm, 1e-13.
  const auto height = [](const char* h) {
    return two_tets("1 4 2 1 1 1 2 3 4\n", std::string("1 0 0 0\n2 1e3 0 0\n3 0 1e3 0\n4 0 0 ") + h + "\n");
  };
  EXPECT_EQ(fault(height("1e-6")), "none");
  expect_fault(height("1e-9"), "13 $Elements", "degenerate");
}

TEST(MeshReader, BinaryFaultsNameTheByte) {
  const std::string bytes = read_bytes(data("tiny_41_binary.msh"));
  const std::string text = fault(bytes.substr(0, bytes.size() / 2));
  EXPECT_NE(text.find("at byte"), std::string::npos) << text;
}

TEST(MeshReader, SizesAreNotBelieved) {
  EXPECT_NE(fault("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n9000000000000000000\n1 0 0 0\n"), "none");
  EXPECT_NE(fault("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 9 1 9\n0 1 0 9000000000000000000\n1\n"),
            "none");
  EXPECT_NE(
      fault("# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 99999999999 float\n0\n"),
      "none");
}

// Whatever comes out of damaged bytes is a valid mesh or an InputError.
void expect_valid_or_refused(const std::string& bytes) {
  try {
    const TetMesh mesh = read_mesh(bytes, "damaged");
    const int n = static_cast<int>(mesh.nodes.size());
    for (const Tet& t : mesh.tets) {
      for (int node : t) ASSERT_TRUE(node >= 0 && node < n);
      ASSERT_GT(signed_volume(mesh.nodes[t[0]], mesh.nodes[t[1]], mesh.nodes[t[2]], mesh.nodes[t[3]]), 0);
    }
    for (const MeshGroup& g : mesh.groups) {
      for (int node : g.nodes) ASSERT_TRUE(node >= 0 && node < n);
      for (int tet : g.tets) ASSERT_TRUE(tet >= 0 && tet < static_cast<int>(mesh.tets.size()));
    }
  } catch (const InputError&) {
  }
}

TEST(MeshReader, DamagedFilesNeverCrash) {
  std::mt19937 random(7);
  for (const char* name :
       {"tiny_22_ascii.msh", "tiny_22_binary.msh", "tiny_41_ascii.msh", "tiny_41_binary.msh", "tiny.vtk"}) {
    SCOPED_TRACE(name);
    const std::string whole = read_bytes(data(name));
    for (int i = 0; i < 1500; ++i) {
      std::string bytes = whole;
      for (unsigned flips = 1 + random() % 4; flips > 0; --flips)
        bytes[random() % bytes.size()] ^= static_cast<char>(1u << random() % 8);
      if (i % 3 == 1) bytes.resize(random() % bytes.size());
      if (i % 3 == 2) bytes[random() % bytes.size()] = "-0123456789 \n$"[random() % 14];
      expect_valid_or_refused(bytes);
    }
  }
}

}  // namespace
}  // namespace hapticd
