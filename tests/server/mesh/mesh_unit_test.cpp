// Which unit a mesh is likely in.
#include "server/mesh/mesh_unit.h"

#include <gtest/gtest.h>

#include <string>

namespace hapticd {
namespace {

TEST(MeshUnit, AnOrganOfThirtyMillimetresIsKnownInEachUnitThatWouldMakeAnotherSizeOfIt) {
  EXPECT_EQ(likely_unit(0.03), "");
  EXPECT_EQ(likely_unit(30), "mm");
  EXPECT_EQ(likely_unit(3e4), "um");
  EXPECT_EQ(likely_unit(3e-5), "km");
  EXPECT_EQ(likely_unit(0), "");
  EXPECT_EQ(likely_unit(1e12), "");
}

TEST(MeshUnit, AUnitIsSoManyMetres) {
  const double metres[] = {1, 1e-3, 1e-2, 1e-6, 1e3, 0.0254};
  for (int i = 0; i < static_cast<int>(mesh_units.size()); ++i) EXPECT_EQ(metres_of_unit(i), metres[i]);
}

}  // namespace
}  // namespace hapticd
