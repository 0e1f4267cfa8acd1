// A series for ParaView, read again as VTK's own reader does: compressed, strained, with the instrument in
// it.
#include "tools/record/vtk_series.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "server/files/paths.h"
#include "tests/support/process.h"
#include "tests/tools/run_command.h"
#include "tools/record/instrument_surface.h"

namespace hapticd {
namespace {

// Of Debian's Python alone: the array NAME of FILE as numbers.
std::vector<double> array_of(const std::string& file, const std::string& name, const char* type) {
  const CommandResult r = run_command(
      std::string("/usr/bin/python3 -c \"import base64,re,struct,zlib; t=open('") + file + "').read();" +
      "assert 'vtkZLibDataCompressor' in t; d=re.search(r'Name=.%s.[^>]*>([^<]*)<' % '" + name +
      "',t).group(1); n,u,p,c=struct.unpack('<4I',base64.b64decode(d[:24])[:16]);"
      "raw=zlib.decompress(base64.b64decode(d[24:])); assert (n,u,p)==(1,len(raw),0) and "
      "c==len(base64.b64decode(d[24:]));"
      "print(*struct.unpack('<%d" +
      type + "' % (len(raw)//4),raw))\"");
  EXPECT_EQ(r.code, 0) << r.output;
  std::vector<double> out;
  for (const char* at = r.output.c_str(); *at;) {
    char* end = nullptr;
    const double value = std::strtod(at, &end);
    if (end == at) break;
    out.push_back(value);
    at = end;
  }
  return out;
}

// A bar drawn to twice its length, ν = 0: E = diag(3/2, 0, 0), its deviator √(2/3)·3/2 long, so ε = 1 and
// σ = 3 G.
TEST(VtkSeries, ABarDrawnToTwiceItsLengthIsRead) {
  const ScratchDirectory scratch;
  TetMesh mesh;
  mesh.nodes = {Vec3::Zero(), 1e-2 * Vec3::UnitX(), 1e-2 * Vec3::UnitY(), 1e-2 * Vec3::UnitZ()};
  mesh.tets = {{0, 1, 2, 3}};
  std::vector<Vec3> now = mesh.nodes;
  now[1] *= 2;
  const std::vector<std::uint8_t> alive = {1};
  const std::vector<Vec3> surface = {Vec3::Zero(), Vec3::UnitX(), Vec3::UnitY()};
  VtkContact contact;
  contact.instruments.push_back(
      {{Vec3(0, 0, 1), Quat(Eigen::AngleAxisd(std::numbers::pi / 2, Vec3::UnitZ()))}, Vec3::Zero(), surface});
  VtkSeries series(scratch.file("vtk"));
  series.add(0, {{"bar", &mesh, now, alive, 1e3}}, contact);
  series.finish();
  EXPECT_NE(read_bytes(scratch.file("vtk/scene.pvd")).find("instrument_000000.vtp"), std::string::npos);
  const auto strain = array_of(scratch.file("vtk/bar_000000.vtu"), "strain", "f");
  ASSERT_EQ(strain.size(), 1u);
  EXPECT_NEAR(strain[0], 1, 1e-6);
  EXPECT_NEAR(array_of(scratch.file("vtk/bar_000000.vtu"), "stress", "f").at(0), 3e3, 1e-2);
  EXPECT_NEAR(array_of(scratch.file("vtk/bar_000000.vtu"), "displacement", "f").at(3), 1e-2, 1e-8);
  const auto corner = array_of(scratch.file("vtk/instrument_000000.vtp"), "Points", "f");
  ASSERT_EQ(corner.size(), 9u);
  EXPECT_NEAR(corner[4], 1, 1e-6);  // x of the instrument is y of the scene
  EXPECT_NEAR(corner[5], 1, 1e-6);
}

// Every corner of a capsule's surface is its radius away from its segment; the surface is closed: each edge
// is of two triangles, once in each direction.
TEST(InstrumentSurface, ACapsuleIsRoundAndClosed) {
  const std::vector<float> capsule = {1, 2e-3f, 5e-3f, 1e-3f, 0, 0, 0, 0, 0, 1};
  const std::vector<Vec3> corner = instrument_surface(capsule);
  ASSERT_EQ(corner.size() % 3, 0u);
  ASSERT_GT(corner.size(), 100u);
  double volume = 0;
  for (std::size_t i = 0; i < corner.size(); i += 3)
    volume += corner[i].dot(corner[i + 1].cross(corner[i + 2])) / 6;
  for (const Vec3& x : corner) {
    const Vec3 from = x - Vec3(1e-3, 0, std::clamp(x.z(), -5e-3, 5e-3));
    EXPECT_NEAR(from.norm(), 2e-3, 1e-8);
  }
  // Outward, and nearly the round one's.
  const double round = std::numbers::pi * 4e-6 * 1e-2 + 4 / 3.0 * std::numbers::pi * 8e-9;
  EXPECT_NEAR(volume, round, 0.06 * round);
  EXPECT_TRUE(instrument_surface(std::vector<float>{7, 1, 1, 1, 1, 1, 1, 1, 1, 1}).empty());
}

}  // namespace
}  // namespace hapticd
