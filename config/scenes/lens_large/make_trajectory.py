#!/usr/bin/python3
"""Writes sweep.csv: twenty seconds of an upright tip sweeping across the whole anterior lens, 0.25 mm deep.

A Lissajous figure in the scene's frame at up to 3 mm/s, one second down and one up; the phaco pedal is down in
between. The result is taken back through the scene's mapping (lens_5k.yaml: origin, position_scale).
"""
import math
import os

RATE, DURATION = 125, 20.0  # samples per second, s
MM = 1e-3
ORIGIN_Z, POSITION_SCALE = 1.2 * MM, 0.08  # mapping.origin, mapping.position_scale
TIP_RADIUS, DEPTH, CLEAR = 0.5 * MM, 0.25 * MM, 1.5 * MM
ANTERIOR_POLE, ANTERIOR_RADIUS = 1.75 * MM, 10.0 * MM  # ../cataract/profile.geo
PHACO = 1


def smooth(u):
    u = min(max(u, 0.0), 1.0)
    return u * u * u * (10 - 15 * u + 6 * u * u)


def main():
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "sweep.csv")
    with open(path, "w", encoding="ascii") as out:
        out.write("# Made by make_trajectory.py. Device frame; s, m. Buttons: 1 phaco.\n")
        out.write("t,px,py,pz,buttons\n")
        for i in range(int(DURATION * RATE) + 1):
            t = i / RATE
            down = min(smooth(t - 0.5), smooth(DURATION - 0.5 - t))
            x = 2.4 * MM * math.sin(2 * math.pi * t / 7.0)
            y = 2.2 * MM * math.sin(2 * math.pi * t / 9.1 + 0.6)
            surface = ANTERIOR_POLE - ANTERIOR_RADIUS + math.sqrt(ANTERIOR_RADIUS**2 - x * x - y * y)
            z = surface + TIP_RADIUS - DEPTH * down + CLEAR * (1 - down)
            p = [x / POSITION_SCALE, y / POSITION_SCALE, (z - ORIGIN_Z) / POSITION_SCALE]
            out.write(f"{t:.3f}," + ",".join(f"{v:.7f}" for v in p) + f",{PHACO if down == 1.0 else 0}\n")


if __name__ == "__main__":
    main()
