"""A scene without a daemon, in virtual time: `haptic replay --offline` as a process of its own, its files as arrays."""
import base64
import json
import os
import re
import shutil
import subprocess
import tempfile
import zlib
from dataclasses import dataclass, field

import numpy as np

from hapticd._client import Error
from hapticd.files import _above, scene as scene_file


@dataclass
class Frame:
    """The scene at one moment."""

    t: float  # [s] since the motion began
    contact_point: np.ndarray  # m × 3 [m], scene axes
    contact_force: np.ndarray  # m × 3 [N], on the tissue
    contact_gap: np.ndarray  # m [m]
    nodes: dict  # body → n × 3 [m], now
    tetrahedra: dict  # body → k × 4, living ones, indices into nodes


@dataclass
class Run:
    """What a motion met. Rows are a millisecond apart."""

    t: np.ndarray
    force: np.ndarray  # n × 3 [N], on the hand, device frame
    torque: np.ndarray  # n × 3 [N·m]
    status: np.ndarray  # n
    contacts: np.ndarray  # n, how many pressed
    penetration_um: np.ndarray  # n
    removed: np.ndarray  # n, tetrahedra so far
    summary: dict  # of haptic replay: peak force, elements removed, …
    frames: list = field(default_factory=list)  # 25 a second, where asked for


def haptic_program():
    found = os.environ.get("HAPTICD_PROGRAM") or _above("bin/haptic") or shutil.which("haptic")
    if not found:
        raise FileNotFoundError("the program haptic was not found: install the package hapticd, or set HAPTICD_PROGRAM")
    return str(found)


def run(scene, motion, buttons=None, frames=False, allow_refused=False):
    """Plays a motion to a scene as a device would, everything it feels included, and returns a Run.

    scene: a name ("cube") or a file. motion: n × 3 (x, y, z) or n × 7 rows a millisecond apart, device frame, or the
    path of a recording. frames: contacts and surfaces too. Two runs on one machine agree to the bit.
    Errors: hapticd.Error with what haptic said: states faster than the device's max_speed unless allow_refused.
    """
    with tempfile.TemporaryDirectory(prefix="hapticd-") as folder:
        played = motion if isinstance(motion, (str, os.PathLike)) else _write_motion(f"{folder}/motion.csv", motion, buttons)
        command = [haptic_program(), "replay", str(played), "--offline", "--scene", str(scene_file(scene)),
                   "--forces", f"{folder}/forces.csv", "--json", f"{folder}/summary.json"]
        command += ["--vtk", f"{folder}/vtk"] if frames else []
        command += ["--allow-refused"] if allow_refused else []
        ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        if ended.returncode != 0:
            raise Error(ended.stderr.strip() or f"haptic ended with {ended.returncode}")
        with open(f"{folder}/summary.json", encoding="utf-8") as file:
            summary = json.load(file)
        return _read_forces(f"{folder}/forces.csv", summary, _read_frames(f"{folder}/vtk") if frames else [])


def _write_motion(path, motion, buttons):
    motion = np.asarray(motion, float)
    if motion.ndim != 2 or motion.shape[1] not in (3, 7) or len(motion) < 2:
        raise Error("a motion is an array of n ≥ 2 rows, a millisecond apart: x, y, z in metres, or with qx, qy, qz, qw")
    buttons = np.zeros(len(motion), int) if buttons is None else np.asarray(buttons, int)
    names = "t,px,py,pz" + (",qx,qy,qz,qw" if motion.shape[1] == 7 else "") + ",buttons"
    rows = np.column_stack([1e-3 * np.arange(len(motion)), motion, buttons])
    np.savetxt(path, rows, ["%.3f"] + ["%.17g"] * motion.shape[1] + ["%d"], ",", header=names, comments="")
    return path


def _read_forces(path, summary, frames):
    with open(path, encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        rows = np.loadtxt(file, delimiter=",", ndmin=2)

    def columns(*wanted):
        found = rows[:, [names.index(name) for name in wanted]]
        return found if len(wanted) > 1 else found[:, 0]

    return Run(columns("t"), columns("fx", "fy", "fz"), columns("tx", "ty", "tz"), columns("status").astype(np.uint32),
               columns("active").astype(int), columns("penetration_um"), columns("removed").astype(int), summary, frames)


def _array(text, name):
    """An array of a VTK file: four numbers that say how long, and what zlib made of it, each in base64."""
    found = re.search(rf'<DataArray type="(\w+)" Name="{name}" NumberOfComponents="(\d+)" format="binary">([^<]*)<', text)
    if not found:
        return None
    kind = {"Float32": "<f4", "Int32": "<i4", "UInt8": "u1"}[found[1]]
    packed = found[3][24:]  # before it 16 bytes: blocks (one, or none), their size, the last's, as packed
    values = np.frombuffer(zlib.decompress(base64.b64decode(packed)) if packed else b"", kind)
    return values.reshape(-1, int(found[2])) if int(found[2]) > 1 else values


def _read_frames(folder):
    frames = {}
    with open(f"{folder}/scene.pvd", encoding="utf-8") as file:
        parts = re.findall(r'timestep="([^"]+)"[^>]*file="([^"]+)"', file.read())
    for t, name in parts:
        frame = frames.setdefault(float(t), Frame(float(t), None, None, None, {}, {}))
        if "_removed_" in name or name.startswith("instrument_"):
            continue
        with open(f"{folder}/{name}", encoding="latin-1") as file:
            text = file.read()
        points = _array(text, "Points")
        if name.startswith("contact_"):
            touches = _array(text, "kind") == 1
            frame.contact_point = points[touches]
            frame.contact_force = _array(text, "force").reshape(-1, 3)[touches]
            frame.contact_gap = _array(text, "gap")[touches]
        else:
            body = re.sub(r"(_\d+)?\.vtu$", "", name)
            frame.nodes[body] = points
            frame.tetrahedra[body] = _array(text, "connectivity").reshape(-1, 4)
    return [frames[t] for t in sorted(frames)]
