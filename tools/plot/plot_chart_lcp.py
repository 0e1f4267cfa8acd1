#!/usr/bin/python3
"""Draws time against residual of the contact solvers: a column per size, warm above cold.

Reads the JSON of `haptic chart lcp`. A mark is one case: its 99th percentile of time and its largest residual,
a tail from the median of time. Filled: friction; the frictionless solvers have columns of their own.
Example: tools/plot/plot_chart_lcp.py lcp.json lcp.png
"""
import sys

from plot_style import ACCENT, GREY, INK, plt, run

STYLES = {
    "pivoting": dict(color=ACCENT, marker="o"),
    "hybrid": dict(color=ACCENT, marker="o"),
    "hybrid_400us": dict(color=ACCENT, marker="o", mfc="white"),
    "hybrid_1e-10": dict(color=ACCENT, marker="."),
    "block_gauss_seidel": dict(color=INK, marker="s", mfc="white"),
    "pgs": dict(color=GREY, marker="X"),
}
NAMES = {
    "pivoting": "pivoting (frictionless)", "hybrid": "hybrid, to 1e-6", "hybrid_400us": "hybrid, within 400 µs",
    "hybrid_1e-10": "hybrid, to 1e-10", "block_gauss_seidel": "block Gauss-Seidel, within 400 µs",
    "pgs": "projected Gauss-Seidel, within 400 µs",
}
FLOOR = 1e-17


def draw(data, path):
    points = data.get("points", [])
    if not points:
        sys.exit("no points to draw")
    sizes = sorted({(p["friction"], p["contacts"]) for p in points})
    figure, grid = plt.subplots(2, len(sizes), figsize=(1.2 + 2.7 * len(sizes), 7.2), squeeze=False,
                                sharex=True, sharey=True)
    seen = {}
    for column, (friction, contacts) in enumerate(sizes):
        name = f"{contacts} contacts, friction" if friction else f"{contacts} rows, frictionless"
        grid[0][column].set_title(name, fontsize=10.5, color=INK, loc="left")
        for row, warm in enumerate((True, False)):
            axes = grid[row][column]
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.axvline(1000, color=GREY, lw=0.8, ls=(0, (4, 3)))
            for p in points:
                if (p["friction"], p["contacts"], p["warm"]) != (friction, contacts, warm):
                    continue
                look = STYLES.get(p["solver"], dict(color=GREY, marker="."))
                residual = max(p["residual_max"], FLOOR)
                axes.plot([p["us_median"], p["us_p99"]], [residual] * 2, color=look["color"], lw=0.8, alpha=0.35)
                mark, = axes.plot([p["us_p99"]], [residual], ls="none", ms=6, alpha=0.85, **look)
                seen.setdefault(p["solver"], mark)
            if column == 0:
                axes.set_ylabel(("warm" if warm else "cold") + ": largest residual")
            if row == 1:
                axes.set_xlabel("µs, p99 (tail: median)")
    keys = [k for k in STYLES if k in seen]
    figure.legend([seen[k] for k in keys], [NAMES[k] for k in keys], loc="upper left", ncol=3, fontsize=9)
    figure.set_layout_engine("constrained", rect=(0, 0, 1, 0.92))
    figure.savefig(path)
    plt.close(figure)


if __name__ == "__main__":
    run(__doc__, draw, "JSON of `haptic chart lcp`")
