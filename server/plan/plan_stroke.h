// The motion along which a plan tries its choices: a piece of the scene's own trajectory, or a press made up.
//
//   trajectory   the window that goes deepest and farthest within the bodies at rest, before anything is cut;
//                the way there in steps of a quarter of the alarm distance, however long it took
//   made up      where there is none, or it touches nothing: from the device's origin to the nearest point of
//                each body within reach, half the tip's radius deep, and a radius sideways, at a hand's
//                0.1 m/s · position_scale
//
// Poses are the instrument's in the scene, one a millisecond; gaps are to samples of the surface at rest.
// Units: m, s.
#pragma once

#include <string>
#include <vector>

#include "server/scene/scene.h"

namespace hapticd {

struct PilotStroke {
  std::vector<Pose> approach;  // before it, one a simulation step: a window may begin deep inside
  std::vector<Pose> pose;
  std::string text;  // "2.31 to 2.71 s of press.csv"
};

PilotStroke pilot_stroke(const Scene& scene, double seconds);

// Least distance between the body at rest and where the device can bring the instrument [m]: its workspace,
// scaled, about the mapping's origin, grown by the instrument. Below 0: within reach.
double beyond_reach(const Scene& scene, const SceneBody& body);

}  // namespace hapticd
