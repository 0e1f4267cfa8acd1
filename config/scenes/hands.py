"""Recordings of two hands in an eye, for make_trajectories.py of the scenes two_hands and phaco.

Tips move in minimum-jerk segments of the scene's frame, with the tremor of a supported hand. Each shaft passes
through the middle of its port (two_hands/cornea.geo), which fixes the orientation. The result is taken back through
the scene's mappings.
"""
import math
import random

RATE = 125  # samples per second
MM = 1e-3
POSITION_SCALE = 0.08
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


def along(a, b, distance):
    length = math.dist(a, b)
    return tuple(p + distance / length * (q - p) for p, q in zip(a, b))


class Hand:
    """`tool` is the scene's mapping.tool; the frames are identities. The shaft passes through `entry`."""

    def __init__(self, file, entry, origin, tool, seed):
        self.file, self.entry, self.origin, self.tool = file, entry, origin, tool
        pick = random.Random(seed)
        amplitude = TREMOR * math.sqrt(2 / 3 / TREMOR_WAVES)
        self.waves = [[(amplitude, pick.uniform(*TREMOR_BAND), pick.uniform(0, 2 * math.pi))
                       for _ in range(TREMOR_WAVES)] for _ in range(3)]

    def tremor(self, t):
        return [sum(a * math.sin(2 * math.pi * f * t + p) for a, f, p in axis) for axis in self.waves]

    def write(self, plan):
        """plan: (time at its end [s], place or None to stay, pedals), from the first place at 0 s."""
        rows, begin, place = [], 0.0, plan[0][1]
        for end, target, pedals in plan:
            target = target or place
            first, last = round(begin * RATE), round(end * RATE)
            for i in range(first, last):
                s = minimum_jerk((i - first) / (last - first))
                rows.append((i / RATE, [a + s * (b - a) for a, b in zip(place, target)], pedals))
            begin, place = end, target
        rows.append((begin, list(place), 0))
        with open(self.file, "w", encoding="ascii") as out:
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


INCISION, SIDE_PORT = port(4.2 * MM, -90), port(4.6 * MM, -165)


def needle(file, seed=1):
    return Hand(file, INCISION, (0.0, 2.2 * MM, 1.2 * MM), (0, 0, 0, 1), seed)


def chopper(file, seed=2):
    return Hand(file, SIDE_PORT, (-1.4 * MM, -0.2 * MM, 2.0 * MM), turned_tool(-75, 30), seed)
