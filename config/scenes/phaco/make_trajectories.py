#!/usr/bin/python3
"""Writes phaco.csv and chopper.csv: both hands of the scene phaco, on one time axis.

  sculpt   a groove along y, half as wide again as the tip but at its bottom, then one along x, each deeper pass by
           pass; walls are bevelled for what leans over them: the left one for the chopper, near ones for the shaft
  crack    tip and chopper push the walls of a groove apart, at four places of each
  remove   row by row from front to back, until little is left; the chopper waits outside

How hands move: ../hands.py. Places in mm, in the scene's frame.
"""
import math
import pathlib
import sys

FOLDER = pathlib.Path(__file__).parent
sys.path.insert(0, str(FOLDER.parent))
sys.dont_write_bytecode = True
import hands
from hands import ASPIRATION, MM, PHACO

BOTH = PHACO | ASPIRATION
TIP, STROKE = 0.5, 0.1  # mm
FRONT_POLE, FRONT_RADIUS = 1.225, 7.0  # ../cataract/profile.geo, shrunk to 0.7
BACK_POLE, BACK_RADIUS = -1.715, 4.2
FLOOR = 0.3  # of the nucleus, left to crack [mm]


def front(x, y):
    return FRONT_POLE - FRONT_RADIUS + math.sqrt(FRONT_RADIUS**2 - x * x - y * y)


def back(x, y):
    return BACK_POLE + BACK_RADIUS - math.sqrt(BACK_RADIUS**2 - x * x - y * y)


class Plan:
    """Of one hand: segments at a speed [mm/s], and waiting for the other."""

    def __init__(self, start):
        self.time, self.place, self.segments = 0.0, start, []
        self.go(start, 1.0)

    def go(self, place, speed=8.0, pedals=0):
        distance = math.dist(self.place, place)
        self.time += max(0.08, round(distance / speed * hands.RATE) / hands.RATE)
        self.place = place
        self.segments.append((self.time, tuple(a * MM for a in place), pedals))

    def stay(self, until):
        if until > self.time + 0.5 / hands.RATE:
            self.time = round(until * hands.RATE) / hands.RATE
            self.segments.append((self.time, None, 0))


def wait(*plans):
    end = max(plan.time for plan in plans)
    for plan in plans:
        plan.stay(end)


def pass_through(plan, line, depth, floor, speed):
    """Along points (x, y), the ball's bottom so deep under the front, and `floor` above the back."""
    def place(x, y):
        return (x, y, max(front(x, y) - depth, back(x, y) + floor) + TIP + STROKE)

    above = tuple(a + b for a, b in zip(place(*line[0]), (0, -0.4, 0.8 + depth)))
    plan.go(above)
    plan.go(place(*line[0]), 4.0, BOTH)
    for point in line[1:]:
        plan.go(place(*point), speed, BOTH)
    plan.go(tuple(a + b for a, b in zip(plan.place, (0, -0.6, 0.6 + depth))), 8.0, ASPIRATION)


def line(a, b, n=6):
    return [tuple(p + i / n * (q - p) for p, q in zip(a, b)) for i in range(n + 1)]


def sculpt(plan):
    for depth, places in ((0.7, (-0.25, 0.25, -0.9)), (1.3, (-0.25, 0.25)), (1.9, (-0.25, 0.25)), (2.5, (0.0,))):
        half = 2.8 - 0.2 * depth
        for x in places:
            pass_through(plan, line((x, -half), (x, half)), depth, FLOOR, 3.2)


def sculpt_across(plan):
    for depth in (0.8, 1.5, 2.2):
        half = 2.8 - 0.2 * depth
        for side in (-1, 1):
            for back_off in (1.4, 0.7, 0.0):
                if depth > back_off:
                    y = -back_off
                    pass_through(plan, line((side * half, y), (0, y), 4), depth - back_off, FLOOR, 3.6)


def push_apart(plan, other, a, b, way, by, speed=2.0):
    """From places a and b, the one along `way` and the other against it, and back."""
    plan.go((a[0], a[1] - 0.5, a[2] + 1.8))
    other.go((b[0] - 0.6, b[1], b[2] + 1.8))
    plan.go(a, 4.0)
    other.go(b, 4.0)
    wait(plan, other)
    plan.go(tuple(p + by * w for p, w in zip(a, way)), speed)
    other.go(tuple(p - by * w for p, w in zip(b, way)), speed)
    wait(plan, other)
    plan.stay(plan.time + 0.25)
    other.stay(other.time + 0.25)
    plan.go(a, 3.0)
    other.go(b, 3.0)
    plan.go((a[0], a[1] - 0.5, a[2] + 1.8), 8.0)
    other.go((b[0] - 0.6, b[1], b[2] + 1.8), 8.0)


def crack(plan, other):
    for y in (1.1, 0.45, -0.3, -1.2):
        floor = back(0, y) + FLOOR
        push_apart(plan, other, (0.4, y, floor + TIP + STROKE + 0.3), (-0.5, y + 0.1, floor + 0.7), (1, 0, 0), 1.3)


def crack_across(plan, other):
    for x in (1.7, 0.9, -0.9, -1.7):
        floor = back(x, 0) + FLOOR
        push_apart(plan, other, (x, -0.45, floor + TIP + STROKE), (x, 0.45, floor + 0.35), (0, -1, 0), 1.5)


def remove(plan):
    for z in (0.75, 0.2, -0.35, -0.85):
        turn = 1
        for k in range(7):
            y = 2.3 - 0.75 * k
            reach = 2.9**2 - y * y - (z - 0.1) ** 2
            if reach < 0.3:
                continue
            x = math.sqrt(reach)
            low = max(z, back(min(x, 2.0), y) + 0.35 + TIP)
            plan.go((-turn * x, y, max(z, low)), 6.0, BOTH)
            for u in (-0.5, 0.0, 0.5, 1.0):
                at = turn * x * u
                plan.go((at, y, max(z, back(at, y) + 0.25 + TIP)), 4.0, BOTH)
            turn = -turn
        plan.go((0.0, -1.2, 2.2), 8.0, ASPIRATION)


def main():
    phaco, chopper = hands.needle(FOLDER / "phaco.csv"), hands.chopper(FOLDER / "chopper.csv")
    right, left = Plan((0.0, -1.8, 3.0)), Plan((-3.6, -0.95, 3.55))
    stages = []
    sculpt(right)
    wait(right, left)
    stages.append(("sculpted along", right.time))
    crack(right, left)
    stages.append(("in halves", right.time))
    left.go((-3.6, -0.95, 3.55))
    sculpt_across(right)
    wait(right, left)
    stages.append(("sculpted across", right.time))
    crack_across(right, left)
    stages.append(("in quarters", right.time))
    left.go((-3.6, -0.95, 3.55))
    remove(right)
    right.go((0.0, -1.8, 3.0))
    wait(right, left)
    phaco.write(right.segments)
    chopper.write(left.segments)
    stages.append(("removed", right.time))
    print("\n".join(f"{end:6.1f} s  {what}" for what, end in stages))


if __name__ == "__main__":
    main()
