"""Scenes and recordings: where they lie, and what is in them, as NumPy arrays."""
import glob
import os
import pathlib
import sqlite3
import struct
from dataclasses import dataclass

import numpy as np


def _above(relative):
    """The nearest such file above this package: an installed tree has it, and so has a build."""
    for folder in pathlib.Path(__file__).absolute().parents:
        if (folder / relative).exists():
            return folder / relative
    return None


def config_directory():
    set_by_user = os.environ.get("HAPTICD_CONFIG_DIR")
    found = pathlib.Path(set_by_user) if set_by_user else _above("share/hapticd")
    if not found:
        raise FileNotFoundError("hapticd's configuration was not found: install the package hapticd, or set HAPTICD_CONFIG_DIR")
    return found


def scenes():
    """The installed scenes by name: {"cube": path, …}."""
    return {path.stem if path.stem != path.parent.name else path.parent.name: path
            for path in sorted(config_directory().glob("scenes/*/*.yaml"))}


def scene(name_or_path):
    """A scene's file by name ("cube"), or by path (anything with a slash or an extension)."""
    given = pathlib.Path(name_or_path)
    if given.suffix or len(given.parts) > 1:
        return given
    known = scenes()
    if str(name_or_path) not in known:
        raise FileNotFoundError(f"no scene {name_or_path!r}; there are {', '.join(known)}")
    return known[str(name_or_path)]


@dataclass
class Recording:
    """Rows of a recording. Arrays have n rows; what a file does not hold is empty."""

    t: np.ndarray  # [s], from the first row on
    position: np.ndarray  # n × 3 [m]
    orientation: np.ndarray  # n × 4, x, y, z, w
    buttons: np.ndarray  # n; bit 0: phaco, bit 1: aspiration
    force: np.ndarray  # n × 3 [N]
    torque: np.ndarray  # n × 3 [N·m]

    @property
    def pose(self):
        """n × 7: what Device.play and run take, if the rows are a millisecond apart."""
        return np.hstack([self.position, self.orientation])


def recording(path):
    """A recording: a CSV (t, px, py, pz, …; forces.csv too), or a rosbag2 folder of `--record`."""
    return _bag(path) if os.path.isdir(path) else _csv(path)


def _csv(path):
    with open(path, encoding="utf-8") as file:
        lines = [line for line in file if line.strip() and not line.startswith("#")]
    names = [name.strip() for name in lines[0].split(",")]
    if not {"t", "px", "py", "pz"} <= set(names):
        raise ValueError(f"{path}:1: no recording: it needs the columns t, px, py, pz and has {', '.join(names)}")
    rows = np.array([[float(v) for v in line.split(",")] for line in lines[1:]]).reshape(-1, len(names))

    def columns(wanted):
        return rows[:, [names.index(n) for n in wanted]] if set(wanted) <= set(names) else np.zeros((0, len(wanted)))

    orientation = columns(["qx", "qy", "qz", "qw"])
    if len(orientation) == 0:
        orientation = np.tile([0.0, 0, 0, 1], (len(rows), 1))
    buttons = columns(["buttons"])
    return Recording(rows[:, names.index("t")] - (rows[0, names.index("t")] if len(rows) else 0),
                     columns(["px", "py", "pz"]), orientation, buttons[:, 0].astype(np.uint32),
                     columns(["fx", "fy", "fz"]), columns(["tx", "ty", "tz"]))


def _payload(data):
    """Where a stamped message's content begins: after four bytes of CDR, the stamp and the frame, to eight bytes."""
    if data[:2] != b"\x00\x01":
        raise ValueError("not little-endian CDR")
    length = struct.unpack_from("<I", data, 12)[0]
    return 4 + (12 + length + 7) // 8 * 8


def _bag(folder):
    files = sorted(glob.glob(os.path.join(folder, "*.db3")))
    if not files:
        raise FileNotFoundError(f"{folder}: no rosbag2 recording with sqlite3 storage (*.db3) in it")
    database = sqlite3.connect(f"file:{files[0]}?mode=ro", uri=True)
    topics = {name: (number, kind) for number, name, kind in database.execute("SELECT id, name, type FROM topics")}
    poses = [name for name, (_, kind) in topics.items() if kind == "geometry_msgs/msg/PoseStamped"]
    if not poses:
        raise ValueError(f"{folder}: no topic of geometry_msgs/msg/PoseStamped")

    def messages(topic):
        rows = database.execute("SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp",
                                (topics[topic][0],)) if topic in topics else []
        return {time: data for time, data in rows}

    pose = {time: struct.unpack_from("<7d", data, _payload(data)) for time, data in messages(poses[0]).items()}
    wrench = {time: struct.unpack_from("<6d", data, _payload(data))
              for time, data in messages(poses[0].replace("/pose", "/wrench")).items()}
    pressed = {time: _pedals(data) for time, data in messages(poses[0].replace("/pose", "/buttons")).items()}
    times = sorted(pose)
    # The pedals are written when they change.
    changes = np.array(sorted(pressed), np.int64)
    states = np.array([0] + [pressed[t] for t in changes], np.uint32)
    rows = np.array([pose[t] for t in times]).reshape(-1, 7)
    felt = np.array([wrench.get(t, (np.nan,) * 6) for t in times]).reshape(-1, 6)
    return Recording(1e-9 * (np.array(times, np.int64) - (times[0] if times else 0)), rows[:, :3], rows[:, 3:],
                     states[np.searchsorted(changes, times, "right")], felt[:, :3], felt[:, 3:])


def _pedals(data):
    """A Joy's buttons as bits; its floats and buttons have four bytes each."""
    length = struct.unpack_from("<I", data, 12)[0]
    at = 4 + (12 + length + 3) // 4 * 4
    axes = struct.unpack_from("<I", data, at)[0]
    at += 4 + 4 * axes
    count = struct.unpack_from("<I", data, at)[0]
    pressed = struct.unpack_from(f"<{count}i", data, at + 4)
    return sum(1 << k for k, down in enumerate(pressed) if down)
