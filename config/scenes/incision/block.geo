// A block of tissue, 24 × 12 × 10 mm, standing on z = 0. Groups: volume `block`, surface `bottom`. Metres.
SetFactory("OpenCASCADE");
x = 24e-3; y = 12e-3; z = 10e-3;
Box(1) = {-x / 2, -y / 2, 0, x, y, z};
eps = 1e-6;
bottom() = Surface In BoundingBox {-x, -y, -eps, x, y, eps};
Physical Volume("block") = {1};
Physical Surface("bottom") = {bottom()};
Mesh.MeshSizeMin = 1.6e-3;
Mesh.MeshSizeMax = 1.6e-3;
Mesh.Optimize = 1;
Mesh.Algorithm = 6;
Mesh.Algorithm3D = 1;
Mesh.RandomSeed = 1;
