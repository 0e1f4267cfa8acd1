// A slab, 26 × 8 × 5 mm, standing on z = 0, with a notch under the end of its upper half: a flap to peel off.
// The plane in which the notch ends is one of element faces. Groups: volume `slab`, surface `bottom`. Metres.
SetFactory("OpenCASCADE");
x = 26e-3; y = 8e-3; z = 5e-3; middle = 2.5e-3; notch = 6e-3; gap = 0.9e-3; eps = 1e-6;
// Seen along y: the base, and the flap above it.
Point(1) = {0, 0, 0};
Point(2) = {x, 0, 0};
Point(3) = {x, 0, middle};
Point(4) = {notch, 0, middle};
Point(5) = {0, 0, middle - gap};
Point(6) = {x, 0, z};
Point(7) = {0, 0, z};
Point(8) = {0, 0, middle + gap};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 1};
Line(6) = {3, 6}; Line(7) = {6, 7}; Line(8) = {7, 8}; Line(9) = {8, 4};
Curve Loop(1) = {1, 2, 3, 4, 5};
Curve Loop(2) = {6, 7, 8, 9, -3};
Plane Surface(1) = {1};
Plane Surface(2) = {2};
Extrude {0, y, 0} { Surface{1, 2}; }
Coherence;
bottom() = Surface In BoundingBox {-eps, -eps, -eps, x + eps, y + eps, eps};
Physical Volume("slab") = {1, 2};
Physical Surface("bottom") = {bottom()};
Mesh.MeshSizeMin = 1.2e-3;
Mesh.MeshSizeMax = 1.2e-3;
Mesh.Optimize = 1;
Mesh.Algorithm = 6;
Mesh.Algorithm3D = 1;
Mesh.RandomSeed = 1;
