// Crystalline lens (profile.geo). Groups: volume `lens`, its whole `surface`, and `zonule`: the band of
// 0.8 mm at the equator where the zonule's fibres hold it.
SetFactory("OpenCASCADE");
Include "profile.geo";
If (!Exists(skin)) skin = 0.62; EndIf  // element size at the surface and in the middle [mm]
If (!Exists(core)) core = 0.485; EndIf
band = Asin(0.4 * mm / rho);

Point(1) = {0, 0, anterior_pole};
Point(2) = {c + rho * Cos(ua), 0, zc + rho * Sin(ua)};
Point(3) = {c + rho * Cos(band), 0, zc + rho * Sin(band)};
Point(4) = {c + rho * Cos(band), 0, zc - rho * Sin(band)};
Point(5) = {c + rho * Cos(up), 0, zc + rho * Sin(up)};
Point(6) = {0, 0, posterior_pole};
Point(7) = {0, 0, za};
Point(8) = {0, 0, zp};
Point(9) = {c, 0, zc};
Circle(1) = {1, 7, 2};
Circle(2) = {2, 9, 3};
Circle(3) = {3, 9, 4};
Circle(4) = {4, 9, 5};
Circle(5) = {5, 8, 6};
Line(6) = {6, 1};
Curve Loop(1) = {1, 2, 3, 4, 5, 6};
Plane Surface(1) = {1};
Extrude { {0, 0, 1}, {0, 0, 0}, 2 * Pi } { Surface{1}; }
Recursive Delete { Surface{1}; }
all() = Boundary{ Volume{1}; };
box = 5 * mm;
equator() = Surface In BoundingBox {-box, -box, zc - 0.45 * mm, box, box, zc + 0.45 * mm};

Physical Volume("lens") = {1};
Physical Surface("surface") = {all()};
Physical Surface("zonule") = {equator()};

// Gmsh's lone surface sizes give more nodes per tetrahedron than the published lens has: finer in the middle.
Field[1] = MathEval;
Field[1].F = Sprintf("%g + %g * ((x^2 + y^2) / %g + z^2 / %g)", core * mm, (skin - core) * mm, (4.5 * mm)^2,
                     (2.1 * mm)^2);
Background Field = 1;
Mesh.MeshSizeFromPoints = 0;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.Algorithm = 6;    // Frontal-Delaunay on the surface
Mesh.Algorithm3D = 1;  // Delaunay inside
Mesh.Optimize = 1;
Mesh.RandomSeed = 1;
