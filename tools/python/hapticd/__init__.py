"""hapticd from Python: a device at 1 kHz, scenes without a daemon, recordings as arrays.

Device      a haptic device on a running daemon; its 1 kHz thread is in C
run         a scene played offline in virtual time: forces, contacts, surfaces
recording   a recording (CSV, rosbag2) as NumPy arrays
scenes      the scenes that are installed

Units: m, N, N·m, s; quaternions x, y, z, w; poses in the device's frame.
"""
from hapticd.device import Device, Error
from hapticd.files import recording, scene, scenes
from hapticd.offline import run

__all__ = ["Device", "Error", "recording", "run", "scene", "scenes"]
