#!/usr/bin/python3
"""Draws the time of a simulation step over the mesh's nodes, for each model and compliance, and its parts.

Reads the JSON of `haptic chart step` and writes one picture: a column per model; rows: the step's median with its
99th percentile above, and the parts of `zone` with their fitted exponents.
Example: tools/plot/plot_chart_step.py step.json step.png
"""
import sys

from plot_style import ACCENT, GREY, INK, plt, run

METHODS = {
    "zone": dict(color=ACCENT, lw=2.2, zorder=5),
    "exact": dict(color=INK, lw=1.8, zorder=4),
    "updown": dict(color=INK, lw=1.3, ls=(0, (5, 2))),
    "lazy": dict(color=GREY, lw=2.0),
}
PARTS = {
    "free_motion": dict(color=ACCENT, lw=2.2, label="free motion"),
    "assembly": dict(color=INK, lw=1.8, label="assembly"),
    "factor": dict(color=INK, lw=1.3, ls=(0, (5, 2)), label="factor"),
    "condense": dict(color=INK, lw=1.3, ls=(0, (1, 1.5)), label="condense"),
    "collision": dict(color=GREY, lw=1.8, label="collision"),
    "solve": dict(color=GREY, lw=1.3, ls=(0, (5, 2)), label="solve"),
    "publish": dict(color=GREY, lw=1.3, ls=(0, (1, 1.5)), label="publish"),
}
LEAST = 1e-2


def exponent(data, model, compliance, part=None):
    for growth in data.get("growth", []):
        if (growth["model"], growth["compliance"]) == (model, compliance):
            e = growth["step"] if part is None else growth["parts"][part]
            return "" if e is None else f", $n^{{{e:.2f}}}$"
    return ""


def logarithmic(axes, sizes):
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(True, which="major")
    axes.set_xticks(sizes, [str(n) for n in sizes])
    axes.minorticks_off()


def draw(data, path):
    points = sorted(data.get("points", []), key=lambda p: p["nodes"])
    if not points:
        sys.exit("no points to draw")
    models = [m for m in ("corotational", "linear") if any(p["model"] == m for p in points)]
    sizes = sorted({p["nodes"] for p in points})
    figure, grid = plt.subplots(2, len(models), figsize=(1.0 + 6.4 * len(models), 8.6), squeeze=False, sharex=True,
                                sharey="row")
    for column, model in enumerate(models):
        axes = grid[0][column]
        for method, line in METHODS.items():
            own = [p for p in points if (p["model"], p["compliance"]) == (model, method)]
            if not own:
                continue
            nodes = [p["nodes"] for p in own]
            axes.plot(nodes, [p["step_ms_median"] for p in own], marker="o", ms=4,
                      label=method + exponent(data, model, method), **line)
            axes.plot(nodes, [p["step_ms_p99"] for p in own], ls="", marker="_", ms=9, color=line["color"])
        axes.axhline(20, color=GREY, lw=1, ls=(0, (2, 3)))
        axes.annotate("50 Hz", (sizes[0], 20), textcoords="offset points", xytext=(0, 3), fontsize=9, color=INK)
        axes.set_title(f"{model}: the step, median (dash: p99)", loc="left", fontsize=10.5)
        logarithmic(axes, sizes)
        axes.legend(fontsize=9, loc="upper left", bbox_to_anchor=(1.0, 1.0))

        axes = grid[1][column]
        own = [p for p in points if (p["model"], p["compliance"]) == (model, "zone")]
        for part, line in PARTS.items():
            style = {k: v for k, v in line.items() if k != "label"}
            if own:
                axes.plot([p["nodes"] for p in own], [max(p["parts_ms"][part], LEAST) for p in own], marker="o", ms=3,
                          label=line["label"] + exponent(data, model, "zone", part), **style)
        axes.set_title(f"{model}: parts of zone, means", loc="left", fontsize=10.5)
        axes.set_xlabel("nodes")
        logarithmic(axes, sizes)
        if own:
            axes.legend(fontsize=9, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    grid[0][0].set_ylabel("time of a step [ms]")
    grid[1][0].set_ylabel("time of a part [ms]")
    figure.set_layout_engine("constrained")
    figure.savefig(path)
    plt.close(figure)


if __name__ == "__main__":
    run(__doc__, draw, "JSON of `haptic chart step`")
