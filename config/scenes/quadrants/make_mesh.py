#!/usr/bin/env python3
"""nucleus.msh: a lens's nucleus cracked into four quadrants, one mesh of four connected pieces, in metres.

A quadrant is a box of cells of 6 tetrahedra, its square mapped to a quarter of a disc. The same bytes each time. Run in
this folder.
"""
import itertools
import math

CELLS = (4, 4, 3)
RADIUS = 3.2e-3
CRACK = 20e-6  # from each quadrant to the plane between it and the next
BOTTOM, BOTTOM_RADIUS = -2.2e-3, 5.5e-3  # pole and radius of curvature
TOP, TOP_RADIUS = 1.0e-3, 9.0e-3


def place(u, v, w, turn):
    x, y = u * math.sqrt(1 - v * v / 2), v * math.sqrt(1 - u * u / 2)
    x, y = RADIUS * x, RADIUS * y
    r2 = x * x + y * y
    low, high = BOTTOM + r2 / (2 * BOTTOM_RADIUS), TOP - r2 / (2 * TOP_RADIUS)
    x, y = x + CRACK, y + CRACK
    for _ in range(turn):
        x, y = -y, x
    return x, y, low + w * (high - low)


def main():
    nx, ny, nz = CELLS
    nodes, tets = [], []
    for turn in range(4):
        first = len(nodes) + 1
        index = {}
        for k, j, i in itertools.product(range(nz + 1), range(ny + 1), range(nx + 1)):
            index[i, j, k] = first + len(index)
            nodes.append(place(i / nx, j / ny, k / nz, turn))
        for k, j, i in itertools.product(range(nz), range(ny), range(nx)):
            for order in itertools.permutations(range(3)):
                at = [i, j, k]
                corners = [tuple(at)]
                for axis in order:
                    at[axis] += 1
                    corners.append(tuple(at))
                if order not in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                    corners[1], corners[2] = corners[2], corners[1]
                tets.append([index[c] for c in corners])
    with open('nucleus.msh', 'w') as out:
        out.write('$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 1 "nucleus"\n$EndPhysicalNames\n')
        out.write('$Nodes\n%d\n' % len(nodes))
        for n, x in enumerate(nodes):
            out.write('%d %.9g %.9g %.9g\n' % (n + 1, *x))
        out.write('$EndNodes\n$Elements\n%d\n' % len(tets))
        for t, corners in enumerate(tets):
            out.write('%d 4 2 1 1 %d %d %d %d\n' % (t + 1, *corners))
        out.write('$EndElements\n')


main()
