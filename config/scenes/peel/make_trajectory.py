#!/usr/bin/python3
"""Writes stroke.csv: a hook goes into the notch from the open end, lifts the flap, is drawn forward under it, halts,
and goes back out.

Minimum-jerk segments in the scene's frame; the file has the device's (position_scale and origin of peel.yaml).
"""
import os

RATE = 125  # samples per second
SCALE, ORIGIN = 0.25, (8e-3, 4e-3, 2.5e-3)

# (duration [s], x and height over the notch's plane at its end [mm])
SEGMENTS = [(1.0, 2.0, 0.0), (1.5, 2.5, 4.0), (5.0, 15.0, 4.0), (0.5, 15.0, 4.0), (1.5, 2.0, 3.0), (1.0, -6.0, 0.0),
            (0.3, -6.0, 0.0)]


def main():
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "stroke.csv")
    with open(path, "w", encoding="ascii") as out:
        out.write("# Made by make_trajectory.py. Device frame; s, m.\n")
        out.write("t,px,py,pz,qx,qy,qz,qw,buttons\n")

        def sample(t, x, z):
            place = (1e-3 * x, 4e-3, 2.5e-3 + 1e-3 * z)
            px, py, pz = ((p - o) / SCALE for p, o in zip(place, ORIGIN))
            out.write(f"{t:.3f},{px:.7f},{py:.7f},{pz:.7f},0,0,0,1,0\n")

        begin, at = 0.0, (-6.0, 0.0)
        for duration, *goal in SEGMENTS:
            n = round(duration * RATE)
            for i in range(n):
                u = i / n
                s = u * u * u * (10 - 15 * u + 6 * u * u)
                sample(begin + i / RATE, *(a + (b - a) * s for a, b in zip(at, goal)))
            begin, at = begin + n / RATE, goal
        sample(begin, *at)


if __name__ == "__main__":
    main()
