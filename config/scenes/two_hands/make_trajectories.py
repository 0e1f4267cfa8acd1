#!/usr/bin/python3
"""Writes sculpt.csv and hold.csv: the two styluses of the scene two_hands, each in its device's frame.

Both have one time axis of twenty seconds. The chopper enters, presses the left periphery of the lens and holds. The
needle presses near the middle. The chopper turns the lens a little, and goes on pushing while the needle sculpts two
grooves on the right. Then the chopper comes below the needle, whose shaft touches it once, and both leave.

two_hands.yaml names the windows in which forces can be compared. Tips move in minimum-jerk segments of the scene's
frame, with the tremor of a supported hand. Each shaft passes through the middle of its port (cornea.geo), which
fixes the orientation. The result is taken back through the scene's mappings.
"""
import math
import pathlib
import random

RATE, DURATION = 125, 20.0  # samples per second, s
MM = 1e-3
POSITION_SCALE = 0.08
ANTERIOR_POLE, ANTERIOR_RADIUS = 1.75 * MM, 10.0 * MM  # ../cataract/profile.geo
PHACO, ASPIRATION = 1, 2

# At the stylus, RMS of the three axes together. Riviere, Rader and Khosla, "Characteristics of hand motion of eye
# surgeons" (1997), measured 49 um for surgeons who hold an instrument still. Their figure includes slow drift; here
# all of it is tremor, in the 6 to 12 Hz where a surgeon's tremor has its peak.
TREMOR, TREMOR_BAND, TREMOR_WAVES = 50e-6, (6.0, 12.0), 6


def port(radius, degrees):
    """On the cornea's middle surface (cornea.geo)."""
    angle = math.radians(degrees)
    z = (5.35 - 7.25) * MM + math.sqrt((7.525 * MM) ** 2 - radius**2)
    return (radius * math.cos(angle), radius * math.sin(angle), z)


def over_lens(tip_radius, x, y, depth):
    """Centre of a ball that reaches `depth` below the lens's surface at rest, along the normal there [mm]."""
    x, y = x * MM, y * MM
    z = math.sqrt(ANTERIOR_RADIUS**2 - x * x - y * y)
    grown = 1 + (tip_radius - depth * MM) / ANTERIOR_RADIUS
    return (x * grown, y * grown, ANTERIOR_POLE - ANTERIOR_RADIUS + z * grown)


def along(a, b, distance):
    length = math.dist(a, b)
    return tuple(p + distance / length * (q - p) for p, q in zip(a, b))


class Hand:
    """`tool` is the scene's mapping.tool; the frames are identities."""

    def __init__(self, file, tip_radius, entry, origin, tool, seed):
        self.file, self.tip_radius, self.entry, self.origin, self.tool = file, tip_radius, entry, origin, tool
        pick = random.Random(seed)
        amplitude = TREMOR * math.sqrt(2 / 3 / TREMOR_WAVES)
        self.waves = [[(amplitude, pick.uniform(*TREMOR_BAND), pick.uniform(0, 2 * math.pi))
                       for _ in range(TREMOR_WAVES)] for _ in range(3)]

    def over(self, x, y, depth):
        return over_lens(self.tip_radius, x, y, depth)

    def tremor(self, t):
        return [sum(a * math.sin(2 * math.pi * f * t + p) for a, f, p in axis) for axis in self.waves]

    def write(self, plan):
        """plan: (time at its end [s], place or None to stay, pedals)."""
        rows, begin, place = [], 0.0, plan[0][1]
        for end, target, pedals in plan:
            target = target or place
            first, last = round(begin * RATE), round(end * RATE)
            for i in range(first, last):
                s = minimum_jerk((i - first) / (last - first))
                rows.append((i / RATE, [a + s * (b - a) for a, b in zip(place, target)], pedals))
            begin, place = end, target
        assert begin == DURATION
        rows.append((begin, list(place), 0))
        with open(pathlib.Path(__file__).parent / self.file, "w", encoding="ascii") as out:
            out.write("# Made by make_trajectories.py. Device frame; s, m. Buttons: 1 phaco, 2 aspiration.\n")
            out.write("t,px,py,pz,qx,qy,qz,qw,buttons\n")
            for t, tip, pedals in rows:
                p = [(a - o) / POSITION_SCALE + h for a, o, h in zip(tip, self.origin, self.tremor(t))]
                tip = [o + POSITION_SCALE * a for a, o in zip(p, self.origin)]
                q = times(orientation(tip, self.entry), inverse(self.tool))
                out.write(f"{t:.3f}," + ",".join(f"{v:.7f}" for v in (*p, *q)) + f",{pedals}\n")


def minimum_jerk(u):
    return u * u * u * (10 - 15 * u + 6 * u * u)


def orientation(tip, entry):
    """Quaternion x, y, z, w whose z axis is the shaft's direction and whose x axis stays level."""
    length = math.dist(tip, entry)
    z = [(b - a) / length for a, b in zip(tip, entry)]
    n = math.hypot(z[0], z[1])
    x = [-z[1] / n, z[0] / n, 0.0]
    y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]]
    # The trace is positive for shafts that point to the user or to the left, and up.
    w = 0.5 * math.sqrt(1.0 + x[0] + y[1] + z[2])
    return ((y[2] - z[1]) / (4 * w), (z[0] - x[2]) / (4 * w), (x[1] - y[0]) / (4 * w), w)


def times(a, b):
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz)


def inverse(q):
    return (-q[0], -q[1], -q[2], q[3])


def turned_tool(degrees, incline):
    """Turns an instrument about the scene's vertical, for a stylus whose tail rises by `incline` degrees."""
    half, slope = math.radians(degrees) / 2, math.radians(90 - incline)
    return (0.0, math.sin(half) * math.sin(slope), math.sin(half) * math.cos(slope), math.cos(half))


needle = Hand("sculpt.csv", 0.5 * MM, port(4.2 * MM, -90), (0.0, 2.2 * MM, 1.2 * MM), (0, 0, 0, 1), 1)
chopper = Hand("hold.csv", 0.3 * MM, port(4.6 * MM, -165), (-1.4 * MM, -0.2 * MM, 2.0 * MM),
               turned_tool(-75, 30), 2)

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
    over, both = needle.over, PHACO | ASPIRATION
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
        return chopper.over(2.2 * math.cos(angle), 2.2 * math.sin(angle), depth)

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
