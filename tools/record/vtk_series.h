// A scene over time for ParaView: DIR/scene.pvd names, for each moment, a file of each body and one of the
// contact.
//
//   BODY_000012.vtu          the living tetrahedra; points: displacement [m]; cells: element (its index),
//   strain
//                            (equivalent, physics/tissue/strain.h), stress (von Mises' of a linear solid,
//                            σ = 3 G ε [Pa]) where the shear modulus G is known: offline, not from a daemon
//   BODY_removed_000012.vtu  the tetrahedra that are gone, where they were at rest; written when they change
//   contact_000012.vtp       first each instrument's origin with the force on it, then each contact with the
//                            force on the tissue; points: force [N], gap [m], kind (0 instrument, 1 contact);
//                            of several instruments also `instrument`, its place in the scene
//   instrument_000012.vtp    the instruments' surfaces where they are; cells: instrument
//
// In ParaView: open scene.pvd; Glyph, scaled by `force`, for the arrows. A body without tetrahedra to deform
// is written once. Numbers are float32, compressed by zlib, base64. Units: s, m, N, scene axes. Errors:
// std::runtime_error naming the file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "physics/tissue/mesh.h"
#include "server/observe/contact_forces.h"

namespace hapticd {

// A body as it is now; `alive` empty: all of them are.
struct VtkBody {
  std::string name;
  const TetMesh* mesh = nullptr;  // at rest
  std::span<const Vec3> nodes;    // now; empty: at rest
  std::span<const std::uint8_t> alive;
  double shear_modulus = 0;  // [Pa]; 0: not known
};

struct VtkInstrument {
  Pose pose;
  Vec3 force = Vec3::Zero();      // on it
  std::span<const Vec3> surface;  // three corners each, in its frame (instrument_surface.h)
};

struct VtkContact {
  std::vector<VtkInstrument> instruments;
  std::vector<ContactForce> contacts;
};

class VtkSeries {
 public:
  explicit VtkSeries(const std::filesystem::path& directory);

  void add(double t, const std::vector<VtkBody>& bodies, const VtkContact& contact);
  // Writes scene.pvd; the series can be opened from then on.
  void finish() const;
  int frames() const { return frames_; }

 private:
  void add_body(std::size_t part, const VtkBody& body);
  void part(int index, const std::string& file);

  std::filesystem::path directory_;
  int frames_ = 0;
  double t_ = 0;
  std::string parts_;                                    // the .pvd's lines
  std::vector<std::vector<std::uint8_t>> removed_seen_;  // per body: `alive` of the newest removed file
  std::vector<std::string> removed_file_, still_file_;   // per body
};

}  // namespace hapticd
