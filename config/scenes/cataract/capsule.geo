// Posterior capsular bag: one layer of tetrahedra 0.25 mm thick, 0.2 mm behind the lens's posterior surface
// (profile.geo), up to the equator. Groups: volume `capsule`, and `rim`, the edge at the equator, which the
// zonule holds.
Include "profile.geo";
gap = 0.2 * mm;
thickness = 0.25 * mm;
If (!Exists(size)) size = 0.86; EndIf  // element size [mm]
h = size * mm;
sphere = posterior_radius + gap;
edge = rho + gap;

Point(1) = {0, 0, zp - sphere, h};
Point(2) = {c + edge * Cos(up), 0, zc + edge * Sin(up), h};
Point(3) = {c + edge, 0, zc, h};
Point(4) = {0, 0, zp, h};
Point(5) = {c, 0, zc, h};
Circle(1) = {1, 4, 2};
Circle(2) = {2, 5, 3};

// Four quarter turns give the inner surface. Extrude returns, for the curve at the axis, its turned copy, the
// surface and one side; for the other its turned copy, the surface and two sides.
turned() = {1, 2};
inner() = {};
For quarter In {1:4}
  out() = Extrude { {0, 0, 1}, {0, 0, 0}, Pi / 2 } { Curve{turned(0), turned(1)}; };
  turned() = {out(0), out(3)};
  inner() += {out(1), out(4)};
EndFor

// One layer outward; the normals point to the lens.
shell() = Extrude { Surface{inner()}; Layers{ {1}, {-thickness} }; Using Index[0]; };


// Of each quarter 11 entries: of the three-sided surface its copy, its volume and 3 sides; of the four-sided
// one its copy, its volume and 4 sides, the second along the equator.
rim() = {};
For quarter In {0:3}
  rim() += {shell(11 * quarter + 8)};
EndFor

Physical Volume("capsule") = Volume{:};
Physical Surface("rim") = {rim()};
Mesh.Algorithm = 6;
Mesh.RandomSeed = 1;
