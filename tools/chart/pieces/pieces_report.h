// What `haptic chart pieces` prints and writes of what it measured.
//
// Units: in the keys and words.
#pragma once

#include <vector>

#include "tools/chart/pieces/piece_check.h"
#include "tools/chart/pieces/piece_push.h"
#include "tools/chart/pieces/piece_solvers.h"
#include "tools/chart/pieces/stirred_scene.h"

namespace hapticd {

nlohmann::ordered_json to_json(const StirFigures& figures);
nlohmann::ordered_json to_json(const TissueCheck& check);
nlohmann::ordered_json to_json(const PieceSolverPoint& point);
nlohmann::ordered_json to_json(const PushPoint& point);

void print(const StirFigures& figures);
void print(const TissueFindings& theory);
void print(const std::vector<PieceSolverPoint>& solvers);
void print(const std::vector<PushPoint>& pushes);

}  // namespace hapticd
