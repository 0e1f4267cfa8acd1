// Two small boxes side by side, for the mesh readers' tests: groups of every dimension, and a stray point.
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 1, 1};
Box(2) = {1, 0, 0, 1, 1, 1};
Coherence;
bottom() = Surface In BoundingBox {-0.1, -0.1, -0.1, 2.1, 1.1, 0.1};
Physical Volume("left") = {1};
Physical Volume("right") = {2};
Physical Surface("bottom") = {bottom()};
Physical Curve("edge") = {1};
Physical Point("corner") = {1};
Mesh.MeshSizeMin = 2;
Mesh.MeshSizeMax = 2;
Mesh.RandomSeed = 1;
