#!/usr/bin/python3
"""Writes press.csv: six seconds of a stylus over the cube. Press 3 mm, drag, remove a furrow, withdraw.

Minimum-jerk segments in the scene's frame, which is the device's too; the stick stands upright.
"""
import os

RATE = 125  # samples per second
PHACO, ASPIRATION = 1, 2
TOP, TIP_RADIUS = 20e-3, 3e-3


def over_cube(x, depth):
    return (x * 1e-3, 0.0, TOP + TIP_RADIUS - depth * 1e-3)


# (duration [s], place at its end, pedals)
SEGMENTS = [
    (1.0, over_cube(-4, -1), 0),
    (0.8, over_cube(-4, 3), 0),
    (0.2, over_cube(-4, 3), 0),
    (1.2, over_cube(0, 3), 0),
    (1.6, over_cube(4, 3.5), PHACO | ASPIRATION),
    (1.0, over_cube(4, -12), 0),
    (0.2, over_cube(4, -12), 0),
]


def main():
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "press.csv")
    with open(path, "w", encoding="ascii") as out:
        out.write("# Made by make_trajectory.py. Device frame; s, m. Buttons: 1 phaco, 2 aspiration.\n")
        out.write("t,px,py,pz,qx,qy,qz,qw,buttons\n")
        begin, place = 0.0, over_cube(-4, -12)
        for duration, target, pedals in SEGMENTS:
            n = round(duration * RATE)
            for i in range(n):
                u = i / n
                s = u * u * u * (10 - 15 * u + 6 * u * u)
                p = [a + s * (b - a) for a, b in zip(place, target)]
                values = ",".join(f"{v:.7f}" for v in p)
                out.write(f"{begin + i / RATE:.3f},{values},0,0,0,1,{pedals}\n")
            begin, place = begin + n / RATE, target
        out.write(f"{begin:.3f}," + ",".join(f"{v:.7f}" for v in place) + ",0,0,0,1,0\n")


if __name__ == "__main__":
    main()
