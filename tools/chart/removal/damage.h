// What happens to a body in `haptic chart removal`, one by one: elements that a tip takes, or strips that a
// blade cuts.
//
// The hole grows from the lens's anterior pole as a tip makes it: it stands, takes what is within one and a
// half element lengths, nearest first, then goes on to the nearest element of the innermost shell around the
// pole (two element lengths thick) that is not empty. The blade's upright edge, three element lengths long,
// is drawn through the body from side to side, a quarter of an element length a strip; cuts lie one and a
// half element lengths apart, in layers from the top down, first along x, then along y and through those.
// Units: m, rest shape. Errors: std::runtime_error where the model has no room for a cut.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "physics/cutting/blade_cut.h"
#include "physics/tissue/surface.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

struct DamageStep {
  Vec3 tip;      // where the instrument is
  int tet = -1;  // the element that goes; −1: a strip is cut …
  std::array<Vec3, 2> from{Vec3::Zero(), Vec3::Zero()},
      to = from;        // … between these places of the blade's edge
  bool begins = false;  // with it another cut begins
  bool counts = true;   // false: the strip changes nothing
};

// Tetrahedra in the order in which the hole takes them, at most `count`, and where the tip is then.
std::vector<DamageStep> growing_hole(const TissueModel& model, int count);

struct BladeWay {
  std::vector<DamageStep> strips;
  int cuts = 0;   // strips that change the mesh
  MeshRoom used;  // what they add
};

// As many strips as change the mesh `count` times, or all there are. model: with room for them.
BladeWay way_of_blade(const TissueModel& model, int count);

// A body that is damaged. `model` is its own.
class Specimen {
 public:
  explicit Specimen(const TissueModel& whole);
  Specimen(const Specimen&) = delete;
  Specimen& operator=(const Specimen&) = delete;

  // The elements that went, or that the cut has changed, new ones among them; none: nothing was met.
  std::span<const int> apply(const DamageStep& step);

  const TissueModel& model() const { return *model_; }
  const TissueState& state() const { return state_; }

 private:
  struct Cutting {
    explicit Cutting(TissueModel& model);
    CutWorkspace work;
    TopologyChange change;
    BladeCut blade;
    SweptSurface strip;
    BoundarySurface surface;
  };

  std::unique_ptr<TissueModel> model_;
  TissueState state_;
  std::unique_ptr<Cutting> cutting_;  // null: the model has no room
  int gone_ = -1;
};

}  // namespace hapticd
