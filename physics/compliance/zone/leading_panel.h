// Where one panel of the columns before the zone lies: of the factor's values and of their rows.
#pragma once

#include <cstddef>

namespace hapticd {

struct LeadingPanel {
  int first;  // column
  int width;
  int height;          // rows, the panel's own columns first
  std::ptrdiff_t row;  // its first in the list of rows
  std::ptrdiff_t value;
  int stride;  // of its columns
};

}  // namespace hapticd
