"""Many stations on one network, and `haptic fleet --page` that looks at them from the other end of a cable.

Some are whole daemons; the others (`station_emulator`) are the daemon's publishing thread alone, for thirty loops do not
fit into two cores. fleet.py URL, run where the page is, prints what the page is told: {"t", "station", "state"} a line.
"""
import json
import os
import pathlib
import re
import signal
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
TICK = os.sysconf("SC_CLK_TCK")
STATIONS, REAL, KILLED = 30, 3, 6
SECONDS = 20


def busy(process):
    """Seconds of processor so far."""
    after = pathlib.Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(after[11]) + int(after[12])) / TICK


def shares(processes, seconds=SECONDS):
    """Of one core each, over that time."""
    begun, before = time.monotonic(), [busy(p) for p in processes]
    time.sleep(seconds)
    spent = time.monotonic() - begun
    return [(busy(p) - b) / spent for p, b in zip(processes, before)]


class Watcher:
    """What a page is told, as it comes."""

    def __init__(self, place, url):
        self.place = place
        self.child = place.start(1, "watch.log", sys.executable, pathlib.Path(__file__).resolve(), url)

    def lines(self):
        return [json.loads(line) for line in self.place.log("watch.log").splitlines() if line.endswith("}")]

    def await_state(self, station, state, since, seconds):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for line in self.lines():
                if line["t"] >= since and line["station"] == station and line["state"] == state:
                    return line["t"] - since
            time.sleep(0.02)
        return None


def fleet(place, scene, stations=STATIONS, real=REAL):
    place.cable()
    place.address()
    names = [f"bench{i + 1:02}" for i in range(stations)]
    running = {}
    for i, name in enumerate(names):
        at = ["--station", name, "--domain", 1, "--interface", "link0"]
        if i < real:
            running[name] = place.start(0, f"{name}.log", place.bin / "hapticd", scene, *at, "--open-network", "--log", "json")
        else:
            running[name] = place.start(0, f"{name}.log", place.bin / "station_emulator", *at)
    for i, name in enumerate(names):
        place.wait_for(f"{name}.log", '"event":"ready"' if i < real else "ready")
    time.sleep(5)
    alone = shares([running[n] for n in names])
    page = place.start(1, "fleet.log", place.bin / "haptic", "--interface", "link0", "--open-network", "fleet", "--page",
                       "--port", 0, "--domain", 1)
    place.wait_for("fleet.log", r"http://\S+")
    url = re.search(r"http://\S+", place.log("fleet.log")).group(0)
    time.sleep(5)
    unseen = shares([page])[0]
    watcher = Watcher(place, url)
    time.sleep(3)
    seen = shares([page, *[running[n] for n in names]])
    heard = {line["station"] for line in watcher.lines()}

    lost = []
    for i in range(KILLED):  # daemons and emulated ones in turn
        name = names[i // 2 if i % 2 == 0 and i // 2 < real else real + i]
        since = time.monotonic()
        place.end(running.pop(name), signal.SIGKILL)
        lost.append(watcher.await_state(name, "lost", since, 5))
    place.end_all()
    share = sum(seen[1:1 + real]) / real
    return {"stations": len(heard), "daemons": real, "emulated": stations - real,
            "cpu_share_per_station": seen[0] / stations, "cpu_share_per_station_unseen": unseen / stations,
            "loss_seen_s": max((x if x is not None else 99.0 for x in lost), default=99.0), "losses_s": lost,
            "daemon_cpu_share": share, "daemon_cpu_share_without_fleet": sum(alone[:real]) / real,
            "held": len(heard) == stations and seen[0] / stations <= 0.01 and all(x is not None and x <= 1 for x in lost)}


def watch(url):
    sys.path.insert(0, str(HERE.parent / "tools/view"))
    from browser import WebSocket
    host, port = re.match(r"http://([^:/]+):(\d+)/", url).groups()
    socket, states = WebSocket(host, int(port), "/live"), {}
    while True:
        said = json.loads(socket.receive())
        if said["kind"] != "station" or states.get(said["station"]) == said["state"]:
            continue
        states[said["station"]] = said["state"]
        print(json.dumps({"t": time.monotonic(), "station": said["station"], "state": said["state"]}), flush=True)


if __name__ == "__main__":
    watch(sys.argv[1])
