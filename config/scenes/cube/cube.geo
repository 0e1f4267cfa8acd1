// A cube of 20 mm, standing on z = 0. Groups: volume `cube`, `bottom`, `top`. Metres.
SetFactory("OpenCASCADE");
side = 20e-3;
Box(1) = {-side / 2, -side / 2, 0, side, side, side};
eps = 1e-6;
bottom() = Surface In BoundingBox {-side, -side, -eps, side, side, eps};
top() = Surface In BoundingBox {-side, -side, side - eps, side, side, side + eps};
Physical Volume("cube") = {1};
Physical Surface("bottom") = {bottom()};
Physical Surface("top") = {top()};
Mesh.MeshSizeMin = side / 5;
Mesh.MeshSizeMax = side / 5;
Mesh.Optimize = 1;
Mesh.Algorithm = 6;
Mesh.Algorithm3D = 1;
Mesh.RandomSeed = 1;
