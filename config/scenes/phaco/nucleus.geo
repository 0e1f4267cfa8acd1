// The nucleus of a lens: the lens (../cataract/profile.geo) shrunk to 0.7, with its middle where the lens has it, of
// four quarters that share their faces. Metres; z is anterior. Groups: volume `nucleus`; its whole `surface`;
// `cortex`: all of that but the middle of the front, which the opened capsule leaves bare; and the planes in which
// its fibres part, `cleft_along` (x = 0) and `cleft_across` (y = 0).
SetFactory("OpenCASCADE");
Include "../cataract/profile.geo";
If (!Exists(size)) size = 0.5; EndIf  // element size [mm]
shrink = 0.7;
bare = 2.6 * mm / shrink;  // radius that the opening of the capsule leaves bare, 5.2 mm across
zb = za + Sqrt(anterior_radius^2 - bare^2);

Point(1) = {0, 0, anterior_pole};
Point(2) = {bare, 0, zb};
Point(3) = {c + rho * Cos(ua), 0, zc + rho * Sin(ua)};
Point(4) = {c + rho * Cos(up), 0, zc + rho * Sin(up)};
Point(5) = {0, 0, posterior_pole};
Point(6) = {0, 0, za};
Point(7) = {0, 0, zp};
Point(8) = {c, 0, zc};
Circle(1) = {1, 6, 2};
Circle(2) = {2, 6, 3};
Circle(3) = {3, 8, 4};
Circle(4) = {4, 7, 5};
Line(5) = {5, 1};
Curve Loop(1) = {1, 2, 3, 4, 5};
Plane Surface(1) = {1};
For quarter In {0:3}
  out() = Rotate { {0, 0, 1}, {0, 0, 0}, quarter * Pi / 2 } { Duplicata { Surface{1}; } };
  Extrude { {0, 0, 1}, {0, 0, 0}, Pi / 2 } { Surface{out(0)}; }
EndFor
Recursive Delete { Surface{1}; }
Dilate { {0, 0, 0}, shrink } { Volume{:}; }
Coherence;
all() = CombinedBoundary{ Volume{:}; };
front() = Surface In BoundingBox {-2.61 * mm, -2.61 * mm, 0.5 * mm, 2.61 * mm, 2.61 * mm, 2 * mm};
cortex() = all();
cortex() -= front();
box = 5 * mm;
thin = 0.01 * mm;
along() = Surface In BoundingBox {-thin, -box, -box, thin, box, box};
across() = Surface In BoundingBox {-box, -thin, -box, box, thin, box};

Physical Volume("nucleus") = Volume{:};
Physical Surface("surface") = {all()};
Physical Surface("cortex") = {cortex()};
Physical Surface("cleft_along") = {along()};
Physical Surface("cleft_across") = {across()};
Mesh.MeshSizeMin = size * mm;
Mesh.MeshSizeMax = size * mm;
Mesh.MeshSizeFromPoints = 0;
Mesh.Algorithm = 6;
Mesh.Algorithm3D = 1;
Mesh.Optimize = 1;
Mesh.RandomSeed = 1;
