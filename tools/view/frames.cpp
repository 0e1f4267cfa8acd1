#include "tools/view/frames.h"

#include <bit>
#include <cstring>

namespace hapticd {
namespace {

static_assert(std::endian::native == std::endian::little);

template <typename T>
void append(std::string& out, const T& value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}
template <typename T>
void append(std::string& out, std::span<const T> values) {
  out.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
}

std::string head(std::uint32_t kind, std::uint32_t body, std::size_t count, std::uint32_t extra,
                 double time) {
  std::string out;
  for (const std::uint32_t word : {kind, body, static_cast<std::uint32_t>(count), extra}) append(out, word);
  append(out, time);
  return out;
}

}  // namespace

std::string rest_frame(std::uint32_t body, std::span<const float> nodes) {
  std::string out = head(1, body, nodes.size() / 3, 0, 0);
  append(out, nodes);
  return out;
}

std::string surface_frame(std::uint32_t body, std::uint32_t removed, std::span<const SurfaceFace> faces,
                          std::span<const std::uint8_t> loose) {
  std::string out = head(2, body, faces.size(), removed, 0);
  for (const SurfaceFace& face : faces)
    for (const int n : face.nodes) append(out, static_cast<std::uint32_t>(n));
  for (const SurfaceFace& face : faces) {
    const auto tet = static_cast<std::size_t>(face.id / 4);
    const bool is_loose = tet < loose.size() && loose[tet];
    out += static_cast<char>((face.cut ? view_cut : 0) | (is_loose ? view_loose : 0));
  }
  return out;
}

std::string motion_frame(std::uint32_t body, double time, std::span<const float> nodes,
                         std::span<const float> strain) {
  std::string out = head(3, body, nodes.size() / 3, 0, time);
  append(out, nodes);
  append(out, strain);
  return out;
}

std::string contacts_frame(double time, std::span<const float> instruments, std::span<const float> contacts,
                           std::span<const std::uint8_t> pressing) {
  std::string out = head(4, 0, contacts.size() / 7, static_cast<std::uint32_t>(instruments.size() / 7), time);
  append(out, instruments);
  append(out, contacts);
  append(out, pressing);
  return out;
}

}  // namespace hapticd
