#!/usr/bin/python3
"""Draws speed against accuracy of the force: force_pareto.png, force_time.png, force_spectrum.png, force_hands.png.

Reads the JSON of `haptic chart force` and force_traces.json beside it; the second argument is the directory for the
pictures. A panel per trajectory and schedule of removals; of several hands, one for each hand's force over time,
and force_hands.png has each hand's own error.
Hollow marks: the reference has not converged.
Example: tools/plot/plot_chart_force.py build/chart/force/force.json build/chart/force
"""
import json
import pathlib
import sys

import numpy as np
from matplotlib.transforms import Bbox

from plot_style import ACCENT, GREY, INK, plt, run

FELT = 30  # Hz
BLUE = "#1d6fa5"
# Shown over time and as spectra, where they were charted.
SHOWN = {"held": dict(color=GREY, lw=1.0), "the paper's scheme": dict(color=BLUE, lw=1.0, ls=(0, (4, 2))),
         "each hand alone": dict(color=BLUE, lw=1.0, ls=(0, (4, 2)))}


def grid_of(count, width, height):
    columns = min(count, 2)
    rows = -(-count // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(width * columns, height * rows + 0.4), squeeze=False)
    for spare in axes.flat[count:]:
        spare.set_visible(False)
    return figure, list(axes.flat[:count])


def name_of(entry, several=False):
    removals = entry["removals"]
    if several:
        return entry["trajectory"] + (f", {entry['elements_removed']} elements removed" if removals else "")
    return entry["trajectory"] + (f", {removals} elements removed per 20 ms" if removals else "")


def panels_of(data, traces):
    """A trace with its run and its name: one a hand."""
    for trace in traces:
        entry = data["runs"][trace["run"]]
        hand = trace.get("hand")
        yield trace, entry, (f"{hand}, " if hand else "") + name_of(entry, bool(hand))


def mine(data, entry):
    return [p for p in data["points"] if (p["trajectory"], p["removals"]) == (entry["trajectory"], entry["removals"])]


def label_marks(axes, marks):
    """Names beside their marks, each moved until it covers neither mark nor name."""
    figure = axes.figure
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    middles = axes.transData.transform([(x, y) for x, y, *_ in marks]) if marks else []
    taken = [Bbox.from_bounds(x - 4, y - 4, 8, 8) for x, y in middles]
    for x, y, text, weight in sorted(marks, key=lambda m: (-m[3], m[1])):
        for dx, dy, side in ((7, 0, "left"), (-7, 0, "right"), (7, 9, "left"), (7, -9, "left"), (-7, 9, "right"),
                             (-7, -9, "right"), (7, 18, "left"), (7, -18, "left"), (-7, 18, "right"),
                             (-7, -18, "right"), (7, 27, "left"), (-7, -27, "right")):
            note = axes.annotate(text, (x, y), textcoords="offset points", xytext=(dx, dy), ha=side, va="center",
                                 fontsize=7.5, color=ACCENT if weight > 1 else INK,
                                 fontweight="bold" if weight > 1 else "normal", zorder=2.5,
                                 bbox={"boxstyle": "square,pad=0.1", "fc": axes.get_facecolor(), "ec": "none"})
            box = note.get_window_extent(renderer)
            inside = axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 + 70
            if inside and not any(box.overlaps(other) for other in taken):
                taken.append(box)
                break
            note.remove()


def draw_pareto(data, path):
    figure, panels = grid_of(len(data["runs"]), 7.2, 5.2)
    figure.set_layout_engine("constrained")
    todo = []
    for axes, entry in zip(panels, data["runs"]):
        several = any("hands" in p for p in mine(data, entry))
        points = [p for p in mine(data, entry) if p["force_rms_rel"] > 0]
        axes.set_title(name_of(entry, several) + ("" if entry["reference_converged"] else " – reference not converged"),
                       loc="left", fontsize=10)
        if not points:  # a logarithmic axis has no place for none
            axes.annotate("no configuration has an error", (0.5, 0.5), xycoords="axes fraction", ha="center", color=INK)
            continue
        front = sorted((p for p in points if p["pareto"]), key=lambda p: p["cpu_ms_per_s"])
        if front:
            xs, ys = [p["cpu_ms_per_s"] for p in front], [100 * p["force_rms_rel"] for p in front]
            axes.step(xs + [4 * max(p["cpu_ms_per_s"] for p in points)], ys + [ys[-1]], where="post", color=GREY,
                      lw=1.2, zorder=1)
        for p in points:
            chosen = p["label"] == data["default"]
            color = ACCENT if chosen else INK if p["pareto"] else GREY
            axes.plot(p["cpu_ms_per_s"], 100 * p["force_rms_rel"], marker="*" if chosen else "o",
                      ms=15 if chosen else 5.5, color=color, mfc=color if p["reference_converged"] else "white",
                      zorder=4 if chosen else 3, ls="none")
        axes.set(xscale="log", yscale="log", xlabel="CPU time of all threads [ms per second of scene]",
                 ylabel="RMS force error [% of the reference's peak" + (", worse hand]" if several else "]"))
        low, high = min(p["cpu_ms_per_s"] for p in points), max(p["cpu_ms_per_s"] for p in points)
        axes.set_xlim(low / 1.6, high * 2.2)
        axes.axvline(1000, color=GREY, lw=0.8, ls=(0, (2, 3)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_major_formatter("{x:g}")
        todo.append((axes, [(p["cpu_ms_per_s"], 100 * p["force_rms_rel"], p["label"],
                             2 if p["label"] == data["default"] else 1 if p["pareto"] else 0) for p in points]))
    for axes, marks in todo:
        label_marks(axes, marks)
    figure.savefig(path)
    plt.close(figure)


def draw_hands(data, path):
    """A row per configuration, a mark per hand: what the worse hand's error hides."""
    figure, panels = grid_of(len(data["runs"]), 7.2, 0.6 + 0.42 * len(data["points"]) / len(data["runs"]))
    figure.set_layout_engine("constrained")
    styles = (dict(marker="o", color=ACCENT), dict(marker="s", color=BLUE), dict(marker="^", color=INK),
              dict(marker="v", color=GREY))
    for axes, entry in zip(panels, data["runs"]):
        points = mine(data, entry)[::-1]
        for row, point in enumerate(points):
            for hand, style in zip(point["hands"], styles):
                axes.plot(100 * hand["force_rms_rel"], row, ls="none", ms=7, zorder=3, **style,
                          mfc=style["color"] if point["reference_converged"] else "white",
                          label=hand["instrument"] if row == 0 else None)
        axes.set_yticks(range(len(points)), [p["label"] for p in points])
        axes.set(xscale="log", xlabel="RMS force error [% of the hand's own peak]", ylim=(-0.6, len(points) - 0.4))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_title(name_of(entry, True), loc="left", fontsize=10)
    panels[0].legend(fontsize=8.5)
    figure.savefig(path)
    plt.close(figure)


def shown(data, trace):
    yield data["default"], dict(color=ACCENT, lw=1.4, zorder=4)
    labels = [r["label"] for r in trace["runs"]]
    for label, line in SHOWN.items():
        if label in labels and label != data["default"]:
            yield label, line


def draw_time(data, traces, path):
    figure, panels = grid_of(len(traces), 7.2, 3.3)
    for axes, (trace, entry, name) in zip(panels, panels_of(data, traces)):
        reference = 1e3 * np.linalg.norm(np.array(trace["reference"]), axis=0)
        t = entry["from_s"] + 1e-3 * np.arange(reference.size)
        runs = {r["label"]: r for r in trace["runs"]}
        for label, line in shown(data, trace):
            force = 1e3 * np.linalg.norm(np.array(runs[label]["force"]), axis=0)
            axes.plot(t, force, label=label, **line)
        axes.plot(t, reference, color=INK, lw=2.6, alpha=0.35, label="reference", zorder=1)
        axes.set(xlabel="time [s]", ylabel="force in the scene [mN]")
        axes.set_ylim(0, 1.8 * reference.max() if reference.max() > 0 else None)
        axes.set_title(name, loc="left", fontsize=10)
    panels[0].legend(fontsize=8.5, ncol=2)
    figure.set_layout_engine("constrained")
    figure.savefig(path)
    plt.close(figure)


def draw_spectrum(data, traces, path):
    figure, panels = grid_of(len(traces), 7.2, 3.3)
    for axes, (trace, entry, name) in zip(panels, panels_of(data, traces)):
        runs = {r["label"]: r for r in trace["runs"]}
        for label, line in shown(data, trace):
            r = runs[label]
            power = np.array(r["power"])[1:]
            f = r["df"] * np.arange(1, power.size + 1)
            axes.plot(f, 1e3 * np.sqrt(np.maximum(power / r["df"], 1e-30)), label=label, **line)
        axes.axvspan(FELT, 500, color="#f1f2f4", lw=0, zorder=0)
        axes.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="force error [mN/√Hz]", xlim=(None, 500))
        axes.set_title(name, loc="left", fontsize=10)
    panels[0].legend(fontsize=8.5, title="shaded: felt as buzz, above 30 Hz", title_fontsize=8.5, loc="lower left", frameon=True,
                     framealpha=0.85, edgecolor="none")
    figure.set_layout_engine("constrained")
    figure.savefig(path)
    plt.close(figure)


def draw(data, directory):
    if not data.get("points"):
        sys.exit("no points to draw")
    out = pathlib.Path(directory)
    with open(out / "force_traces.json") as file:
        traces = json.load(file)
    draw_pareto(data, out / "force_pareto.png")
    draw_time(data, traces, out / "force_time.png")
    draw_spectrum(data, traces, out / "force_spectrum.png")
    if "hands" in data["points"][0]:
        draw_hands(data, out / "force_hands.png")


if __name__ == "__main__":
    run(__doc__, draw, "JSON of `haptic chart force`", "directory for the pictures")
