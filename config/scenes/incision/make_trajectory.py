#!/usr/bin/python3
"""Writes stroke.csv: a blade that stands upright goes in at one end of the block, 4 mm deep, is drawn through it at
10 mm/s, halts, and goes on out at the far end.

The edge looks along +x in the scene's frame, which is the device's too; the tip is the lower end of the edge.
"""
import os

RATE = 125  # samples per second
TOP, DEPTH = 10e-3, 4e-3

# (duration [s], x at its end [mm])
SEGMENTS = [(0.5, -14.0), (1.4, 0.0), (0.6, 0.0), (0.2, -1.5), (0.3, 0.0), (1.5, 15.0), (0.3, 15.0)]


def main():
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "stroke.csv")
    with open(path, "w", encoding="ascii") as out:
        out.write("# Made by make_trajectory.py. Device frame; s, m.\n")
        out.write("t,px,py,pz,qx,qy,qz,qw,buttons\n")
        begin, x = 0.0, -18.0
        for duration, target in SEGMENTS:
            n = round(duration * RATE)
            for i in range(n):
                u = i / n
                at = x + (target - x) * u
                out.write(f"{begin + i / RATE:.3f},{1e-3 * at:.7f},0.0002000,{TOP - DEPTH:.7f},0,0,0,1,0\n")
            begin, x = begin + n / RATE, target
        out.write(f"{begin:.3f},{1e-3 * x:.7f},0.0002000,{TOP - DEPTH:.7f},0,0,0,1,0\n")


if __name__ == "__main__":
    main()
