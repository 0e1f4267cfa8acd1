#!/usr/bin/python3
"""Writes held.csv: a needle goes down onto the settled fragment, draws it, lifts it, carries it and lets it fall.

Minimum-jerk segments in the scene's frame, taken back through held.yaml's mapping (origin, position_scale; frame and
tool are identities; the pivot turns the needle square to the fragment).
"""
import os

RATE = 125.0  # samples per second
MM = 1e-3
ORIGIN = (1.4 * MM, 1.4 * MM, 2.5 * MM)  # mapping.origin
POSITION_SCALE = 0.08  # mapping.position_scale
OVER = (0.6 * MM, 0.5 * MM)  # where the fragment has settled
TOP = -0.30 * MM  # the needle's end there, pressed on lightly

ASPIRATION = 2


def at(height, x=0.0):
    return (OVER[0] + x * MM, OVER[1], TOP + height * MM)


def segments():
    """(duration [s], place at its end, pedals)."""
    yield 0.6, None, 0  # the fragment settles
    yield 1.4, at(0.0), 0
    yield 1.0, None, ASPIRATION
    yield 1.5, at(1.5), ASPIRATION
    yield 1.0, None, ASPIRATION
    yield 1.0, at(1.5, -0.8), ASPIRATION
    yield 0.5, None, ASPIRATION
    yield 1.5, None, 0  # it falls


def minimum_jerk(u):
    return u * u * u * (10 - 15 * u + 6 * u * u)


def main():
    rows = []
    begin, place = 0.0, at(3.0)
    for duration, target, pedals in segments():
        target = place if target is None else target
        n = round(duration * RATE)
        for i in range(n):
            s = minimum_jerk(i / n)
            rows.append((begin + i / RATE, [a + s * (b - a) for a, b in zip(place, target)], pedals))
        begin, place = begin + n / RATE, target
    rows.append((begin, list(place), 0))

    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "held.csv")
    with open(path, "w", encoding="ascii") as out:
        out.write("# Made by make_trajectory.py. Device frame; s, m. Buttons: 2 aspiration.\n")
        out.write("t,px,py,pz,qx,qy,qz,qw,buttons\n")
        for t, tip, pedals in rows:
            p = ",".join(f"{(a - o) / POSITION_SCALE:.7f}" for a, o in zip(tip, ORIGIN))
            out.write(f"{t:.3f},{p},0,0,0,1,{pedals}\n")


if __name__ == "__main__":
    main()
