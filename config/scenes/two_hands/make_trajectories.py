#!/usr/bin/python3
"""Writes sculpt.csv and hold.csv: the two styluses of the scene two_hands, each in its device's frame.

Both have one time axis of twenty seconds. The chopper enters, presses the left periphery of the lens and holds. The
needle presses near the middle. The chopper turns the lens a little, and goes on pushing while the needle sculpts two
grooves on the right. Then the chopper comes below the needle, whose shaft touches it once, and both leave.

two_hands.yaml names the windows in which forces can be compared. How hands move: ../hands.py.
"""
import math
import pathlib
import sys

FOLDER = pathlib.Path(__file__).parent
sys.path.insert(0, str(FOLDER.parent))
sys.dont_write_bytecode = True
import hands
from hands import ASPIRATION, MM, PHACO, along

DURATION = 20.0  # s
ANTERIOR_POLE, ANTERIOR_RADIUS = 1.75 * MM, 10.0 * MM  # ../cataract/profile.geo


def over_lens(tip_radius, x, y, depth):
    """Centre of a ball that reaches `depth` below the lens's surface at rest, along the normal there [mm]."""
    x, y = x * MM, y * MM
    z = math.sqrt(ANTERIOR_RADIUS**2 - x * x - y * y)
    grown = 1 + (tip_radius - depth * MM) / ANTERIOR_RADIUS
    return (x * grown, y * grown, ANTERIOR_POLE - ANTERIOR_RADIUS + z * grown)


needle, chopper = hands.needle(FOLDER / "sculpt.csv"), hands.chopper(FOLDER / "hold.csv")
NEEDLE_TIP, CHOPPER_TIP = 0.5 * MM, 0.3 * MM

# Where they touch: the needle's axis passes that far above the chopper's.
NEEDLE_RADIUS, CHOPPER_RADIUS = 0.45 * MM, 0.25 * MM
MEETING = (0.55 * MM, -0.35 * MM, 2.2 * MM)  # the chopper's tip


def apart(a, b, c, d):
    """Distance of the lines a-b and c-d."""
    u, v, w = ([q - p for p, q in zip(m, n)] for m, n in ((a, b), (c, d), (a, c)))
    n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    return abs(sum(p * q for p, q in zip(n, w))) / math.hypot(*n)


def above_chopper(gap):
    """The needle's tip at (0.1, 0.3) mm, with its shaft `gap` [mm] from the chopper's."""
    low, high = MEETING[2], MEETING[2] + 3 * MM
    while high - low > 1e-10:
        z = 0.5 * (low + high)
        distance = apart((0.1 * MM, 0.3 * MM, z), needle.entry, MEETING, chopper.entry)
        low, high = (z, high) if distance < NEEDLE_RADIUS + CHOPPER_RADIUS + gap * MM else (low, z)
    return (0.1 * MM, 0.3 * MM, high)


def sculpt():
    def over(x, y, depth):
        return over_lens(NEEDLE_TIP, x, y, depth)

    both = PHACO | ASPIRATION
    home = along(over(0.0, -0.6, -0.5), needle.entry, 1.6 * MM)
    plan = [
        (1.6, home, 0),
        (3.6, over(-0.2, -0.7, -0.25), 0),
        (4.4, over(-0.2, -0.7, 0.3), 0),
        (6.6, None, 0),
        (7.4, over(0.2, -0.4, 0.3), 0),
        (7.6, None, 0),
        (8.0, over(0.4, -1.5, -0.3), 0),
    ]
    for x, depth, begin in ((0.4, 0.45, 8.0), (0.4, 0.9, 9.75), (1.3, 0.45, 11.5), (1.3, 0.9, 13.25)):
        plan += [
            (begin + 0.32, over(x, -1.5, -0.1), ASPIRATION),
            (begin + 0.64, over(x, -1.4, depth), both),
            (begin + 1.60, over(x, 0.8, depth), both),
            (begin + 1.752, over(x, 0.7, depth - 0.6), ASPIRATION),
        ]
    return plan + [
        (15.3, over(1.3, 0.6, -0.4), 0),
        (16.4, above_chopper(0.25), 0),
        (16.8, None, 0),
        (17.2, above_chopper(-0.15), 0),
        (17.4, None, 0),
        (17.8, above_chopper(0.25), 0),
        (18.4, None, 0),
        (19.7, home, 0),
        (DURATION, None, 0),
    ]


def hold():
    def over(degrees, depth):
        angle = math.radians(degrees)
        return over_lens(CHOPPER_TIP, 2.2 * math.cos(angle), 2.2 * math.sin(angle), depth)

    home = along(over(175, -0.5), chopper.entry, 1.6 * MM)
    return [
        (0.4, home, 0),
        (1.8, over(175, -0.25), 0),
        (2.6, over(175, 0.35), 0),
        (5.2, None, 0),
        (6.4, over(181, 0.35), 0),  # turns the lens by 0.23 mm towards the surgeon
        (7.6, None, 0),
        (14.4, over(181, 0.5), 0),  # a slow push
        (15.0, None, 0),
        (15.4, over(181, -0.35), 0),
        (16.6, MEETING, 0),
        (17.9, None, 0),
        (18.9, along(MEETING, chopper.entry, 2.0 * MM), 0),  # out from under the needle, along its own axis
        (19.7, home, 0),
        (DURATION, None, 0),
    ]


if __name__ == "__main__":
    needle.write(sculpt())
    chopper.write(hold())
