// Each of two hands in one body: the largest stiffness it is displayed soundly, whatever the other does
// meanwhile.
//
// A wall has no sides to slide to; a ball on the samples of a face does, and a hand then holds it by its grip
// alone. So the hand that is judged presses along a guide, as on a stage that measures stiffness; without the
// guide it is charted beside, for the first hand in the cube.
// Both press the cube scene's ball, 10 mm apart, the second on a coupling half as stiff. The other holds its
// device rigidly, 2 mm deep (`still`); pushes 0.75 mm to and fro at 10 Hz in the first half of each hold
// (`pushes`); or its client dies in the second hold (`dies`); `alone`: there is no other. Displayed stiffness
// and judgement are those of largest_stiffness.h, from starts between which the encoder's zero moves, the
// wall's and each row's alike; where a client dies, what is displayed is the stiffer of the two holds. Asked
// are four fifths of a wall as viscous as the tissue, which is what a perfect renderer of it would be; the
// best wall of any viscosity is charted beside. A nearly free body moves away: it is judged at the tissue's
// own scale. Of a hand beside one that stands still the tissue may give nothing; of one beside one that
// pushes the energy of both counts, from when the first begins; and where a client dies, from the start. Both
// devices scale forces alike. Units: SI.
#pragma once

#include "tools/stability/stability.h"

namespace hapticd {

// Adds the rows (one body and one hand, if quick) and their mode; false: stopped.
bool chart_two_hands(StabilityBench& bench, bool quick, StabilityChart& chart, const ModeProgress& progress);

}  // namespace hapticd
