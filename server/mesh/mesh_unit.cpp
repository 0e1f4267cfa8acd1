#include "server/mesh/mesh_unit.h"

#include <iterator>

namespace hapticd {
namespace {

constexpr double metres[] = {1, 1e-3, 1e-2, 1e-6, 1e3, 0.0254};
constexpr double smallest = 1e-3, largest = 1;  // of an organ [m]

}  // namespace

static_assert(std::size(metres) == mesh_units.size());

double metres_of_unit(int unit) { return metres[unit]; }

std::string likely_unit(double diagonal) {
  for (std::size_t i = 0; i < mesh_units.size(); ++i)
    if (const double m = diagonal * metres[i]; m >= smallest && m <= largest)
      return i == 0 ? "" : mesh_units.begin()[i];
  return "";
}

}  // namespace hapticd
