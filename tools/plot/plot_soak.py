#!/usr/bin/env python3
"""Draws the histograms of a soak: tools/plot/plot_soak.py soak.json soak.png

Counts per logarithmic bin, both axes logarithmic: the tail is the point.
"""
import json
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

PANELS = [
    ("lateness of wake-ups, µs", [("wake_us", "haptic loop, 1 kHz tick"), ("cyclictest_us", "cyclictest"),
                                ("timer_us", "the loop's timer")]),
    ("round trip, µs", [("rtt_us", "event mode"), ("rtt_tick_us", "1 kHz tick")]),
    ("age of the state at the tick, µs", [("state_age_us", "1 kHz tick")]),
    ("haptic step and write, µs", [("compute_us", "haptic step with contact"), ("dds_write_us", "write over DDS")]),
    ("age of the condensed problem, ms", [("problem_age_ms", "1 kHz tick")]),
]


def counts(bins, edges):
    values, numbers = np.array([b[0] for b in bins], float), np.array([b[1] for b in bins], float)
    return np.histogram(np.maximum(values, edges[0]), edges, weights=numbers)[0]


def draw(axis, figures, title, series):
    bins = [(name, figures["histograms"].get(key) or []) for key, name in series]
    highest = max((b[-1][0] for _, b in bins if b), default=1)
    lowest = max(0.05, min((b[0][0] for _, b in bins if b), default=0.1))
    edges = np.geomspace(lowest, 1.05 * max(highest, 2 * lowest), 90)
    for (name, b), colour in zip(bins, ("tab:blue", "tab:orange", "tab:purple")):
        if b:
            axis.stairs(counts(b, edges), edges, label=f"{name} ({sum(n for _, n in b)})", color=colour)
    axis.set(xscale="log", yscale="log", xlabel=title, ylabel="count")
    axis.grid(alpha=0.3)
    if any(b for _, b in bins):
        axis.legend(fontsize=8)


def draw_minutes(axis, figures):
    minutes = figures["minutes"]
    x = np.arange(1, len(minutes) + 1)
    for key, name, colour in (("wake_us", "wake-up", "tab:blue"), ("timer_us", "timer", "tab:purple"),
                              ("cyclictest_us", "cyclictest", "tab:orange"),
                              ("rtt_us", "round trip, event", "tab:green"), ("compute_us", "haptic step", "tab:red")):
        for percentile, style in (("p50", "-"), ("p99", "--"), ("p99_9", ":")):
            y = [m[key][percentile] if m[key][percentile] is not None else np.nan for m in minutes]
            axis.plot(x, y, style, marker=".", color=colour, label=f"{name} {percentile.replace('_', '.')}")
    axis.set(xlabel="minute", ylabel="µs", yscale="log")
    axis.grid(alpha=0.3)
    low, high = axis.get_ylim()
    axis.set_ylim(low, 40 * high)  # room for the names
    axis.legend(fontsize=6, ncol=4, loc="upper center")
    memory = axis.twinx()
    memory.plot(x, [m["rss_mb"] for m in minutes], color="0.4", linewidth=0.8)
    highest = max(m["rss_mb"] for m in minutes)
    memory.set(ylabel="memory of the daemons, MB (grey)", ylim=(0, 1.3 * highest if highest > 0 else 1))


def main(source, target):
    with open(source, encoding="utf-8") as file:
        figures = json.load(file)
    figure, axes = plt.subplots(2, 3, figsize=(15, 8), constrained_layout=True)
    for axis, (title, series) in zip(axes.flat, PANELS):
        draw(axis, figures, title, series)
    draw_minutes(axes.flat[-1], figures)
    answered, scheduled = figures["slots"]["answered"], figures["slots"]["scheduled"]
    figure.suptitle(
        f"haptic soak, {figures['duration_s']:.0f} s, load {figures['load_percent']:.0f} %: {answered} of {scheduled} "
        f"slots answered, {figures['page_faults']} page faults, "
        f"{figures['allocations_in_haptic_code']} allocations; verdict: {figures['verdict']}")
    figure.savefig(target, dpi=80)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2])
