// The scene as it is to be shown, from whatever tells of it, and its messages for the page.
//
// Bodies are told once, then what moved and what is gone; `messages` makes those that changed since it was
// last asked:
//   scene          JSON: the bodies (name, whether they deform, whether they are a shell), the instruments
//                  (name, id of the device, shape)
//   rest/B, surface/B, motion/B, contacts    binary (frames.h)
// Nothing is computed until it is asked for, so a scene that nobody looks at costs a copy. A body told again
// begins anew, and so does one whose removed tetrahedra are back (the daemon was started again). A shell has
// no node inside: one layer of tetrahedra, drawn translucent like what is rigid. A piece is loose when shared
// faces no longer join it to the largest. Units: m, N, s. Thread safety: one thread. Errors:
// std::invalid_argument for a mesh that is none; what does not fit a body is left out.
#pragma once

#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "physics/tissue/surface.h"
#include "tools/view/outbox.h"
#include "tools/view/strain.h"

namespace hapticd {

struct ViewInstrument {
  std::string name;
  std::uint32_t device_id = 0;
  std::vector<float> primitives;  // 10 each, as SceneInstrument has them
};

class ViewScene {
 public:
  // opened: faces that cuts made (surface.h).
  void tell_body(std::uint32_t id, const std::string& name, bool deformable, TetMesh mesh,
                 std::vector<std::uint32_t> opened = {});
  // Number `index` of `count` instruments.
  void tell_instrument(std::uint32_t index, std::uint32_t count, ViewInstrument instrument);
  // nodes: 3 each; alive: 1 bit per tetrahedron, least significant first.
  void tell_motion(std::uint32_t id, double time, std::span<const float> nodes,
                   std::span<const std::uint8_t> alive);
  // instruments: position, quaternion of each; contacts: 7 each; pressing: 2 per contact.
  void tell_contacts(double time, std::span<const float> instruments, std::span<const float> contacts,
                     std::span<const std::uint8_t> pressing);

  std::vector<SharedMessage> messages();

 private:
  struct Body {
    std::string name;
    bool deformable = false, shell = false;
    TetMesh mesh;
    std::vector<std::uint32_t> opened;
    std::vector<int> across;  // faces_across
    std::optional<BoundarySurface> surface;
    std::optional<StrainAtNodes> strain;
    double time = 0;
    std::vector<float> rest, nodes;
    std::vector<std::uint8_t> alive, drawn;  // per tetrahedron; as `surface` has them
    bool is_new = true, moved = true;
  };

  void follow(Body& body);
  nlohmann::json description() const;

  std::map<std::uint32_t, Body> bodies_;
  std::map<std::uint32_t, ViewInstrument> instruments_;
  std::vector<float> poses_, contacts_;
  std::vector<std::uint8_t> pressing_;
  double time_ = 0;
  bool scene_changed_ = false, contacts_changed_ = false;
};

// Per living tetrahedron whether it belongs to another than the largest piece joined by faces.
std::vector<std::uint8_t> loose_tets(std::span<const int> across, std::span<const std::uint8_t> alive);

}  // namespace hapticd
