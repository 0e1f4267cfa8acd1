#!/usr/bin/python3
"""Writes sweep.csv and pit.csv: twenty seconds each of an upright tip on the anterior lens, 0.25 mm deep.

Lissajous figures in the scene's frame at up to 3 mm/s, one second down and one up; the phaco pedal is down in
between. The one goes across the whole lens, the other stays within 0.45 mm of the pole. The results are taken back
through the scenes' mapping (lens_5k.yaml, lens_20k.yaml: origin, position_scale).
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


def write(name, width, period):
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), name)
    with open(path, "w", encoding="ascii") as out:
        out.write("# Made by make_trajectory.py. Device frame; s, m. Buttons: 1 phaco.\n")
        out.write("t,px,py,pz,buttons\n")
        for i in range(int(DURATION * RATE) + 1):
            t = i / RATE
            down = min(smooth(t - 0.5), smooth(DURATION - 0.5 - t))
            x = width * MM * math.sin(2 * math.pi * t / period)
            y = width / 2.4 * 2.2 * MM * math.sin(2 * math.pi * t / (1.3 * period) + 0.6)
            surface = ANTERIOR_POLE - ANTERIOR_RADIUS + math.sqrt(ANTERIOR_RADIUS**2 - x * x - y * y)
            z = surface + TIP_RADIUS - DEPTH * down + CLEAR * (1 - down)
            p = [x / POSITION_SCALE, y / POSITION_SCALE, (z - ORIGIN_Z) / POSITION_SCALE]
            out.write(f"{t:.3f}," + ",".join(f"{v:.7f}" for v in p) + f",{PHACO if down == 1.0 else 0}\n")


if __name__ == "__main__":
    write("sweep.csv", 2.4, 7.0)
    write("pit.csv", 0.33, 1.0)
