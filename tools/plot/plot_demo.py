#!/usr/bin/python3
"""Draws the demonstration: force.png, latency.png, stages.png and lens.png.

Reads forces.csv (and forces.NAME.csv of a second hand), daemon.json, replay.json, BODY_before.vtk,
BODY_at_TIME.vtk and BODY_after.vtk from DIRECTORY and writes the pictures there. Histograms are daemon.json's
wake_histogram and solve_histogram, [[middle of the bin in us, count], ...]; where it has none, they are counted
from the answered slots in forces.csv.
Example: tools/plot/plot_demo.py build/demo --body lens
"""
import argparse
import csv
import json
import pathlib
import sys

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from plot_style import ACCENT, GREY, INK, plt, style

TISSUE = np.array([0.80, 0.83, 0.87])
ELEVATION, AZIMUTH = 50, -65  # of the eye: in front and above [degrees]
LABEL_BOX = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
CUT = np.array([0.83, 0.36, 0.16])


def read_forces(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    if not rows:
        raise SystemExit(f"{path}: no rows")
    return {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}


def spans(t, on):
    """The intervals in which `on` holds."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], on.astype(int), [0]))))
    return [(t[a], t[min(b, len(t) - 1)]) for a, b in edges.reshape(-1, 2)]


def size_of(forces):
    return np.sqrt(forces["fx"] ** 2 + forces["fy"] ** 2 + forces["fz"] ** 2)


def events_of(daemon, replay):
    """The operation's events, their times counted from the replay's first slot as those of the forces."""
    operation, first = daemon.get("operation", {}), replay.get("devices", [replay])[0]
    known = "began_ns" in operation and "began_ns" in first
    later = 1e-9 * (operation["began_ns"] - first["began_ns"]) if known else 0
    return [dict(event, time_s=event["time_s"] + later) for event in operation.get("events", [])]


def occlusions(events, end):
    """From where the first hand's port is covered to where it is free again [s]."""
    found, since = [], None
    for event in events:
        if event["what"] == "occluded" and event["who"] == "0":
            since = event["time_s"]
        elif event["what"] == "vented" and event["who"] == "0" and since is not None:
            found.append((since, event["time_s"]))
            since = None
    return found + ([(since, end)] if since is not None else [])


def plot_force(hands, daemon, replay, path):
    """Of each hand; below, of an operation with events, how much is gone and in how many pieces it is."""
    operation = daemon.get("operation", {})
    events = events_of(daemon, replay)
    several = len(hands) > 1
    figure, rows = plt.subplots(2 if several else 1, 1, figsize=(9, 5.4 if several else 3.6), squeeze=False, sharex=True,
                                height_ratios=(2, 1) if several else None, constrained_layout=True)
    axes = rows[0, 0]
    t = hands[0][1]["t"]
    most = max(size_of(forces).max() for _, forces in hands)
    for i, (begin, end) in enumerate(spans(t, hands[0][1]["buttons"].astype(int) & 1 == 1)):
        axes.axvspan(begin, end, color="#f1f2f4", zorder=0, lw=0, label="pedal down" if i == 0 else None)
    for (name, forces), colour in zip(hands, (INK, GREY)):
        axes.plot(forces["t"], size_of(forces), color=colour, lw=0.9 if not several else 0.6,
                  label=f"force on {name}" if several else "force on the device")
    removed = hands[0][1]["removed"]
    at = np.flatnonzero(np.diff(removed) > 0) + 1
    if len(at):
        axes.plot(t[at], np.full(len(at), -0.035 * most), "|", color=ACCENT, ms=7, mew=0.4 if several else 1.0,
                  label=f"elements removed ({int(removed[-1])} in all)")
    axes.set_ylabel("force [N]")
    axes.set_xlim(t[0], t[-1])
    axes.set_ylim(-0.07 * most, 1.08 * most if most > 0 else 1)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncol=4, fontsize=9, borderaxespad=0.3)
    if several:
        axes = rows[1, 0]
        for i, (begin, end) in enumerate(occlusions(events, t[-1])):
            axes.axvspan(begin, end, color="#e3ecf7", zorder=0, lw=0, label="port occluded" if i == 0 else None)
        gone = max((body.get("volume_gone_share", 0) for body in operation.get("bodies", [])), default=0)
        axes.plot(t, 100 * gone * removed / max(removed[-1], 1), color=ACCENT, lw=1.2,
                  label="gone of the body: at the end by volume, until then by elements")
        axes.set_ylabel("gone [%]")
        axes.set_ylim(0, 118)
        shown, lower = -1e9, 0
        for event in events:
            if event["what"] == "pieces" and event["value"] <= 4:
                axes.axvline(event["time_s"], color=INK, lw=0.8, ls=":")
                lower = lower + 1 if event["time_s"] - shown < 8 else 0
                axes.annotate(f"{event['value']:.0f} pieces", (event["time_s"], 104 - 12 * lower),
                              xytext=(3, 0), textcoords="offset points", fontsize=8, bbox=LABEL_BOX)
                shown = event["time_s"]
        axes.legend(loc="lower right", fontsize=8)
    axes.set_xlabel("time [s]")
    figure.savefig(path)
    plt.close(figure)


def log_bins(histogram, per_decade=12):
    """[[upper µs, count], ...] gathered in bars equally wide on a log axis, as shares in per cent."""
    upper = np.array([row[0] for row in histogram], float)
    count = np.array([row[1] for row in histogram], float)
    keep = count > 0
    upper, count = np.maximum(upper[keep], 0.01), count[keep]
    if not len(upper):
        return np.array([1.0, 10.0]), np.array([0.0])
    low, high = np.floor(np.log10(upper.min())), np.ceil(np.log10(upper.max()) + 1e-9)
    edges = np.logspace(low, max(high, low + 1), int(max(high - low, 1)) * per_decade + 1)
    bars, _ = np.histogram(upper, edges, weights=count)
    return edges, 100 * bars / count.sum()


def histogram_of(daemon, forces, key):
    if f"{key}_histogram" in daemon:
        return daemon[f"{key}_histogram"]
    times = forces[f"{key}_us"]
    if key == "solve":
        times = times[forces["contacts"] > 0]
    return [[time, 1] for time in times]


def plot_latency(daemon, forces, path):
    figure, both = plt.subplots(1, 2, figsize=(9, 3.4), constrained_layout=True)
    titles = (("wake", "wake-up, late by"), ("solve", "haptic step, contact solve included"))
    for axes, (key, title) in zip(both, titles):
        edges, share = log_bins(histogram_of(daemon, forces, key))
        axes.bar(edges[:-1], share, width=np.diff(edges), align="edge", color=GREY, edgecolor="white", lw=0.5)
        axes.set_xscale("log")
        axes.set_xlabel("time [µs]")
        axes.set_title(title, fontsize=10, loc="left")
        # The tail is the point: one tick of a run must show.
        axes.set_yscale("log")
        axes.set_ylim(0.5 * min(share[share > 0], default=0.1), 5000)
        axes.set_yticks([0.01, 0.1, 1, 10, 100])
        figures = daemon.get(f"{key}_us") or {}
        drawn = [(name, figures.get(k)) for name, k in
                 (("p50", "p50"), ("p99", "p99"), ("p99.9", "p99_9"), ("max", "max"))]
        for i, (name, value) in enumerate(drawn):
            if not value:
                continue
            axes.axvline(value, color=ACCENT, lw=0.9, alpha=0.9)
            axes.annotate(f"{name} {value:.0f}" if value >= 10 else f"{name} {value:.2g}",
                          (value, 0.95 - 0.07 * i), xycoords=("data", "axes fraction"), xytext=(3, 0),
                          textcoords="offset points", color=ACCENT, fontsize=8, va="center", bbox=LABEL_BOX)
        axes.axvline(1000, color=INK, lw=0.9, ls=":")
        left, right = axes.get_xlim()
        axes.set_xlim(left, max(right, 10000, 5 * (figures.get("max") or 0)))
        axes.annotate("1 ms period", (1000, 0.62), xycoords=("data", "axes fraction"), xytext=(3, 0),
                      textcoords="offset points", fontsize=8, color=INK, va="center", bbox=LABEL_BOX)
    both[0].set_ylabel("share of ticks [%]")
    figure.savefig(path)
    plt.close(figure)


def read_vtk(path):
    """Points [mm], triangles and cut flags of an ASCII legacy polydata file."""
    words = iter(pathlib.Path(path).read_text().split("ASCII", 1)[1].split())
    points = triangles = cut = None
    for word in words:
        if word == "POINTS":
            n = int(next(words))
            next(words)
            points = np.array([float(next(words)) for _ in range(3 * n)]).reshape(n, 3) * 1e3
        elif word == "POLYGONS":
            n = int(next(words))
            next(words)
            triangles = np.array([int(next(words)) for _ in range(4 * n)], int).reshape(n, 4)[:, 1:]
        elif word == "LOOKUP_TABLE":
            next(words)
            cut = np.array([int(next(words)) for _ in range(len(triangles))], bool)
    if points is None or triangles is None or cut is None:
        raise SystemExit(f"{path}: not a polydata file with POINTS, POLYGONS and the scalar cut")
    return points, triangles, cut


def draw_surface(axes, points, triangles, cut, centre, half):
    corner = points[triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    elevation, azimuth = np.radians(ELEVATION), np.radians(AZIMUTH)
    eye = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    seen = normal @ eye > 0  # the painter's order only has to sort what faces the eye
    corner, normal, cut = corner[seen], normal[seen], cut[seen]
    light = np.array([-0.45, -0.55, 0.70])
    light /= np.linalg.norm(light)
    shade = 0.50 + 0.50 * np.clip(normal @ light, 0, 1) + 0.06 * normal[:, 2]
    colour = np.where(cut[:, None], CUT, TISSUE) * shade[:, None]
    facets = Poly3DCollection(corner, facecolors=np.clip(colour, 0, 1), edgecolors=(0.2, 0.22, 0.25, 0.30),
                              linewidths=0.35)
    axes.add_collection3d(facets)
    axes.set_proj_type("ortho")
    axes.view_init(elev=ELEVATION, azim=AZIMUTH)
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)
    axes.set_zlim(centre[2] - 0.55 * half, centre[2] + 0.55 * half)
    axes.set_box_aspect((1, 1, 0.55), zoom=1.0)
    for axis, name in ((axes.xaxis, "x [mm]"), (axes.yaxis, "y [mm]"), (axes.zaxis, "z [mm]")):
        axis.set_pane_color((1, 1, 1, 0))
        axis.set_major_locator(plt.MaxNLocator(4))
        axis.label.set_size(8)
        axis.set_label_text(name)
    axes.grid(False)
    axes.tick_params(labelsize=7, pad=-2)


def plot_stages(moments, path):
    """moments: (title, surface), four in a row."""
    columns = min(4, len(moments))
    rows = -(-len(moments) // columns)
    figure = plt.figure(figsize=(3.1 * columns, 2.3 * rows))
    low, high = moments[0][1][0].min(axis=0), moments[0][1][0].max(axis=0)
    centre, half = 0.5 * (low + high), 0.40 * (high - low)[:2].max()
    for i, (title, surface) in enumerate(moments):
        axes = figure.add_subplot(rows, columns, i + 1, projection="3d", computed_zorder=False)
        draw_surface(axes, *surface, centre, half)
        axes.set_axis_off()
        axes.text2D(0.06, 0.90, title, transform=axes.transAxes, fontsize=10)
    figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=1.0, wspace=0.0, hspace=0.0)
    figure.savefig(path)
    plt.close(figure)


def plot_lens(before, after, path):
    figure = plt.figure(figsize=(10, 4.3))
    low, high = before[0].min(axis=0), before[0].max(axis=0)
    centre, half = 0.5 * (low + high), 0.52 * (high - low)[:2].max()
    for i, (title, surface) in enumerate((("before", before), ("after", after))):
        axes = figure.add_subplot(1, 2, i + 1, projection="3d", computed_zorder=False)
        draw_surface(axes, *surface, centre, half)
        axes.text2D(0.03, 0.95, title, transform=axes.transAxes, fontsize=11)
    figure.text(0.5, 0.03, "orange: faces exposed by the tip", ha="center", fontsize=9, color=ACCENT)
    figure.subplots_adjust(left=0.0, right=0.96, bottom=0.06, top=1.0, wspace=0.03)
    figure.savefig(path)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=pathlib.Path)
    parser.add_argument("--body", default="lens", help="the body whose surface is drawn (default: lens)")
    given = parser.parse_args()
    directory = given.directory
    style()
    try:
        daemon = json.loads((directory / "daemon.json").read_text())
        files = [directory / "forces.csv"] + sorted(directory.glob("forces.*.csv"))
        names = [daemon.get("instrument", "device")] + [file.stem.split(".", 1)[1] for file in files[1:]]
        hands = [(name, read_forces(file)) for name, file in zip(names, files)]
        replay = json.loads((directory / "replay.json").read_text())
        plot_force(hands, daemon, replay, directory / "force.png")
        plot_latency(daemon, hands[0][1], directory / "latency.png")
        before, after = (read_vtk(directory / f"{given.body}_{when}.vtk") for when in ("before", "after"))
        plot_lens(before, after, directory / "lens.png")
        kept = sorted(directory.glob(f"{given.body}_at_*.vtk"))
        plot_stages([("before", before), *((f"{int(file.stem[-3:])} s", read_vtk(file)) for file in kept),
                     ("after", after)], directory / "stages.png")
    except (OSError, KeyError, ValueError) as error:
        print(f"plot_demo.py: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
