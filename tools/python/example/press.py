"""Presses 1.5 mm into the cube and plots the force: python3 press.py [DOMAIN of a running daemon]."""
import sys
import hapticd, numpy as np
from matplotlib import pyplot

z = np.concatenate([np.linspace(0.030, 0.0215, 1000), np.full(1000, 0.0215)])  # [m], a millisecond apart
motion = np.column_stack([0 * z, 0 * z, z])
if len(sys.argv) > 1:
    with hapticd.Device("touch", domain=int(sys.argv[1])) as device:
        felt = device.play(motion)
else:
    felt = hapticd.run("cube", motion)  # no daemon, no clock
print(f"{felt.force[:, 2].max():.4f} N")
pyplot.plot(1e-3 * np.arange(len(z)), felt.force)
pyplot.xlabel("s"), pyplot.ylabel("force on the hand, N"), pyplot.legend("xyz")
pyplot.savefig("press.png")
