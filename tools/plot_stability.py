#!/usr/bin/python3
"""Draws the figures of `haptic stability`, and one page with all of them that needs no other file.

Example: tools/plot_stability.py build/stability/stability.json build/stability
"""
import base64
import html
import pathlib
import textwrap

from plot_style import ACCENT, GREY, INK, plt, run

CSS = """
body { font: 16px/1.55 system-ui, sans-serif; color: #33383f; max-width: 60rem; margin: 2.5rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.9rem; } h2 { margin-top: 2.6rem; border-top: 1px solid #e1e4e8; padding-top: 1.2rem; }
img { max-width: 100%; } table { border-collapse: collapse; font-size: .88rem; width: 100%; }
th, td { text-align: right; padding: .25rem .5rem; border-bottom: 1px solid #e1e4e8; }
th:first-child, td:first-child { text-align: left; } .bad { color: #b00020; font-weight: 600; }
"""


WAYS = (("default", ACCENT, "o", "the daemon"), ("controlled", "#2b7a78", "D", "… with its passivity controller"),
        ("wall", INK, "s", "ideal 1 kHz wall"), ("wall_alike", "#8a6fb0", "v", "the wall as viscous as the tissue"),
        ("held", GREY, "^", "force held for 20 ms"))


def limit_curves(axes, x, points, lines):
    """Filled: no swing at rest. Hollow: no energy made either."""
    for k, (who, colour, marker, label) in enumerate(WAYS):
        if not any(f"{who}_n_m" in p for p in points):
            continue
        # Nothing sound in the whole range: no point.
        steady, passive = ([p.get(f"{who}_{kind}n_m") or float("nan") for p in points] for kind in ("", "passive_"))
        at = x if lines else [v + 0.09 * (k - 2) for v in x]
        axes.plot(at, steady, marker + ("-" if lines else ""), color=colour, label=f"{label}: no swing")
        axes.plot(at, passive, marker + (":" if lines else ""), color=colour, mfc="white", label="… and no energy made")


def draw_map(points, path):
    b = [p["device_damping_ns_m"] for p in points]
    figure, axes = plt.subplots(figsize=(7, 4.4))
    limit_curves(axes, b, points, True)
    axes.plot(b, [p["colgate_n_m"] for p in points], "--", color=GREY, label="Colgate: 2 b / T, no damping rendered")
    axes.set(xscale="log", yscale="log", xlabel="damping of the device [N·s/m]",
             ylabel="largest displayed stiffness [N/m]")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, bbox_inches="tight")
    plt.close(figure)


def draw_grasps(points, path):
    figure, axes = plt.subplots(figsize=(7, 4.2))
    limit_curves(axes, range(len(points)), points, False)
    axes.set(yscale="log", ylabel="largest displayed stiffness [N/m]", xlim=(-0.5, len(points) - 0.5))
    axes.axhline(points[0]["colgate_n_m"], color=GREY, ls="--", lw=1, label="Colgate: 2 b / T")
    axes.set_xticks(range(len(points)), [
        f"{p['hand']}\n{1e3 * p['mass_kg']:g} g\n{p['damping_ns_m']:g} N·s/m\n{p['stiffness_n_m']:g} N/m" for p in points
    ], fontsize=8)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, bbox_inches="tight")
    plt.close(figure)


def draw_mode(mode, path):
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.6), gridspec_kw={"width_ratios": [1, 1.5]})
    floor = max(mode["limit"] * 1e-6, 1e-12)
    highest = max([p[who]["judged"] or 0 for p in mode["points"] for who in ("naive", "default") if who in p] + [mode["limit"]])
    shown = []
    for who, colour in (("naive", GREY), ("default", ACCENT)):
        points = [p for p in mode["points"] if who in p]
        # No number came out: above everything.
        judged = [10 * highest if p[who]["judged"] is None else p[who]["judged"] for p in points]
        shown += judged
        left.plot([p["value"] for p in points], [max(j, floor) for j in judged], "o-", color=colour, ms=4)
    left.axhline(mode["limit"], color=INK, lw=1, ls=":")
    left.axvline(mode["required"], color=INK, lw=1, ls="--")
    left.text(mode["required"], 1.01, "required", transform=left.get_xaxis_transform(), ha="center", fontsize=8)
    if mode["analytic_bound"] and mode["swept"][0] < mode["analytic_bound"] < mode["swept"][1]:
        left.axvline(mode["analytic_bound"], color=INK, lw=1, ls="-.")
        left.text(mode["analytic_bound"], 1.07, "bound", transform=left.get_xaxis_transform(), ha="center", fontsize=8)
    least = min([j for j in shown if j > 0] + [mode["limit"]])
    narrow = mode["swept"][1] < 8 * mode["swept"][0]
    left.set(xscale="linear" if narrow else "log", yscale="log", xlabel="\n".join(textwrap.wrap(mode["parameter"].split(",")[0], 42)),
             ylabel="\n".join(textwrap.wrap(mode["judged"], 36)), ylim=(max(0.3 * least, 1e-3 * mode["limit"]), None))
    trace = mode["trace"]
    for who, colour, label in (("naive", GREY, "naive"), ("default", ACCENT, "daemon")):
        few = len(trace[who]["x"]) < 40
        right.plot(trace[who]["x"], trace[who]["y"], "o-" if few else "-", ms=3, color=colour, lw=1, label=label)
    ours = [abs(f) for f in trace["default"]["y"]] or [0]
    right.set(xlabel=trace["x"], ylabel=trace["y"])
    if trace["y"].startswith(("error", "residual")):
        right.set(yscale="log")
    else:
        limit = 3 * max(ours) or 1
        pulls = min(trace["naive"]["y"] + trace["default"]["y"]) < 0
        reach = max(map(abs, trace["naive"]["y"] + trace["default"]["y"]))
        right.set(ylim=(-min(limit, 1.1 * reach) if pulls else -0.05 * min(limit, reach), min(limit, 1.1 * reach)))
    right.set_title(f"at {mode['trace_value']:g}", fontsize=9)
    right.legend(loc="best", ncols=2)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def picture(path):
    return f'<p><img alt="{path.stem}" src="data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"></p>'


def shown(value):
    return "–" if value is None else f"{value:g}"


STATUS = ("disarmed holding ramping_down ramping_up problem_old problem_lost gap rejected latched conflict saturated "
          "slew_limited not_finite solver_cap blending contacts_dropped").split()


def verdict(mode):
    if not mode["survives_required_range"]:
        return '<span class="bad">breaks</span>'
    if not mode["ends_in_safe_state"]:
        return "survives"
    bits = [name for k, name in enumerate(STATUS) if mode["default_status_when_broken"] >> k & 1]
    return "safe: " + html.escape(", ".join([mode["default_says"]] if mode["default_says"] else bits))


def draw(data, folder):
    folder = pathlib.Path(folder)
    rows, sections = [], []
    for key, of in (("map", draw_map), ("grasps", draw_grasps)):
        if data.get(key):
            of(data[key], folder / f"stability_{key}.png")
    for mode in data["modes"]:
        rows.append(f"<tr><td>{html.escape(mode['mode'])}</td><td>{shown(mode['naive_breaks_at'])}</td>"
                    f"<td>{shown(mode['default_breaks_at'])}</td><td>{shown(mode['analytic_bound'])}</td>"
                    f"<td>{shown(mode['required'])}</td><td>{verdict(mode)}</td></tr>")
        text = (f"<h2>{html.escape(mode['mode'])}</h2><p>{html.escape(mode['parameter'])}. Naive: "
                f"{html.escape(mode['naive'])}. Here: {html.escape(mode['default'])}. Judged: {html.escape(mode['judged'])}"
                f"{'' if mode['last_sound'] else ', broken above ' + format(mode['limit'], 'g')}. Required: "
                f"{html.escape(mode['required_because'])}.</p>")
        if mode["mode"] == "stiffness":
            text += picture(folder / "stability_map.png")
        elif mode["mode"] == "grasps":
            text += picture(folder / "stability_grasps.png") + "<ul>" + "".join(
                f"<li>{html.escape(p['hand'])}: {html.escape(p['source'])}</li>" for p in data["grasps"]) + "</ul>"
        elif mode.get("trace"):
            path = folder / f"stability_{mode['mode'].replace(' ', '_')}.png"
            draw_mode(mode, path)
            text += picture(path)
        sections.append(text)
    if data.get("random"):
        keys = [k for k in data["random"][0] if k not in ("passivity_control", "status")]
        head = "".join(f"<th>controller {'on' if r['passivity_control'] else 'off'}</th>" for r in data["random"])
        body = "".join(f"<tr><td>{k}</td>" + "".join(f"<td>{r[k]:g}</td>" for r in data["random"]) + "</tr>" for k in keys)
        sections.append("<h2>random</h2><p>A hand strays through the cataract scene, cuts, and loses states.</p>"
                        f"<table><tr><th></th>{head}</tr>{body}</table>")
    page = (f"<!doctype html><html lang=en><meta charset=utf-8><title>Stability</title><style>{CSS}</style>"
            "<h1>Where methods break</h1><p>One thing is made worse until something breaks; in most modes a hand on a "
            "device presses into tissue, and the loop swings or makes energy. Grey is the naive method, orange the daemon. "
            "Below, the first value that breaks each (of stiffness and grasps the last sound one); – means that none in "
            "the range did.</p>"
            "<table><tr><th>mode</th><th>naive breaks at</th><th>daemon breaks at</th><th>analytic bound</th>"
            f"<th>required</th><th></th></tr>{''.join(rows)}</table>{''.join(sections)}</html>")
    (folder / "stability.html").write_text(page)


if __name__ == "__main__":
    run(__doc__, draw, "stability.json", "folder for the pictures and stability.html")
