// The cataract scene's cornea (../cataract/cornea.geo) with a second opening: a side port of 1.2 mm, 75 degrees
// from the incision towards the surgeon's left, bored along the chopper's mean axis.
Include "../cataract/cornea.geo";
port_radius = 0.6 * mm;
port_angle = -Pi / 2 - 75 * Pi / 180;
sx = 4.6 * mm * Cos(port_angle);
sy = 4.6 * mm * Sin(port_angle);
sz = zc + Sqrt((0.5 * (outer_radius + inner_radius))^2 - (4.6 * mm)^2);
// From where the tip works on average: between the lens's periphery and the needle.
ax = sx + 1.2 * mm;
ay = sy + 0.15 * mm;
az = sz - 1.9 * mm;
axis = Sqrt(ax^2 + ay^2 + az^2);
side = 1.2 * mm;
Cylinder(20) = {sx - side * ax / axis, sy - side * ay / axis, sz - side * az / axis,
                2 * side * ax / axis, 2 * side * ay / axis, 2 * side * az / axis, port_radius};
both() = BooleanDifference{ Volume{cornea(0)}; Delete; }{ Volume{20}; Delete; };
