#!/usr/bin/env python3
"""Meshes and strokes of the five economy scenes: boxes of 6 tetrahedra a cell, strokes in metres.

The same bytes each time. Run in this folder.
"""
import itertools
import math


def box(name, low, size, cells, fixed):
    """A box [low, low + size]; `fixed(x, y, z)` in 0..1 says which nodes the group 'held' has."""
    nx, ny, nz = cells
    nodes = [(i, j, k) for k in range(nz + 1) for j in range(ny + 1) for i in range(nx + 1)]
    index = {n: i + 1 for i, n in enumerate(nodes)}
    tets = []
    for k, j, i in itertools.product(range(nz), range(ny), range(nx)):
        for order in itertools.permutations(range(3)):
            at = [i, j, k]
            corners = [tuple(at)]
            for axis in order:
                at[axis] += 1
                corners.append(tuple(at))
            even = order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
            tets.append(corners if even else [corners[0], corners[2], corners[1], corners[3]])
    held = [n for n in nodes if fixed(n[0] / nx, n[1] / ny, n[2] / nz)]
    with open(name, 'w') as out:
        out.write('$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n0 1 "held"\n3 2 "body"\n'
                  '$EndPhysicalNames\n$Nodes\n%d\n' % len(nodes))
        for n in nodes:
            x = [low[a] + size[a] * n[a] / cells[a] for a in range(3)]
            out.write('%d %.9g %.9g %.9g\n' % (index[n], *x))
        out.write('$EndNodes\n$Elements\n%d\n' % (len(held) + len(tets)))
        number = 0
        for n in held:
            number += 1
            out.write('%d 15 2 1 1 %d\n' % (number, index[n]))
        for t in tets:
            number += 1
            out.write('%d 4 2 2 1 %d %d %d %d\n' % (number, *(index[c] for c in t)))
        out.write('$EndElements\n')


def smooth(s):
    s = min(max(s, 0.0), 1.0)
    return s * s * (3 - 2 * s)


def stroke(name, seconds, place):
    with open(name, 'w') as out:
        out.write('t,px,py,pz\n')
        for i in range(int(round(seconds * 125)) + 1):
            t = i / 125
            out.write('%.3f,%.6e,%.6e,%.6e\n' % (t, *place(t)))


mm = 1e-3
bottom = lambda x, y, z: z == 0

# A pad pressed 0.8 mm deep within half a second, and let go.
box('pad.msh', (-12 * mm, -12 * mm, -10 * mm), (24 * mm, 24 * mm, 10 * mm), (8, 8, 4), bottom)
stroke('pad.csv', 1.2, lambda t: (0, 0, (0.4 - 1.2 * (smooth(t / 0.6) - smooth((t - 0.7) / 0.5))) * mm))

# A lens-soft block, and a steel bar lying across it; the tip presses the block beside the bar and touches the bar.
box('soft.msh', (-6 * mm, -6 * mm, -6 * mm), (12 * mm, 12 * mm, 6 * mm), (7, 7, 4), bottom)
box('bar.msh', (1.5 * mm, -9 * mm, 0.02 * mm), (1.5 * mm, 18 * mm, 1 * mm), (2, 12, 2),
    lambda x, y, z: y == 0 or y == 1)
stroke('stiff_tool.csv', 1.2, lambda t: (
    (-1.5 + 2.2 * smooth((t - 0.5) / 0.4)) * mm, 0, (0.2 - 0.6 * (smooth(t / 0.4) - smooth((t - 1.0) / 0.2))) * mm))

# A heavy, very soft cube tapped by 0.4 mm at 6 Hz.
box('heavy.msh', (-15 * mm, -15 * mm, -30 * mm), (30 * mm, 30 * mm, 30 * mm), (6, 6, 6), bottom)
stroke('small_motion.csv', 1.2, lambda t: (
    0, 0, (0.2 - 0.5 * smooth(t / 0.2) - 0.2 * math.sin(2 * math.pi * 6 * t) * smooth(t / 0.3)) * mm))

# A strip held at one end, whose free end is pushed down by a quarter of its length.
box('strip.msh', (0, -3 * mm, -3 * mm), (36 * mm, 6 * mm, 3 * mm), (24, 4, 2), lambda x, y, z: x == 0)
stroke('large_rotation.csv', 1.2, lambda t: (
    30 * mm, 0, (0.3 - 9 * (smooth(t / 0.7) - smooth((t - 0.8) / 0.4))) * mm))

# A block that can be cut, a flap that lies on it, a steel plate beside, and a body out of reach.
box('tissue.msh', (-8 * mm, -8 * mm, -7 * mm), (16 * mm, 16 * mm, 7 * mm), (8, 8, 4), bottom)
box('flap.msh', (2 * mm, -4 * mm, 0.05 * mm), (10 * mm, 8 * mm, 1.5 * mm), (6, 5, 1), lambda x, y, z: x == 1)
box('plate.msh', (-12 * mm, -8 * mm, -3 * mm), (3 * mm, 16 * mm, 3 * mm), (2, 6, 2), lambda x, y, z: x == 0)
box('far.msh', (200 * mm, 0, 0), (10 * mm, 10 * mm, 10 * mm), (4, 4, 4), bottom)
stroke('everything.csv', 1.2, lambda t: (
    (-3 + 4 * smooth((t - 0.3) / 0.6)) * mm, 0, (0.3 - 1.1 * (smooth(t / 0.3) - smooth((t - 1.0) / 0.2))) * mm))
