// A message's sequence that borrows a vector; Cyclone copies on write.
#pragma once

#include <cstdint>
#include <vector>

namespace hapticd {

template <typename Sequence, typename T>
Sequence borrowed(std::vector<T>& v) {
  Sequence s{};
  s._maximum = s._length = static_cast<std::uint32_t>(v.size());
  s._buffer = v.data();
  s._release = false;
  return s;
}

}  // namespace hapticd
