#!/usr/bin/python3
"""Writes stroke.csv: the stylus of the cataract scene, in the device's frame.

Twenty seconds: approach, touch (press 0.3 mm, slide), sculpt three grooves across the anterior lens with both
pedals down, withdraw. The tip's path is made of minimum-jerk segments in the scene's frame; the shaft always
passes through the middle of the incision (cornea.geo), which fixes the orientation; the result is taken back
through the scene's mapping (cataract.yaml: origin, position_scale; frame and tool are identities).
"""
import math
import os

RATE = 125.0  # samples per second
MM = 1e-3
ORIGIN = (0.0, 2.2 * MM, 1.2 * MM)  # mapping.origin
POSITION_SCALE = 0.08  # mapping.position_scale
TIP_RADIUS = 0.5 * MM

ANTERIOR_POLE, ANTERIOR_RADIUS = 1.75 * MM, 10.0 * MM  # profile.geo
INCISION_Y = -4.2 * MM  # cornea.geo
INCISION = (0.0, INCISION_Y, (5.35 - 7.25) * MM + math.sqrt((7.525 * MM) ** 2 - INCISION_Y**2))

PHACO, ASPIRATION = 1, 2


def over_lens(x, y, depth):
    """Centre of the tip's sphere with its lowest point `depth` below the lens's surface at rest [mm]."""
    z = ANTERIOR_POLE - ANTERIOR_RADIUS + math.sqrt(ANTERIOR_RADIUS**2 - (x * MM) ** 2 - (y * MM) ** 2)
    return (x * MM, y * MM, z + TIP_RADIUS - depth * MM)


def segments():
    """(duration [s], place at its end, pedals)."""
    both = PHACO | ASPIRATION
    yield 0.3, None, 0
    yield 1.7, over_lens(0.0, -0.6, -0.25), 0  # approach
    yield 0.8, over_lens(0.0, -0.6, 0.3), 0  # touch
    yield 0.3, None, 0
    yield 0.8, over_lens(0.5, -0.3, 0.3), 0  # slide
    yield 0.6, over_lens(0.0, -1.6, 0.1), 0
    # Grooves: forward at 2 to 3.5 mm/s, deeper each time; back above the lens.
    for x, depth, near, far in (
        (0.0, 0.45, -1.6, 0.9),
        (0.0, 0.90, -1.5, 0.8),
        (0.0, 1.35, -1.2, 0.7),
        (0.9, 0.45, -1.4, 0.7),
        (0.9, 0.90, -1.3, 0.6),
        (-0.9, 0.45, -1.4, 0.7),
    ):
        yield 0.4, over_lens(x, near - 0.1, -0.1), ASPIRATION
        yield 0.4, over_lens(x, near, depth), both
        yield 1.3, over_lens(x, far, depth), both
        yield 0.2, over_lens(x, far - 0.1, depth - 0.6), ASPIRATION
    yield 0.4, over_lens(0.0, -0.6, -0.4), ASPIRATION
    yield 1.0, START, 0  # withdraw


def along_shaft(tip, distance):
    d = direction(tip)
    return tuple(t + distance * a for t, a in zip(tip, d))


def direction(tip):
    d = [p - t for p, t in zip(INCISION, tip)]
    n = math.sqrt(sum(a * a for a in d))
    return [a / n for a in d]


def orientation(tip):
    """Unit quaternion x, y, z, w whose z axis is the shaft's direction and whose x axis stays level."""
    z = direction(tip)
    n = math.hypot(z[0], z[1])
    x = [-z[1] / n, z[0] / n, 0.0]
    y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]]
    # The trace is positive for a shaft that points to the user and up.
    w = 0.5 * math.sqrt(1.0 + x[0] + y[1] + z[2])
    return ((y[2] - z[1]) / (4 * w), (z[0] - x[2]) / (4 * w), (x[1] - y[0]) / (4 * w), w)


def minimum_jerk(u):
    return u * u * u * (10 - 15 * u + 6 * u * u)


START = along_shaft(over_lens(0.0, -0.6, -0.5), 1.6 * MM)


def main():
    rows = []
    begin, place = 0.0, START
    for duration, target, pedals in segments():
        target = place if target is None else target
        n = round(duration * RATE)
        for i in range(n):
            s = minimum_jerk(i / n)
            rows.append((begin + i / RATE, [a + s * (b - a) for a, b in zip(place, target)], pedals))
        begin, place = begin + n / RATE, target
    rows.append((begin, list(place), 0))

    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "stroke.csv")
    with open(path, "w", encoding="ascii") as out:
        out.write("# Made by make_trajectory.py. Device frame; s, m. Buttons: 1 phaco, 2 aspiration.\n")
        out.write("t,px,py,pz,qx,qy,qz,qw,buttons\n")
        for t, tip, pedals in rows:
            p = [(a - o) / POSITION_SCALE for a, o in zip(tip, ORIGIN)]
            values = ",".join(f"{v:.7f}" for v in (*p, *orientation(tip)))
            out.write(f"{t:.3f},{values},{pedals}\n")


if __name__ == "__main__":
    main()
