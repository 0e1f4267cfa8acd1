#!/usr/bin/python3
"""Draws the error of C_pp without warping and with two kinds of it, a panel per shape.

Reads the JSON of `haptic chart warping` and writes one picture.
Example: tools/plot/plot_chart_warping.py warping.json warping.png
"""
import sys

from plot_style import ACCENT, INK, plt, run

STYLES = {
    ("zone", "none"): dict(color=ACCENT, lw=1.3, ls=(0, (1, 1.5)), label="zone, not warped"),
    ("zone", "node"): dict(color=ACCENT, lw=1.3, ls=(0, (5, 2)), label="zone, warped by node"),
    ("zone", "piece"): dict(color=ACCENT, lw=2.2, label="zone, warped by piece"),
    ("lazy", "none"): dict(color=INK, lw=1.3, ls=(0, (1, 1.5)), label="lazy, not warped"),
    ("lazy", "node"): dict(color=INK, lw=1.3, ls=(0, (5, 2)), label="lazy, warped by node: the paper"),
    ("lazy", "piece"): dict(color=INK, lw=1.8, label="lazy, warped by piece"),
}
FLOOR = 1e-3
AXES = {"indentation": "depth at the pole [mm]", "bending": "arc, edge to edge [degrees]",
        "cantilever": "arc, edge to edge [degrees]", "turning": "rigid turn [degrees]"}


def draw(data, path):
    points = data.get("points", [])
    if not points:
        sys.exit("no points to draw")
    figure, grid = plt.subplots(1, 4, figsize=(13, 4.1), sharey=True)
    for axes, (shape, label) in zip(grid, AXES.items()):
        for (method, warping), line in STYLES.items():
            own = [p for p in points if (p["shape"], p["method"], p["warping"]) == (shape, method, warping)]
            axes.plot([p["amount"] for p in own], [max(p["w_rel_error"], FLOOR) for p in own], marker="o", ms=3, **line)
        axes.set_yscale("log")
        axes.set_ylim(FLOOR, 1.3)
        smallest = [p["w_rel_error"] for p in points if p["shape"] == shape and p["w_rel_error"] < FLOOR]
        if smallest:
            axes.annotate(f"warped, either way: below {max(smallest):.0e}", (0.04, 0.035), xycoords="axes fraction",
                          fontsize=9)
        axes.set_title(shape, loc="left", fontsize=10.5)
        axes.set_xlabel(label)
    grid[0].set_ylabel("error of $C_{pp}$ [relative]")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="upper left", ncol=3, fontsize=9)
    figure.set_layout_engine("constrained", rect=(0, 0, 1, 0.88))
    figure.savefig(path)
    plt.close(figure)


if __name__ == "__main__":
    run(__doc__, draw, "JSON of `haptic chart warping`")
