#!/usr/bin/python3
"""Merges DIR/daemon.json and DIR/replay.json into DIR/summary.json, prints it, and judges it.

Exit code 0 if every figure is what it should be, 1 with the failing ones named, 2 if a file is missing or
lacks a figure. Slots are the client's: scheduled, sent, answered. Everything else that both know is the
daemon's, but for the peak force, which is the one the device received.

A virtual machine stands still for milliseconds now and then, and what is lost then is no fault of the program:
rate and answers are judged between the stalls that bare timer threads saw on either core (haptic replay
--watch-machine). What the clock on the wall says stays in haptic_rate_hz and slots_answered.
Example: tools/plot/demo_summary.py build/demo
"""
import argparse
import json
import os
import pathlib
import platform
import sys

LIMITS = (
    ("haptic_rate_between_stalls_hz", 999.0, "Hz"),
    ("sim_rate_hz", 49.0, "Hz"),
    ("elements_removed", 50, "elements"),
    ("answered_between_stalls", 0.99, "of the slots"),
)
OPERATED = (  # of a scene with two hands, besides
    ("pieces_max", 4, "pieces"),
    ("volume_gone_share", 0.9, "of the volume"),
)
TARGETS = (  # of such a scene: named where they are not kept, but no failure
    ("overlap_um_max", 20, "µm"),
    ("solver_cap_share", 0.01, "of the ticks"),
    ("sim_step_ms p99", 20, "ms"),
)
STALLED = 0.05  # of the time: beyond it the machine is no place to judge anything on


def machine():
    model = platform.processor() or platform.machine()
    try:
        for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                model = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass
    return {"processor": model, "cores": os.cpu_count(), "kernel": platform.release()}


def only(values, keys):
    return {key: values[key] for key in keys}


def rate_between_stalls(daemon, stalls):
    """Ticks over the time that the haptic thread's core ran; at most 1 kHz, as a tick late in a stall is run after it."""
    elapsed_ms = daemon["slots_scheduled"]
    return min(1e3, 1e3 * daemon["slots_sent"] / max(elapsed_ms - stalls["last_core_ms"], 1))


def of_all_hands(replay):
    """One hand's figures, or of several the worst answers and round trips, the largest force, and all slots."""
    hands = replay.get("devices")
    if not hands:
        return replay
    worst = min(hands, key=lambda hand: hand["answered_between_stalls"])
    return {
        **worst,
        "force_peak_n": max(hand["force_peak_n"] for hand in hands),
        **{key: sum(hand[key] for hand in hands) for key in ("slots_scheduled", "slots_sent", "slots_answered")},
        "status_seen_text": ", ".join(dict.fromkeys(
            word for hand in hands for word in hand["status_seen_text"].split(", "))),
        "hands": [only(hand, ("instrument", "force_peak_n", "answered_between_stalls", "contact_share"))
                  for hand in hands],
    }


def operation(daemon, felt):
    """What a trainer asks, of the body that lost most."""
    measures = daemon["operation"]
    hands = [{**hand, **of} for hand, of in zip(measures["hands"], felt or [{}] * len(measures["hands"]))]
    soft = [body for body in measures["bodies"] if "volume_gone_share" in body]
    most = max(soft, key=lambda body: body["volume_gone_mm3"])
    return {
        "hands": hands,
        "pieces_max": most["pieces_most"],
        "volume_gone_share": most["volume_gone_share"],
        "pieces_left_loose": sum(body["pieces_loose"] for body in soft),
        "crumbs_left": most["crumbs"],
        "bodies": measures["bodies"],
        "capsule_ruptures": sum(event["what"] == "rupture" and event["who"] == "capsule" for event in measures.get("events", [])),
        "events": measures.get("events", []),
    }


def merge(daemon, replay):
    replay = of_all_hands(replay)
    quantiles = ("p50", "p99", "p99_9", "max")
    return {
        "haptic_rate_hz": daemon["haptic_rate_hz"],
        "haptic_rate_between_stalls_hz": rate_between_stalls(daemon, replay["machine_stalls"]),
        "machine_stalls": replay["machine_stalls"],
        "haptic_deadline_misses": daemon["haptic_deadline_misses"],
        "sim_rate_hz": daemon["sim_rate_hz"],
        "sim_step_ms": only(daemon["sim_step_ms"], ("p50", "p99", "max")),
        "solve_us": only(daemon["solve_us"], quantiles),
        "wake_us": only(daemon["wake_us"], quantiles),
        "elements_removed": daemon["elements_removed"],
        "fragments_aspirated": daemon["fragments_aspirated"],
        **operation(daemon, replay.get("hands")),
        "solver_cap_share": daemon["solver_caps"] / max(daemon["slots_sent"], 1),
        "force_peak_n": replay["force_peak_n"],
        "penetration_max_um": daemon["penetration_max_um"],
        "overlap_um_max": daemon["penetration_max_um"],
        "slots_scheduled": replay["slots_scheduled"],
        "slots_sent": replay["slots_sent"],
        "slots_answered": replay["slots_answered"],
        "answered_between_stalls": replay["answered_between_stalls"],
        "rtt_us": only(replay["rtt_us"], quantiles),
        "state_age_us": only(replay["state_age_us"], quantiles),
        "contact_share": replay["contact_share"],
        "status_seen": replay["status_seen_text"],
        "scene": daemon["scene"],
        "duration_s": replay["duration_s"],
        "machine": machine(),
    }


def failures(summary):
    limits = LIMITS + (OPERATED if len(summary["hands"]) > 1 else ())
    found = [f"{key} is {summary[key]:.6g} {unit}, at least {least:g} is asked for"
             for key, least, unit in limits if not summary[key] >= least]
    if len(summary["hands"]) > 1:
        found += [f"{key} is {summary[key]}: none is asked for"
                  for key in ("pieces_left_loose", "capsule_ruptures") if summary[key] > 0]
    stalled = 1e-3 * summary["machine_stalls"]["total_ms"] / summary["duration_s"]
    if stalled > STALLED:
        found.append(f"the machine stood still for {stalled:.1%} of the time: judge it on a quieter one")
    return found


def not_kept(summary):
    if len(summary["hands"]) < 2:
        return []
    figures = summary | {"sim_step_ms p99": summary["sim_step_ms"]["p99"]}
    return [f"not kept: {key} is {figures[key]:.4g} {unit}, at most {most:g} is aimed at"
            for key, most, unit in TARGETS if not figures[key] <= most]


def text(value):
    if isinstance(value, dict):
        return ", ".join(f"{key} {text(part)}" for key, part in value.items())
    if isinstance(value, list):
        return "; ".join(map(text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=pathlib.Path)
    directory = parser.parse_args().directory
    try:
        daemon = json.loads((directory / "daemon.json").read_text())
        replay = json.loads((directory / "replay.json").read_text())
        summary = merge(daemon, replay)
    except (OSError, ValueError) as error:
        print(f"demo_summary.py: {error}", file=sys.stderr)
        return 2
    except KeyError as error:
        print(f"demo_summary.py: {directory}: no figure {error}", file=sys.stderr)
        return 2
    (directory / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    width = max(map(len, summary))
    for key, value in summary.items():
        print(f"  {key:<{width}}  {f'{len(value)}' if key == 'events' else text(value)}")
    found = failures(summary)
    stalls = summary["machine_stalls"]
    if stalls["count"] > 0:
        print(f"demo: the machine itself stood still {stalls['count']} times, {stalls['total_ms']:.0f} ms in all and "
              f"{stalls['longest_ms']:.1f} ms at most; rate and answers are judged between these stalls")
    missed = not_kept(summary)
    for reason in found + missed:
        print(f"demo: {reason}", file=sys.stderr)
    verdict = "failed" if found else "as it should be, but for what is not kept" if missed else "all as it should be"
    print(f"demo: {verdict}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
