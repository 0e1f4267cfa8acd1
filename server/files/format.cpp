#include "server/files/format.h"

#include <cstdarg>
#include <cstdio>

namespace hapticd {

std::string format(const char* text, ...) {
  char line[512];
  va_list values;
  va_start(values, text);
  std::vsnprintf(line, sizeof line, text, values);
  va_end(values);
  return line;
}

}  // namespace hapticd
