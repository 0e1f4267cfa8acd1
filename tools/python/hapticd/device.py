"""A haptic device on a running daemon, over the C library (haptic_client.h)."""
from dataclasses import dataclass

import numpy as np

from hapticd import _client
from hapticd._client import Error


@dataclass
class Played:
    """What came back for each row of a motion."""

    force: np.ndarray  # n × 3 [N], on the hand; zero where nothing was sent
    torque: np.ndarray  # n × 3 [N·m]
    status: np.ndarray  # n, bits of idl/README.md; 0: all well
    sent: np.ndarray  # n, False for a slot that the machine slept through
    on_time: np.ndarray  # n, answered within its own millisecond: `force` is that answer, else the newest before
    answered_of_sent: float  # share of the states that were answered, late ones too

    @property
    def answered_share(self):
        """Of all rows."""
        return self.answered_of_sent * float(self.sent.mean())


class Device:
    """A client of the daemon: `with hapticd.Device("touch") as device:`.

    device: whose limits hold, a name of config/devices or a file. keys: folder of keys of a daemon with --secure.
    station: the daemon's --station.
    Errors: hapticd.Error, which says what to do. Threads: one at a time; the library's own sends at 1 kHz.
    """

    def __init__(self, device, domain=0, device_id=0, keys=None, open_network=False, realtime=True, station=None):
        self._client = _client.Device(str(device), domain, device_id, str(keys or ""), open_network, realtime,
                                      str(station or ""))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Lets go: the device is at zero and the daemon free for another client."""
        self._client.close()

    def set_pose(self, pose, buttons=0, enable=True):
        """The pose that is sent from now on: (x, y, z) or with (qx, qy, qz, qw). After 100 ms without a new one no
        force is asked for."""
        self._client.set_pose(pose, buttons, enable)

    @property
    def force(self):
        """The newest force on the hand [N]; zero where `state` says that something is wrong."""
        return self._client.force()[0]

    @property
    def torque(self):
        return self._client.force()[1]

    @property
    def status(self):
        return self._client.force()[2]

    @property
    def state(self):
        """Counts (sent, answered, …), `result` (haptic_client.h) and its `meaning`."""
        return self._client.state()

    def play(self, motion, buttons=None, arm_timeout=10.0):
        """Plays a motion, n rows a millisecond apart, once the daemon renders; returns what came back for each."""
        buttons = np.zeros(0, np.uint32) if buttons is None else buttons
        return Played(**self._client.play(motion, buttons, arm_timeout))
