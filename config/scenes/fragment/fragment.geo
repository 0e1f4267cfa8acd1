// A quarter of a lens's nucleus, as it comes loose when the lens is cracked along two grooves: the lens
// (../cataract/profile.geo) shrunk to 0.65 and quartered, edges rounded by nothing but the mesh. It starts
// 1 mm above the capsule. Metres; z is anterior. Groups: volume `fragment`, its whole `surface`.
SetFactory("OpenCASCADE");
Include "../cataract/profile.geo";
If (!Exists(size)) size = 0.42; EndIf  // element size [mm]
shrink = 0.65;

Point(1) = {0, 0, anterior_pole};
Point(2) = {c + rho * Cos(ua), 0, zc + rho * Sin(ua)};
Point(3) = {c + rho * Cos(up), 0, zc + rho * Sin(up)};
Point(4) = {0, 0, posterior_pole};
Point(5) = {0, 0, za};
Point(6) = {0, 0, zp};
Point(7) = {c, 0, zc};
Circle(1) = {1, 5, 2};
Circle(2) = {2, 7, 3};
Circle(3) = {3, 6, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
quarter() = Extrude { {0, 0, 1}, {0, 0, 0}, Pi / 2 } { Surface{1}; };
Recursive Delete { Surface{1}; Point{5, 6, 7}; }
Dilate { {0, 0, 0}, shrink } { Volume{1}; }
Translate { 0.3 * mm, 0.3 * mm, 0.4 * mm } { Volume{1}; }
all() = Boundary{ Volume{1}; };

Physical Volume("fragment") = {1};
Physical Surface("surface") = {all()};
Mesh.MeshSizeMin = size * mm;
Mesh.MeshSizeMax = size * mm;
Mesh.MeshSizeFromPoints = 0;
Mesh.Algorithm = 6;
Mesh.Algorithm3D = 1;
Mesh.Optimize = 1;
Mesh.RandomSeed = 1;
