#!/usr/bin/python3
"""Draws the figures of `haptic stability`, and one page with all of them that needs no other file.

Example: tools/plot_stability.py build/stability/stability.json build/stability
"""
import base64
import html
import pathlib

from plot_style import ACCENT, GREY, INK, plt, run

CSS = """
body { font: 16px/1.55 system-ui, sans-serif; color: #33383f; max-width: 60rem; margin: 2.5rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.9rem; } h2 { margin-top: 2.6rem; border-top: 1px solid #e1e4e8; padding-top: 1.2rem; }
img { max-width: 100%; } table { border-collapse: collapse; font-size: .88rem; width: 100%; }
th, td { text-align: right; padding: .25rem .5rem; border-bottom: 1px solid #e1e4e8; }
th:first-child, td:first-child { text-align: left; } .bad { color: #b00020; font-weight: 600; }
"""


def draw_map(points, path):
    b = [p["device_damping_ns_m"] for p in points]
    figure, axes = plt.subplots(figsize=(7, 4.4))
    axes.plot(b, [p["default_n_m"] for p in points], "o-", color=ACCENT, label="the daemon: no swing")
    axes.plot(b, [p["default_passive_n_m"] for p in points], "o:", color=ACCENT, mfc="white",
              label="… and no energy made")
    axes.plot(b, [p["wall_n_m"] for p in points], "s-", color=INK, label="ideal 1 kHz wall: no swing")
    axes.plot(b, [p["wall_passive_n_m"] for p in points], "s:", color=INK, mfc="white", label="… and no energy made")
    axes.plot(b, [p["held_n_m"] for p in points], "^-", color=GREY, label="force held for 20 ms")
    axes.plot(b, [p["colgate_n_m"] for p in points], "--", color=GREY, label="Colgate: 2 b / T, no damping rendered")
    axes.set(xscale="log", yscale="log", xlabel="damping of the device [N·s/m]",
             ylabel="largest displayed stiffness [N/m]")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, bbox_inches="tight")
    plt.close(figure)


def draw_mode(mode, path):
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.4), gridspec_kw={"width_ratios": [1, 1.5]})
    for who, colour in (("naive", GREY), ("default", ACCENT)):
        points = [p for p in mode["points"] if who in p]
        value = [p["value"] for p in points]
        by_energy = mode["judged_by"] == "energy"
        judged = [max(-p[who]["surplus_uj"] if by_energy else p[who]["swing_um"], 0.1) for p in points]
        left.plot(value, judged, "o-", color=colour, ms=4)
        broken = mode[f"{who}_breaks_at"]
        if broken:
            left.axvline(broken, color=colour, lw=1, ls=":")
    left.axvline(mode["required"], color=INK, lw=1, ls="--")
    left.text(mode["required"], 1.01, "required", transform=left.get_xaxis_transform(), ha="center", fontsize=8)
    if mode["analytic_bound"] and mode["swept"][0] < mode["analytic_bound"] < mode["swept"][1]:
        left.axvline(mode["analytic_bound"], color=INK, lw=1, ls="-.")
        left.text(mode["analytic_bound"], 1.07, "bound", transform=left.get_xaxis_transform(), ha="center", fontsize=8)
    left.set(xscale="log", yscale="log", xlabel=mode["parameter"].split(",")[0], ylabel="energy made [µJ]" if by_energy else "swing at rest [µm]")
    trace = mode["trace"]
    for who, colour, label in (("naive", GREY, "naive"), ("default", ACCENT, "daemon")):
        right.plot(trace[who]["t"], trace[who]["force_n"], color=colour, lw=1, label=label)
    ours = [abs(f) for f in trace["default"]["force_n"]] or [0]
    limit = 3 * max(ours) or 1
    pulls = min(trace["naive"]["force_n"] + trace["default"]["force_n"]) < 0
    right.set(xlabel="time [s]", ylabel="force on the hand [N]", ylim=(-limit if pulls else -0.05 * limit, limit))
    right.set_title(f"at {mode['trace_value']:g}", fontsize=9)
    right.legend(loc="upper left", ncols=2)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def picture(path):
    return f'<p><img alt="{path.stem}" src="data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"></p>'


def shown(value):
    return "–" if value is None else f"{value:g}"


def draw(data, folder):
    folder = pathlib.Path(folder)
    rows, sections = [], []
    if data.get("map"):
        draw_map(data["map"], folder / "stability_map.png")
    for mode in data["modes"]:
        verdict = "safe state" if mode["ends_in_safe_state"] else "survives"
        if not mode["survives_required_range"]:
            verdict = '<span class="bad">breaks</span>'
        rows.append(f"<tr><td>{html.escape(mode['mode'])}</td><td>{shown(mode['naive_breaks_at'])}</td>"
                    f"<td>{shown(mode['default_breaks_at'])}</td><td>{shown(mode['analytic_bound'])}</td>"
                    f"<td>{shown(mode['required'])}</td><td>{verdict}</td></tr>")
        text = (f"<h2>{html.escape(mode['mode'])}</h2><p>{html.escape(mode['parameter'])}. Naive: "
                f"{html.escape(mode['naive'])}. Required: {html.escape(mode['required_because'])}.</p>")
        if mode["mode"] == "stiffness":
            text += picture(folder / "stability_map.png")
        elif mode.get("trace"):
            path = folder / f"stability_{mode['mode'].replace(' ', '_')}.png"
            draw_mode(mode, path)
            text += picture(path)
        sections.append(text)
    page = (f"<!doctype html><html lang=en><meta charset=utf-8><title>Stability</title><style>{CSS}</style>"
            "<h1>Where methods break</h1><p>A hand on a device presses into tissue, offline, one thing is made worse "
            "until the loop swings or makes energy. Grey is the naive method, orange the daemon as it is. Below, the "
            "first value that breaks each; – means that none in the range did.</p>"
            "<table><tr><th>mode</th><th>naive breaks at</th><th>daemon breaks at</th><th>analytic bound</th>"
            f"<th>required</th><th></th></tr>{''.join(rows)}</table>{''.join(sections)}</html>")
    (folder / "stability.html").write_text(page)


if __name__ == "__main__":
    run(__doc__, draw, "stability.json", "folder for the pictures and stability.html")
