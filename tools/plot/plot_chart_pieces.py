#!/usr/bin/python3
"""Draws solvers of the joint contact problem, the haptic loop's error, and bodies in contact against theory.

Reads the JSON of `haptic chart pieces`; a part that was not measured has no panel. Solvers: the median of time
against touches and against residual, a tail to the 99th percentile; a hollow mark missed the residual that a step
asks in some problem. Example: tools/plot/plot_chart_pieces.py pieces.json pieces.png
"""
import sys

from plot_style import ACCENT, GREY, INK, plt, run

SOLVERS = {
    "ours": ("this project's, to its tolerance", dict(color=ACCENT, marker="o")),
    "sap": ("convex Newton (SAP), R of 5e-7", dict(color=INK, marker="s")),
    "sap_soft": ("convex Newton (SAP), R of 1/(4π²)", dict(color="#7a9a01", marker="D")),
    "pgs": ("projected Gauss-Seidel", dict(color=GREY, marker="X")),
}
ASKED = 1e-6
FLOOR = 1e-14


def looks(point):
    return dict(SOLVERS[point["name"]][1], mfc="none" if point["failures"] else None)


def touches(axes, points, friction):
    for name in SOLVERS:
        for scene in sorted({p["scene"] for p in points}):
            own = sorted((p for p in points if (p["name"], p["scene"], p["friction"]) == (name, scene, friction)),
                         key=lambda p: p["touches"])
            if not own:
                continue
            style = SOLVERS[name][1]
            axes.plot([p["touches"] for p in own], [p["us_p50"] for p in own], lw=1, alpha=0.6, color=style["color"])
            for p in own:
                axes.plot([p["touches"]] * 2, [p["us_p50"], p["us_p99"]], lw=0.8, alpha=0.35, color=style["color"])
                axes.plot(p["touches"], p["us_p50"], ms=5, ls="none", **looks(p))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("touches")
    axes.set_ylabel("µs, median")
    axes.set_title("with friction" if friction else "without friction", loc="left", fontsize=10.5)


def residuals(axes, points, friction):
    for p in points:
        if p["friction"] != friction:
            continue
        y = [max(p["residual_p50"], FLOOR), max(p["residual_max"], FLOOR)]
        axes.plot(y, [p["us_p50"]] * 2, lw=0.8, alpha=0.35, color=SOLVERS[p["name"]][1]["color"])
        axes.plot(y[1], p["us_p50"], ls="none", ms=3 + 2.2 * (p["touches"] / 100) ** 0.5, alpha=0.85, **looks(p))
    axes.axvline(ASKED, color=GREY, lw=0.9, ls=(0, (2, 2)))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("largest residual (tail: median)")
    axes.set_ylabel("µs, median")
    axes.set_title("… the larger, the more touches", loc="left", fontsize=10.5)


def pushes(axes, points):
    names = list(dict.fromkeys(p["scene"] for p in points))
    for i, name in enumerate(names):
        own = [p for p in points if p["scene"] == name and p["holds"]]
        axes.plot([100 * max(p["rms_rel"], 1e-5) for p in own], [i] * len(own), ls="none", marker="o", ms=5,
                  color=INK, mfc="white")
        deeper = [p for p in own if p["direction"] == "deeper"]
        axes.plot([100 * max(p["rms_rel"], 1e-5) for p in deeper], [i] * len(deeper), ls="none", marker="o", ms=6,
                  color=ACCENT)
    axes.axvline(3, color=GREY, lw=0.9, ls=(0, (2, 2)))
    axes.set_xscale("log")
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel("force off, % RMS of the push's own peak (filled: deeper)")
    axes.set_title("pushed by 0.4 mm in a step: haptic loop", loc="left", fontsize=10.5)


def theory(axes, checks):
    kinds = list(dict.fromkeys(c["name"].split(",")[0].split(":")[0] for c in checks))
    for c in checks:
        row = kinds.index(c["name"].split(",")[0].split(":")[0])
        share = min(max(c["rel_error"] / c["asked"], 1e-9), 1e3)
        axes.plot(share, row, ls="none", marker="o", ms=5, color=INK if c["passed"] else ACCENT,
                  mfc="white" if c["passed"] else ACCENT)
    axes.axvline(1, color=GREY, lw=0.9, ls=(0, (2, 2)))
    axes.set_xscale("log")
    axes.set_yticks(range(len(kinds)), kinds, fontsize=8)
    axes.set_ylim(len(kinds) - 0.5, -0.5)
    axes.set_xlabel("error over what is asked (cut at 1e-9 and 1000)")
    axes.set_title("against theory", loc="left", fontsize=10.5)


def draw(data, path):
    solvers, haptic, checks = data.get("solvers", []), data.get("haptic", []), data.get("theory", [])
    panels = [lambda a, f=friction, part=part: part(a, solvers, f) for friction in (True, False)
              for part in (touches, residuals) if any(p["friction"] == friction for p in solvers)]
    panels += [lambda a: pushes(a, haptic)] if haptic else []
    panels += [lambda a: theory(a, checks)] if checks else []
    if not panels:
        sys.exit("nothing to draw")
    rows, head = (len(panels) + 1) // 2, 0.6 if solvers else 0.1
    figure = plt.figure(figsize=(11, head + 3.5 * rows), layout="constrained")
    bands = figure.subfigures(rows + 1, 1, height_ratios=[head] + [3.5] * rows)
    for row, band in enumerate(bands[1:]):
        own = panels[2 * row:2 * row + 2]
        for axes, panel in zip(band.subplots(1, 2, squeeze=False)[0][:len(own)], own):
            panel(axes)
    if solvers:
        marks = [plt.Line2D([], [], ls="none", **style) for _, style in SOLVERS.values()]
        bands[0].legend(marks, [name for name, _ in SOLVERS.values()], loc="upper left", ncol=2, fontsize=9)
    figure.savefig(path)
    plt.close(figure)


if __name__ == "__main__":
    run(__doc__, draw, "JSON of `haptic chart pieces`")
