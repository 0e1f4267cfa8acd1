// The demonstration's pictures, where a surface has nothing left.
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

TEST(DemoPictures, OfALensThatIsGone) {
  const ScratchDirectory scratch;
  const std::string head = "# vtk DataFile Version 3.0\nlens, metres\nASCII\nDATASET POLYDATA\n";
  const std::string cut = "SCALARS cut int 1\nLOOKUP_TABLE default\n";
  const std::string before = scratch.file(
      "before.vtk", head +
                        "POINTS 4 double\n0 0 0\n0.001 0 0\n0 0.001 0\n0 0 0.001\nPOLYGONS 4 16\n3 0 2 1\n"
                        "3 0 1 3\n3 0 3 2\n3 1 2 3\nCELL_DATA 4\n" +
                        cut + "0\n0\n0\n1\n");
  const std::string after =
      scratch.file("after.vtk", head + "POINTS 0 double\nPOLYGONS 0 0\nCELL_DATA 0\n" + cut);
  const std::string picture = scratch.file("lens.png");
  const CommandResult drawn = run_command(
      "MPLCONFIGDIR=" + scratch.file("") + " PYTHONDONTWRITEBYTECODE=1 /usr/bin/python3 -c '" +
      "import sys; sys.path.insert(0, \"" SOURCE_DIR "/tools/plot\"); import plot_demo as p; " +
      "p.plot_lens(p.read_vtk(\"" + before + "\"), p.read_vtk(\"" + after + "\"), \"" + picture + "\")'");
  EXPECT_EQ(drawn.code, 0) << drawn.output;
  EXPECT_TRUE(std::filesystem::exists(picture)) << drawn.output;
}

}  // namespace
}  // namespace hapticd
