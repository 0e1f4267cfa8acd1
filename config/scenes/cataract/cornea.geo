// Cornea: outer radius 7.8 mm, thickness 0.55 mm, diameter 11.5 mm, with an incision of 2.6 mm for the
// instrument, bored along the shaft's nominal axis. Metres; same frame as lens.geo.
SetFactory("OpenCASCADE");
mm = 1e-3;
outer_radius = 7.8 * mm;
inner_radius = 7.25 * mm;
rim = 5.75 * mm;
inner_apex = 5.35 * mm;  // anterior chamber 3.6 mm deep
zc = inner_apex - inner_radius;

Sphere(1) = {0, 0, zc, outer_radius};
Sphere(2) = {0, 0, zc, inner_radius};
Cylinder(3) = {0, 0, zc, 0, 0, 2 * outer_radius, rim};
shell() = BooleanDifference{ Volume{1}; Delete; }{ Volume{2}; Delete; };
dome() = BooleanIntersection{ Volume{shell(0)}; Delete; }{ Volume{3}; Delete; };

// The incision's middle, and the direction of the shaft from the tip's nominal place through it.
py = -4.2 * mm;
pz = zc + Sqrt((0.5 * (outer_radius + inner_radius))^2 - py^2);
dy = py + 0.6 * mm;
dz = pz - 2.23 * mm;
length = Sqrt(dy^2 + dz^2);
reach = 2.5 * mm;
Cylinder(10) = {0, py - reach * dy / length, pz - reach * dz / length,
                0, 2 * reach * dy / length, 2 * reach * dz / length, 1.3 * mm};
cornea() = BooleanDifference{ Volume{dome(0)}; Delete; }{ Volume{10}; Delete; };

Physical Volume("cornea") = {cornea()};

Mesh.MeshSizeFromCurvature = 10;
Mesh.MeshSizeMin = 0.5 * mm;
Mesh.MeshSizeMax = 1.0 * mm;
Mesh.Optimize = 1;
Mesh.Algorithm = 6;
Mesh.Algorithm3D = 1;
Mesh.RandomSeed = 1;
