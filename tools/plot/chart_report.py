#!/usr/bin/python3
"""Writes one self-contained page with every chart of `haptic chart all`.

Reads charts.json and the folder of each chart beside it: its JSON and all its pictures, which go into the page.
Example: tools/plot/chart_report.py build/chart/charts.json build/chart/report.html
"""
import json
import pathlib
import sys

from plot_page import machine, page, picture, scrolled, text

# A chart that is not named here comes at the end, with its pictures alone.
SECTIONS = {
    "force": ("Speed against accuracy of the force", """
Each mark is one way to run the scene. To the right it costs more processor time, upward its force errs more against
a single loop that solves everything each millisecond. The line is the front: nothing below and to the left of it was
found. The star is what the daemon does unless it is told otherwise. Hollow marks do not count: halving the
reference's step still changes its force by more than 0.5 % of the peak, or an element turned inside out."""),
    "tissue": ("How exact the tissue is", "The finite elements against answers known by hand or from finer meshes."),
    "step": ("What a simulation step costs", """
A tip travels over lenses of growing size. Below the dotted line a step fits 50 Hz; exponents are of the nodes. The second
row is what the step of <code>zone</code> is made of."""),
    "economy": ("No more model than a scene needs", """
What the plan of <code>model: auto</code> chose for each scene, its error and its cost, beside everything modelled."""),
    "removal": ("What removing an element costs", """
Elements are taken out one by one. Lines that rise pay for every element ever removed; flat lines do not.
The second row is the error of the compliance that comes out, the third the memory it takes."""),
    "cut": ("What cutting costs", """
Faces of a mesh are opened and tetrahedra divided; what a step then takes, and the opened beam against the answer that
beam theory gives."""),
    "warping": ("What turning a stale compliance is worth", """
A compliance made at rest is used for tissue that has moved; the error of what comes out, with the base turned along
with the tissue and without."""),
    "lcp": ("Time against residual of the contact solvers", """
Each mark is one kind of contact problem: to the right slower, upward less exact. The dashed line is the millisecond
that a haptic tick has."""),
    "pieces": ("Pieces that touch", """
Above, solvers of the joint contact problem of a simulation step, on problems taken from steps in which a tip stirs
loose pieces: their time against the number of touches, and against the residual that their answer has by the law of
friction itself. Left of the dotted line is what a step asks. A hollow mark did not get there. Below: force that the
haptic loop is off by while a piece is pushed 0.4 mm in one step, for what it holds of the pieces' contacts is the
last step's; and how far bodies in contact are from answers known by hand, in units of what is asked."""),
}

def percent(value, digits=2):
    return f"{100 * value:.{digits}f}"


def small(value):
    """A power of ten that no line breaks in two."""
    return f"{value:.0e}".replace("-", "\u2011")


def table(head, rows):
    return scrolled([text(h) for h in head], [(kind, [text(c) for c in row]) for kind, row in rows])


def force_details(data):
    parts = [f"<p>Scene <b>{text(data['scene'])}</b>; the default is <b>{text(data['default'])}</b>.</p>"]
    for run in data.get("runs", []):
        points = [p for p in data["points"] if (p["trajectory"], p["removals"]) == (run["trajectory"], run["removals"])]
        removals = f", {run['removals']} elements removed per 20 ms" if run["removals"] else ""
        state = (f"half a step of {run['reference_step_ms']} ms changes the reference by {percent(run['half_step_rms_rel'])} % of the peak, "
                 f"{run['inverted']} elements inverted")
        if not run["reference_converged"]:
            state = f'<span class="bad">reference not converged</span>: {state}'
        parts.append(f"<h3>{text(run['trajectory'])}{text(removals)}</h3><p>{run['seconds']} s; {state}. "
                     f"The reference itself took {run['reference_cpu_s']} s of processor time.</p>")
        in_space = any("space_rms_rel" in p for p in points)
        head = ["", "CPU, ms/s", "haptic p99, µs", "peak, N", "RMS error, % of peak", "largest, %", "jump at swaps p95, %",
                "buzz, mN", "onset, ms", "overlap, µm", "memory, MB"]
        head += ["felt RMS, %", "felt largest, %"] if run["removals"] else []
        head += ["mesh error, %", "mesh and time, %"] if in_space else []
        rows = []
        for p in sorted(points, key=lambda p: p["cpu_ms_per_s"]):
            kind = ("chosen" if p["label"] == data["default"] else "" if p["reference_converged"] else "void")
            row = [p["label"] + (" ◂ front" if p["pareto"] else ""), f"{p['cpu_ms_per_s']:.0f}",
                   f"{p['haptic_us_p99']:.0f}", f"{p['force_peak_n']:.3g}", percent(p["force_rms_rel"]), percent(p["force_max_rel"], 1),
                   percent(p["swap_jump_p95_rel"]), f"{1e3 * p['buzz_rms_n']:.4f}", f"{p['onset_ms']:.0f}",
                   f"{p['penetration_um']:.2f}", f"{p['memory_mb']:.1f}"]
            if run["removals"]:
                row += [percent(p["felt_rms_rel"]), percent(p["felt_max_rel"], 1)]
            if in_space:
                row += [percent(p["space_rms_rel"]), percent(p["space_and_time_rms_rel"])] if "space_rms_rel" in p else ["", ""]
            rows.append((kind, row))
        if run["removals"]:
            parts.append("<p>The errors have the delay of a removal in them: an element that the simulation takes at the "
                         "begin of a step is felt to be gone 10 ms later. <i>Felt</i> are the errors against a reference "
                         "that loses it then.</p>")
        parts.append(table(head, rows))
    if data.get("notes"):
        parts.append("<h3>What a reader would wonder about</h3><ul>"
                     + "".join(f"<li>{text(n)}</li>" for n in data["notes"]) + "</ul>")
    if any(r["trajectory"].startswith("cataract_training") for r in data.get("runs", [])):
        parts.append('<p class="dim">Recordings cataract_training: B. Varga, M. Poncelet, Sensors 2025, 25(16), 5165, '
                     "doi 10.3390/s25165165, Apache-2.0.</p>")
    return "".join(parts)


def economy_details(data):
    rows = []
    for scene in data["scenes"]:
        for what in ("chosen", "whole"):
            m = scene[what]
            rows.append(("chosen" if what == "chosen" else "",
                         [f"{scene['scene']}: {m['model']}", percent(scene["accuracy"], 1), percent(m["error"]),
                          f"{m['cost_ms']:.2f}", "" if what == "whole" else "yes" if scene["passed"] else "no"]))
    return table(["", "asked for, %", "error, % of peak", "a step, ms", "passed"], rows)


def step_details(data):
    parts = sorted({part for p in data["points"] for part in p["parts_ms"]})
    rows = [("" if p["fits_50hz"] else "void",
             [f"{p['model']}, {p['compliance']}", p["nodes"], p["patch_nodes"], p["contacts"],
              f"{p['step_ms_median']:.2f}", f"{p['step_ms_p99']:.2f}"] + [f"{p['parts_ms'][k]:.2f}" for k in parts])
            for p in data["points"]]
    head = ["", "nodes", "patch", "contacts", "step p50, ms", "p99, ms"] + [k.replace("_", " ") + ", ms" for k in parts]
    text_of = "<p>Parts are means. Grey: more than 0.5 % of the steps took longer than 20 ms.</p>" + table(head, rows)
    if "tick" in data:
        t = data["tick"]
        text_of += (f"<p>A haptic tick with {t['contacts']} contacts of friction on {t['patch_nodes']} nodes: "
                    f"{t['us_median']:.0f} µs, p99 {t['us_p99']:.0f} µs.</p>")
    if "factor" in data:
        f = data["factor"]
        text_of += (f"<p>The factor of {f['nodes']} nodes: {f['own_ms']:.2f} ms, CHOLMOD {f['cholmod_ms']:.2f} ms, "
                    f"{f['cholmod_ms'] / f['own_ms']:.2f} times.</p>")
    return text_of


def cut_details(data):
    parts = []
    if data.get("steps"):
        parts.append(table(["steps that cut", "nodes", "compliance", "steps", "nodes added", "p50, ms", "p99, ms", "largest, ms"],
                           [("", ["a lens", s["nodes"], s["compliance"], s["steps_that_cut"], s["nodes_added"], s["step_ms"]["p50"],
                                  s["step_ms"]["p99"], s["step_ms"]["max"]]) for s in data["steps"]]))
    if data.get("beam"):
        parts.append(table(["a notched beam opens", "nodes", "load, mN", "of theory, mN", "times"],
                           [("", [f"{b['elements_across_arm']} elements across an arm", b["nodes"], f"{1e3 * b['load_n']:.3f}",
                                  f"{1e3 * b['theory_n']:.3f}", f"{b['load_n'] / b['theory_n']:.2f}"]) for b in data["beam"]]))
    return "".join(parts)


def pieces_details(data):
    parts = []
    if data.get("scenes"):
        rows = [("", [s["name"], s["steps"], s["step_ms"]["p50"], s["step_ms"]["p99"], s["capped"], s["overlap_um_max"],
                      s["tunnelled"], s["touches_max"], f"{s['third_law']:.0e}"]) for s in data["scenes"]]
        parts.append(table(["stirred", "steps", "step p50, ms", "p99, ms", "capped", "overlap, µm", "tunnelled", "touches",
                            "third law"], rows))
    if data.get("theory"):
        rows = [("" if c["passed"] else "chosen", [c["name"], f"{c['expected']:.6g}", f"{c['found']:.6g}",
                                                   f"{c['rel_error']:.1e}", f"{c['asked']:.0e}"])
                for c in data["theory"]]
        parts.append(table(["against theory", "expected", "found", "error", "asked"], rows))
    if data.get("haptic"):
        rows = [("", [f"{p['scene']}, {p['direction']}", f"{p['peak_mn']:.3f}", percent(p["rms_rel"]),
                      percent(p["max_rel"]), f"{p['active_before']} to {p['active_after']}"]) for p in data["haptic"]]
        parts.append(table(["pushed by 0.4 mm", "peak, mN", "RMS error, %", "largest, %", "touches that bear force"], rows))
    return "".join(parts)


def unpassed(name, data):
    """What of a chart's own bounds it did not keep, in words."""
    if name == "tissue":
        return [c["name"] for c in data.get("checks", []) if not c["passed"]]
    if name == "economy":
        return [f"plan of {s['scene']}" for s in data.get("scenes", []) if not s["passed"]]
    if name == "pieces":
        return [c["name"] for c in data.get("theory", []) if not c["passed"]]
    if name == "force":
        return [f"reference of {r['trajectory']} not converged" for r in data.get("runs", []) if not r["reference_converged"]]
    return []


def says(name, data):
    """The one figure of a chart that a reader looks for first."""
    if name == "force":
        errors = [p for p in data["points"] if p["label"] == data["default"]]
        return "; ".join(f"default errs by {percent(p['force_rms_rel'])} % of the peak at {p['cpu_ms_per_s']:.0f} ms/s"
                         + (f" ({p['trajectory']}, {p['removals']} removals per 20 ms)" if p["removals"] else f" ({p['trajectory']})")
                         for p in errors)
    if name == "tissue":
        checks = data.get("checks", [])
        return f"{sum(c['passed'] for c in checks)} of {len(checks)} known answers met"
    if name == "economy":
        scenes = data.get("scenes", [])
        return f"{sum(bool(s['passed']) for s in scenes)} of {len(scenes)} plans within the accuracy asked for"
    if name == "step":
        fits = [p for p in data["points"] if p["fits_50hz"]]
        return (f"50 Hz holds up to {max(p['nodes'] for p in fits)} nodes (" +
                text(max(fits, key=lambda p: p["nodes"])["compliance"]) + ")") if fits else "50 Hz holds for no lens here"
    if name == "pieces":
        theory = data.get("theory", [])
        return f"{sum(c['passed'] for c in theory)} of {len(theory)} answers of theory met" if theory else ""
    if name == "removal":
        return "; ".join(f"of {c['nodes']} nodes: the paper's updates cost more than {c['method']} after {c['lazy_dearer_after']:.0f} removals"
                         for c in data.get("crossings", []) if c["lazy_dearer_after"])
    if name == "cut":
        return "; ".join(f"of {s['nodes']} nodes: p50 {s['step_ms']['p50']:.1f}, p99 {s['step_ms']['p99']:.1f} ms of 20 in steps that cut"
                         for s in data.get("steps", []))
    if name == "warping":
        worst = {how: max((p["w_rel_error"] for p in data["points"] if (p["shape"], p["method"], p["warping"]) == ("turning", "zone", how)),
                          default=None) for how in ("none", "piece")}
        return (f"a body turned as a whole: off by {percent(worst['none'], 0)} % as it was made, {small(worst['piece'])} turned along"
                if None not in worst.values() else "")
    if name == "lcp":
        own = [p for p in data["points"] if p["solver"] == "hybrid"]
        return (f"the daemon's: p99 {max(p['us_p99'] for p in own):.0f} µs in the worst case of {len(own)}, "
                f"{sum(p['failures'] for p in own)} failed") if own else ""
    return ""


def figures_of(folder, name):
    file = folder / name / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else None


def verdicts(folder, charts):
    rows = []
    for c in charts:
        data = figures_of(folder, c["name"])
        faults = unpassed(c["name"], data) if data else []
        word = '<span class="bad">failed</span>' if c["exit_code"] != 0 else '<span class="bad">not all</span>' if faults else "made"
        found = says(c["name"], data) if data else ""
        found += ("; " if found and faults else "") + "; ".join(text(f) for f in faults[:5])
        rows.append(f'<tr><td><a href="#{text(c["name"])}">{text(SECTIONS.get(c["name"], (c["name"],))[0])}</a></td>'
                    f"<td>{word}</td><td>{found}</td></tr>")
    return '<table class="verdict">' + "".join(rows) + "</table>"


DETAILS = {"cut": cut_details, "pieces": pieces_details, "force": force_details, "economy": economy_details, "step": step_details}


def section(folder, entry):
    name = entry["name"]
    title, words = SECTIONS.get(name, (name, ""))
    parts = [f'<h2 id="{text(name)}">{text(title)}</h2>', f"<p>{words}</p>"]
    if entry["exit_code"] != 0:
        parts.append(f'<p class="bad">This chart failed (exit code {entry["exit_code"]}); what it left is below.</p>')
    parts += [picture(p) for p in sorted((folder / name).glob("*.png"))]
    figures = figures_of(folder, name)
    if figures and name in DETAILS:
        parts.append(DETAILS[name](figures))
    parts.append(f'<p class="dim"><code>haptic chart {text(name)}</code>, {entry["seconds"]} s. '
                 f"All figures: {text(name)}/{text(name)}.json.</p>")
    return "".join(parts)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    listing = pathlib.Path(sys.argv[1])
    data = json.loads(listing.read_text(encoding="utf-8"))
    charts = data["charts"]
    made = [machine(), f"{data['seconds']} s in all"]
    if "date" in data:
        made = [data["date"], made[0], f"load {data['load_before']} before and {data['load_after']} after", made[1]]
    quick = " Quick run: fewer cases than <code>haptic chart all</code> without <code>--quick</code>." if data["quick"] else ""
    body = (f"<h1>hapticd: speed against accuracy</h1>"
            f'<p class="dim">{text("; ".join(made))}.{quick}</p>'
            f"{verdicts(listing.parent, charts)}" + "".join(section(listing.parent, c) for c in charts))
    pathlib.Path(sys.argv[2]).write_text(page("hapticd: charts", body), encoding="utf-8")


if __name__ == "__main__":
    main()
