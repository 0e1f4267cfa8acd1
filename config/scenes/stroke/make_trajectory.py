#!/usr/bin/python3
"""Writes stroke.csv: a stroke across the lens's anterior pole at a constant 20 mm/s, 0.3 mm deep.

The tip's sphere comes down along a cosine, keeps its depth below the lens's anterior sphere (radius 10 mm), turns
from 17 degrees to one side to 17 degrees to the other as it goes, and leaves as it came. Device coordinates:
scene = origin + position_scale * device, as in stroke.yaml.
"""
import math
import pathlib

SCALE, ORIGIN_Z = 0.08, 1.2e-3
POLE, RADIUS, TIP = 1.75e-3, 10e-3, 0.6e-3
DEPTH, GAP, HALF, RAMP = 0.3e-3, 0.1e-3, 2.6e-3, 1.6e-3
SPEED, TILT, DT = 20e-3, 0.3, 2e-3


def place(x):
    """Centre of the tip over the abscissa."""
    way = min(1.0, (HALF - abs(x)) / RAMP)
    down = 0.5 - 0.5 * math.cos(math.pi * max(0.0, way))
    return POLE - (RADIUS - math.sqrt(RADIUS**2 - x**2)) + TIP + GAP - (GAP + DEPTH) * down


def main():
    x, t, rows = -HALF, 0.0, []
    while x <= HALF:
        rows.append((t, x))
        for _ in range(100):  # along the path at constant speed
            slope = (place(x + 1e-7) - place(x - 1e-7)) / 2e-7
            x += SPEED * DT / 100 / math.hypot(1, slope)
        t += DT
    lines = ["t,px,py,pz,qx,qy,qz,qw"]
    for t, x in rows:
        angle = TILT * x / HALF
        lines.append(f"{t:.4f},{x / SCALE:.7f},0.0000000,{(place(x) - ORIGIN_Z) / SCALE:.7f},"
                     f"0.000000000,{math.sin(angle / 2):.9f},0.000000000,{math.cos(angle / 2):.9f}")
    (pathlib.Path(__file__).parent / "stroke.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
