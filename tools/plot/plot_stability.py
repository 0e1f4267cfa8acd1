#!/usr/bin/python3
"""Draws the figures of `haptic stability`, and one page with all of them that needs no other file.

Example: tools/plot/plot_stability.py build/stability/stability.json build/stability
"""
import pathlib
import re
import textwrap
import time

from plot_page import machine, page, picture, scrolled, text
from plot_style import ACCENT, GREY, INK, plt, run

# Least first, so that the daemon is drawn over what it coincides with.
WAYS = (("held", GREY, "^", 5, "force held for 20 ms"), ("wall", INK, "s", 7, "ideal 1 kHz wall, the best of its dampings"),
        ("wall_alike", "#8a6fb0", "v", 7, "the wall as viscous as the tissue"),
        ("controlled", "#2b7a78", "D", 8, "the daemon with its passivity controller"), ("default", ACCENT, "o", 4, "the daemon"))
JUDGED = (("", "no swing at rest"), ("passive_", "no swing, and no energy made"))


def limit_panels(points, x, lines):
    """One panel for each judgement; returns the figure and its axes. The dotted line is what is asked."""
    figure, panels = plt.subplots(1, 2, figsize=(11, 4), sharey=True)
    for axes, (kind, title) in zip(panels, JUDGED):
        for k, (who, colour, marker, size, label) in enumerate(WAYS):
            if not any(f"{who}_n_m" in p for p in points):
                continue
            # Nothing sound in the whole range: no point.
            limit = [p.get(f"{who}_{kind}n_m") or float("nan") for p in points]
            at = x if lines else [v + 0.12 * (k - 2) for v in x]
            axes.plot(at, limit, marker + ("-" if lines else ""), color=colour, ms=size, lw=1.4, label=label,
                      mfc="none" if who == "controlled" else colour)
        asked = [0.8 * p[f"wall_{kind}n_m"] for p in points]
        if lines:
            axes.plot(x, asked, ":", color=INK, lw=1, label="four fifths of the best wall")
            axes.plot(x, [p["colgate_n_m"] for p in points], "--", color=GREY, lw=1.2,
                      label="Colgate: 2 b / T, no damping rendered")
        else:
            for v, limit in zip(x, asked):
                axes.plot([v - 0.35, v + 0.35], [limit, limit], ":", color=INK, lw=1.2,
                          label="four fifths of the best wall" if v == x[0] else None)
            axes.axhline(points[0]["colgate_n_m"], color=GREY, ls="--", lw=1.2, label="Colgate: 2 b / T")
        axes.set(yscale="log")
        axes.set_title(title, fontsize=10)
    panels[0].set_ylabel("largest displayed stiffness [N/m]")
    return figure, panels


def save_panels(figure, panels, path):
    figure.tight_layout()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.01), ncols=3, fontsize=9)
    figure.savefig(path, bbox_inches="tight")
    plt.close(figure)


def draw_map(points, path):
    b = [p["device_damping_ns_m"] for p in points]
    figure, panels = limit_panels(points, b, True)
    for axes in panels:
        axes.set(xscale="log", xlabel="damping of the device [N·s/m]")
    save_panels(figure, panels, path)


def draw_grasps(points, path):
    figure, panels = limit_panels(points, list(range(len(points))), False)
    for axes in panels:
        axes.set_xlim(-0.5, len(points) - 0.5)
        axes.set_xticks(range(len(points)), [
            f"{p['hand']}\n{1e3 * p['mass_kg']:g} g\n{p['damping_ns_m']:g} N·s/m\n{p['stiffness_n_m']:g} N/m" for p in points
        ], fontsize=8)
    save_panels(figure, panels, path)


def unit(mode):
    """Of the parameter, as its words have it in brackets: of what breaks first, of the bound, of what is asked."""
    found = re.search(r"\[([^\]]+)\]", mode["parameter"])
    return found.group(1) if found else ""


def axis_of(mode):
    """The parameter's first words, with its unit wherever that is."""
    words = mode["parameter"].split(",")[0]
    return words if "[" in words or not unit(mode) else f"{words} [{unit(mode)}]"


def draw_limits(axes, mode):
    """What was judged over the value that was made worse; what lies below the axis sits on it, hollow."""
    judged = {who: [(p["value"], p[who]["judged"]) for p in mode["points"] if who in p] for who in ("naive", "default")}
    numbers = [j for points in judged.values() for _, j in points if j is not None] + [mode["limit"]]
    # No number came out: above everything.
    highest = 10 * max(numbers)
    bottom = max(0.3 * min(n for n in numbers if n > 0), 1e-3 * mode["limit"])
    for who, colour, size in (("naive", GREY, 7), ("default", ACCENT, 4)):
        x = [value for value, _ in judged[who]]
        y = [max(highest if j is None else j, bottom) for _, j in judged[who]]
        axes.plot(x, y, "-", color=colour, clip_on=False)
        for fill, shown in ((colour, [v > bottom for v in y]), ("white", [v <= bottom for v in y])):
            axes.plot([v for v, s in zip(x, shown) if s], [v for v, s in zip(y, shown) if s], "o", color=colour, ms=size,
                      mfc=fill, clip_on=False, zorder=3)
    axes.axhline(mode["limit"], color=INK, lw=1, ls=":")
    axes.axvline(mode["required"], color=INK, lw=1, ls="--")
    axes.text(mode["required"], 1.01, "required", transform=axes.get_xaxis_transform(), ha="center", fontsize=8)
    if mode["analytic_bound"] and mode["swept"][0] < mode["analytic_bound"] < mode["swept"][1]:
        axes.axvline(mode["analytic_bound"], color=INK, lw=1, ls="-.")
        axes.text(mode["analytic_bound"], 1.07, "bound", transform=axes.get_xaxis_transform(), ha="center", fontsize=8)
    narrow = mode["swept"][1] < 8 * mode["swept"][0]
    axes.set(xscale="linear" if narrow else "log", yscale="log",
             xlabel="\n".join(textwrap.wrap(axis_of(mode), 42)),
             ylabel="\n".join(textwrap.wrap(mode["judged"], 36)), ylim=(bottom, None))
    if not narrow and mode["swept"][1] < 100 * mode["swept"][0]:  # powers of ten alone would be one or two ticks
        ticks, apart = [], (mode["swept"][1] / mode["swept"][0]) ** (1 / 7)
        for value in sorted(p["value"] for p in mode["points"]):
            if not ticks or value > apart * ticks[-1]:
                ticks.append(value)
        axes.set_xticks(ticks, [f"{v:.3g}" for v in ticks])
        axes.tick_params(axis="x", which="minor", labelbottom=False)


def draw_traces(axes, mode):
    trace = mode["trace"]
    logarithmic = trace["y"].startswith(("error", "residual"))
    for who, colour, label in (("naive", GREY, "naive"), ("default", ACCENT, "daemon")):
        few = len(trace[who]["x"]) < 40
        y = [max(v, 1e-16) for v in trace[who]["y"]] if logarithmic else trace[who]["y"]
        axes.plot(trace[who]["x"], y, "o-" if few else "-", ms=3, color=colour, lw=1, label=label)
    axes.set(xlabel=trace["x"], ylabel=trace["y"])
    if logarithmic:
        axes.set(yscale="log")
    else:
        every = trace["naive"]["y"] + trace["default"]["y"]
        limit = 3 * max(map(abs, trace["default"]["y"]), default=0) or 1
        reach = max(map(abs, every))
        axes.set(ylim=(-min(limit, 1.1 * reach) if min(every) < 0 else -0.05 * min(limit, reach), min(limit, 1.1 * reach)))
    axes.set_title(f"at {mode['trace_value']:.4g} {unit(mode)}", fontsize=9, loc="left")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 0.98), ncols=2, fontsize=9)


def draw_links(links, path):
    """Energy made and stiffness displayed, a link a place."""
    least = 1e-2  # µJ
    names = [f"{p['delay_ms']:g}" + (f" ± {p['jitter_ms']:g}\n{100 * p['loss']:g} % lost" if p["loss"] else "") for p in links]
    places = range(len(links))
    figure, (energy, stiffness) = plt.subplots(2, 1, figsize=(9.5, 6), sharex=True)
    for label, colour, made, felt in (
            ("without the tank", GREY, "energy_made_untanked_j", "stiffness_untanked_n_per_m"),
            ("with the tank", ACCENT, "energy_made_j", "stiffness_n_per_m")):
        y = [max(1e6 * p[made], least) for p in links]
        energy.scatter(places, y, s=50, edgecolors=colour, label=label, clip_on=False, zorder=3,
                       facecolors=[colour if v > least else "white" for v in y])
        stiffness.plot(places, [p[felt] for p in links], "o-", color=colour, lw=1, ms=5, clip_on=False)
    energy.axhline(1, color=INK, lw=1, ls=":")
    energy.set(yscale="log", ylim=(least, None), ylabel="energy made by a hand\nat random [µJ]; hollow: none")
    energy.legend(loc="upper left", fontsize=9)
    stiffness.set(ylabel="largest sound displayed\nstiffness [N/m]", ylim=(0, None), xlabel="delay of the link, one way [ms]")
    stiffness.set_xticks(places, names)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def draw_mode(mode, path):
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.6), gridspec_kw={"width_ratios": [1, 1.5]})
    draw_limits(left, mode)
    draw_traces(right, mode)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def shown(value, of):
    return "–" if value is None else f"{value:g} {of}".strip()


STATUS = ("disarmed holding ramping_down ramping_up problem_old problem_lost gap rejected latched conflict saturated "
          "slew_limited not_finite solver_cap blending contacts_dropped "
          "second_daemon contact_lost").split()


def verdict(mode):
    if not mode["survives_required_range"]:
        return '<span class="bad">breaks</span>'
    if not mode["ends_in_safe_state"]:
        return "survives"
    bits = [name for k, name in enumerate(STATUS) if mode["default_status_when_broken"] >> k & 1]
    return "safe: " + text(", ".join([mode["default_says"]] if mode["default_says"] else bits))


def of_mode(mode, data, folder):
    """What was made worse, how it was judged, and its picture."""
    parts = [f"<h2 id=\"{text(mode['mode'])}\">{text(mode['mode'])}</h2><p>{text(mode['parameter'])}. Naive: {text(mode['naive'])}. "
             f"Here: {text(mode['default'])}. Judged: {text(mode['judged'])}"
             f"{'' if mode['last_sound'] else ', broken above ' + format(mode['limit'], 'g')}. Required: "
             f"{text(mode['required_because'])}.</p>"]
    if mode["mode"] == "stiffness":
        parts.append(picture(folder / "stability_map.png"))
    elif mode["mode"] == "link" and data.get("links"):
        draw_links(data["links"], folder / "stability_link.png")
        parts.append(picture(folder / "stability_link.png"))
    elif mode["mode"] == "grasps":
        parts.append(picture(folder / "stability_grasps.png") + "<ul>" + "".join(
            f"<li>{text(p['hand'])}: {text(p['source'])}</li>" for p in data["grasps"]) + "</ul>")
    elif mode.get("trace"):
        path = folder / f"stability_{mode['mode'].replace(' ', '_')}.png"
        draw_mode(mode, path)
        parts.append(picture(path))
    return "".join(parts)


def draw(data, folder):
    folder = pathlib.Path(folder)
    rows, sections = [], []
    for key, of in (("map", draw_map), ("grasps", draw_grasps)):
        if data.get(key):
            of(data[key], folder / f"stability_{key}.png")
    for mode in data["modes"]:
        name = f"<a href=\"#{text(mode['mode'])}\">{text(mode['mode'])}</a>"
        rows.append(("", [name] + [shown(mode[key], unit(mode)) for key in
                                   ("naive_breaks_at", "default_breaks_at", "analytic_bound", "required")] + [f'<span class="words">{verdict(mode)}</span>']))
        sections.append(of_mode(mode, data, folder))
    if data.get("random"):
        keys = [k for k in data["random"][0] if k not in ("passivity_control", "status", "faults")]
        sections.append("<h2>random</h2><p>A hand strays through the cataract scene, cuts, and loses states.</p>"
                        + scrolled([""] + [f"tank {'on' if r['passivity_control'] else 'off'}" for r in data["random"]],
                                   [("", [k] + [f"{r[k]:g}" for r in data["random"]]) for k in keys]))
    broken = [m["mode"] for m in data["modes"] if not m["survives_required_range"]]
    found = f"{len(data['modes']) - len(broken)} of {len(data['modes'])} modes survive what is required of them"
    bad = f' <span class="bad">Not: {text(", ".join(broken))}.</span>' if broken else ""
    quick = " Quick run: wider steps than <code>haptic stability</code> without <code>--quick</code>." if data.get("quick") else ""
    body = (f"<h1>Where methods break</h1><p class=dim>Drawn {time.strftime('%Y-%m-%d %H:%M UTC', time.gmtime())} on "
            f"{text(machine())}. Time is virtual: the machine's load changes no figure.{quick}</p><p><b>{found}.</b>{bad}</p>"
            "<p>One thing is made worse until something breaks; in most modes a hand on a device presses into tissue, and "
            "the loop swings or makes energy. Grey is the naive method, orange the daemon. Below, the first value that "
            "breaks each (of stiffness and grasps the last sound one), in the unit of what was made worse; – means that "
            "none in the range did.</p>"
            + scrolled(["mode", "naive breaks at", "daemon breaks at", "analytic bound", "required",
                        '<span class="words">the daemon</span>'], rows)
            + "".join(sections))
    (folder / "stability.html").write_text(page("hapticd: stability", body), encoding="utf-8")


if __name__ == "__main__":
    run(__doc__, draw, "stability.json", "folder for the pictures and stability.html")
