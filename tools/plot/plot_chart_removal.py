#!/usr/bin/python3
"""Draws the paper's Fig. 4 for every method: cost, error and memory over the elements removed, or the cuts.

Reads the JSON of `haptic chart removal` and writes one picture: a column per mesh; rows: update and condense
of one removal or cut, error of C_pp, memory.
Example: tools/plot/plot_chart_removal.py removal.json removal.png
"""
import sys

from plot_style import ACCENT, GREY, INK, plt, run

# One accent, for the method this project is about; the others by grey and dash.
STYLES = {
    "zone": dict(color=ACCENT, lw=2.2, zorder=5),
    "exact": dict(color=INK, lw=1.8, zorder=4),
    "updown": dict(color=INK, lw=1.3, ls=(0, (5, 2))),
    "updown_metis": dict(color=INK, lw=1.3, ls=(0, (1, 1.5))),
    "lazy": dict(color=GREY, lw=2.2),
    "lazy_rebased": dict(color=GREY, lw=1.3, ls=(0, (5, 2))),
    "dense": dict(color=GREY, lw=1.3, ls=(0, (1, 1.5))),
}
NAMES = {
    "zone": "zone", "exact": "exact", "updown": "updown, zone last", "updown_metis": "updown, METIS order",
    "lazy": "lazy: the paper", "lazy_rebased": "lazy, new base every 64", "dense": "dense, full update",
}


def rows_of(data):
    """{nodes: {method: [points]}}, both in the order of the file."""
    sizes = {}
    for point in data.get("points", []):
        key = point["method"] + ("_metis" if point["order"] == "metis" else "")
        sizes.setdefault(point["nodes"], {}).setdefault(key, []).append(point)
    return sizes


def mark_crossings(axes, data, nodes, methods):
    for crossing in data.get("crossings", []):
        at = crossing["lazy_dearer_after"]
        if crossing["nodes"] != nodes or crossing["method"] not in methods or at <= 0:
            continue
        points = methods[crossing["method"]]
        nearest = min(points, key=lambda p: abs(p["removed"] - at))
        cost = nearest["step_us_median"] / 1e3
        axes.plot([at], [cost], "o", ms=5, mfc="white", mec=STYLES[crossing["method"]]["color"], zorder=6)
        axes.annotate(f"{at:.0f}", (at, cost), textcoords="offset points", xytext=(5, -11), fontsize=8.5)


def draw(data, path):
    sizes = rows_of(data)
    if not sizes:
        sys.exit("no points to draw")
    figure, grid = plt.subplots(3, len(sizes), figsize=(1.0 + 4.2 * len(sizes), 8.2), squeeze=False,
                                sharex="col", sharey="row",
                                gridspec_kw={"height_ratios": [2.2, 1, 1]})
    cuts = data.get("what") == "cuts"
    rows = (
        (("time per cut" if cuts else "time per removal") + ":\nupdate and condense [ms]", lambda p: p["step_us_median"] / 1e3),
        ("error of $C_{pp}$ [relative]", lambda p: max(p["w_rel_error"], 1e-17)),
        ("memory [MB]", lambda p: p["memory_mb"]),
    )
    seen = {}
    for column, (nodes, methods) in enumerate(sizes.items()):
        tets = next(iter(methods.values()))[0]["tets"]
        grid[0][column].set_title(f"{nodes} nodes, {tets} tetrahedra", fontsize=10.5, color=INK, loc="left")
        for row, (label, value) in enumerate(rows):
            axes = grid[row][column]
            for key, points in methods.items():
                line, = axes.plot([p["removed"] for p in points], [value(p) for p in points],
                                  **STYLES.get(key, {"color": GREY}))
                seen.setdefault(key, line)
            axes.set_yscale("log")
            axes.grid(True, which="major")
            if column == 0:
                axes.set_ylabel(label)
        mark_crossings(grid[0][column], data, nodes, methods)
        grid[2][column].set_xlabel("cuts" if cuts else "elements removed")
        grid[2][column].set_xlim(left=0)
    keys = [k for k in STYLES if k in seen]
    per_line = 4 if len(sizes) > 1 else 2
    lines = -(-len(keys) // per_line)
    figure.legend([seen[k] for k in keys], [NAMES[k] for k in keys], loc="upper left", ncol=per_line, fontsize=9)
    figure.set_layout_engine("constrained", rect=(0, 0, 1, 1 - 0.02 - 0.027 * lines))
    figure.savefig(path)
    plt.close(figure)


if __name__ == "__main__":
    run(__doc__, draw, "JSON of `haptic chart removal`")
