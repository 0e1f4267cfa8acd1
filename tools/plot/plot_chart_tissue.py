#!/usr/bin/python3
"""Draws how the errors of `haptic chart tissue` fall with the size of elements, and how linear tetrahedra lock.

Reads the JSON of `haptic chart tissue` and writes one picture.
Example: tools/plot/plot_chart_tissue.py tissue.json tissue.png
"""
import argparse
import json
import sys

from plot_style import ACCENT, INK, plt, style

MARKS = "osD^vP*Xh<>"
REMEDIES = {"none": dict(color=INK, label="linear tetrahedra"),
            "lowered": dict(color=ACCENT, label="lowered ratio"),
            "patches": dict(color="#7a9a01", label="volume by patches of elements")}


def convergence(axes, series, title):
    colours = plt.get_cmap("tab10").colors
    for i, s in enumerate(series):
        size = [x / s["size"][0] for x in s["size"]]
        axes.plot(size, s["error"], marker=MARKS[i % len(MARKS)], ms=4, lw=1.4, color=colours[i % 10],
                  label=f"{s['name']}: {s['order']:.2f}")
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_title(title, loc="left", fontsize=10.5)
    axes.set_xlabel("size, the coarsest is 1")
    axes.set_ylabel("relative error")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.45)
    axes.legend(fontsize=8, loc="upper left")


def guide(axes, order, at):
    x = [0.25, 1]
    axes.plot(x, [at * v ** order for v in x], color="0.6", lw=1, ls=(0, (4, 3)))
    axes.annotate(f"slope {order}", (0.25, at * 0.25 ** order), fontsize=8, color="0.4", ha="right")


def locking(axes, points, problem):
    ratios = sorted({p["poisson"] for p in points})
    shades = {nu: w for nu, w in zip(ratios, (0.9, 1.4, 2.0, 2.6))}
    for remedy, line in REMEDIES.items():
        for nu in ratios:
            own = [p for p in points if (p["problem"], p["remedy"], p["poisson"]) == (problem, remedy, nu)]
            if own:
                axes.plot([p["size"] for p in own], [p["stiffness"] for p in own], marker="o", ms=3,
                          lw=shades[nu], color=line["color"], label=f"{line['label']}, {nu:g}")
    axes.axhline(1, color="0.6", lw=1)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title(f"{problem}: stiffness over the exact", loc="left", fontsize=10.5)
    axes.set_xlabel("element size over the load's or the wall's")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.5)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.set_xticks(sorted({p["size"] for p in points if p["problem"] == problem}))
    axes.xaxis.set_major_formatter("{x:.2g}")
    axes.xaxis.set_minor_formatter("")
    axes.legend(fontsize=8, loc="upper left", ncol=2)


def draw(data, path):
    series = data.get("series", [])
    points = data.get("locking", [])
    problems = sorted({p["problem"] for p in points})
    panels = 2 * bool(series) + len(problems)
    if panels == 0:
        sys.exit("nothing to draw")
    columns = min(panels, 2)  # more beside one another nobody can read
    rows = -(-panels // columns)
    figure, grid = plt.subplots(rows, columns, figsize=(5.4 * columns, 5.4 * rows), squeeze=False)
    for spare in grid.flat[panels:]:
        spare.set_visible(False)
    grid = list(grid.flat)
    if series:
        for order, title in ((2, "second order expected"), (1, "first order expected")):
            axes = grid.pop(0)
            own = [s for s in series if s["expected_order"] == order]
            convergence(axes, own, title)
            if own:
                guide(axes, order, min(s["error"][0] for s in own) * 0.6)
    for problem in problems:
        locking(grid.pop(0), points, problem)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", help="JSON of `haptic chart tissue`")
    parser.add_argument("picture", help="PNG to write")
    arguments = parser.parse_args()
    with open(arguments.data) as file:
        data = json.load(file)
    style()
    draw(data, arguments.picture)


if __name__ == "__main__":
    main()
