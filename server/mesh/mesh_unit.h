// The units that a mesh file may be in: none of the formats says its own.
//
// Errors: none. Thread safety: pure.
#pragma once

#include <initializer_list>
#include <string>

namespace hapticd {

inline constexpr std::initializer_list<const char*> mesh_units = {"m", "mm", "cm", "um", "km", "in"};

// What one of `mesh_units` is [m], by its place among them.
double metres_of_unit(int unit);

// The unit in which something so large from corner to corner is as large as an organ, 1 mm to 1 m; the first
// that fits, empty where it is an organ in metres or fits in none.
std::string likely_unit(double diagonal);

}  // namespace hapticd
