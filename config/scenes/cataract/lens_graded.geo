// The lens of lens.geo, finer where the instrument reaches: elements no larger than half the tip's radius in a
// bowl under the anterior pole. Same shape, same groups.
reach = 1.2;  // radius of the bowl [mm]
deep = 1.2;   // its depth below the pole [mm]
fine = 0.18;  // element size in it [mm]
Include "lens.geo";

// From the bowl on, sizes grow to those of lens.geo within about its own radius.
Field[2] = MathEval;
Field[2].F = Sprintf("%g + %g * Max(0, Sqrt((x^2 + y^2) / %g + (z - %g)^2 / %g) - 1)", fine * mm, 0.5 * mm,
                     (reach * mm)^2, anterior_pole, (deep * mm)^2);
Field[3] = Min;
Field[3].FieldsList = {1, 2};
Background Field = 3;
