#!/usr/bin/python3
"""The Python package against a build: package_test.py BUILD_DIR. Daemons are processes on DDS domains of this test."""
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import threading
import time
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[3]
BUILD = pathlib.Path(sys.argv.pop() if len(sys.argv) > 1 else SOURCE / "build/release").resolve()
sys.path.insert(0, str(BUILD / "lib/python"))
os.environ.update(HAPTICD_CONFIG_DIR=str(SOURCE / "config"), HAPTICD_PROGRAM=str(BUILD / "bin/haptic"),
                  PYTHONPATH=str(BUILD / "lib/python"))

import numpy as np

import hapticd

DOMAIN = 110 + os.getpid() % 50
REALTIME = subprocess.run(["chrt", "-f", "50", "true"], stderr=subprocess.DEVNULL, check=False).returncode == 0
CUBE = SOURCE / "config/scenes/cube/cube.yaml"


def press(hold):
    """Down to the cube in a second, 1.5 mm into it, and held there for so many milliseconds."""
    z = np.concatenate([np.linspace(0.030, 0.0215, 1000), np.full(hold, 0.0215)])
    return np.column_stack([0 * z, 0 * z, z])


class Daemon:
    def __init__(self, *options):
        self.process = subprocess.Popen([BUILD / "bin/hapticd", CUBE, "--domain", str(DOMAIN), "--log", "json", *options],
                                        stderr=subprocess.PIPE, text=True)
        for line in self.process.stderr:
            if '"ready"' in line:
                break
        self.reader = threading.Thread(target=self.process.stderr.read)
        self.reader.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(10)
        self.reader.join()
        self.process.stderr.close()


class Offline(unittest.TestCase):
    def test_a_press_has_the_force_of_the_scene_and_two_runs_are_the_same(self):
        first, second = (hapticd.run("cube", press(200), frames=frames) for frames in (False, True))
        self.assertEqual(len(first.force), 1200)
        self.assertGreater(first.force[-1, 2], 0.02)
        self.assertLess(abs(first.force[-1, :2]).max(), 0.2 * first.force[-1, 2])  # the mesh has no symmetry
        self.assertTrue((first.force == second.force).all())
        self.assertGreater(first.contacts[-1], 0)
        frame = second.frames[-1]
        self.assertEqual(frame.contact_force.shape, frame.contact_point.shape)
        # The scene's own force is the device's by mapping.force_scale; the cube's is 1.
        self.assertAlmostEqual(-frame.contact_force.sum(0)[2], first.force[-1, 2], delta=0.02 * first.force[-1, 2])
        self.assertEqual(frame.nodes["cube"].shape[1], 3)
        self.assertLess(frame.tetrahedra["cube"].max(), len(frame.nodes["cube"]))

    def test_a_wrong_motion_or_scene_is_said(self):
        with self.assertRaisesRegex(hapticd.Error, "n ≥ 2 rows"):
            hapticd.run("cube", np.zeros(3))
        with self.assertRaisesRegex(FileNotFoundError, "no scene 'cub'; there are .*cube"):
            hapticd.run("cub", press(10))
        with self.assertRaisesRegex(hapticd.Error, "max_speed|faster"):
            hapticd.run("cube", np.array([[0, 0, 0.03], [0, 0, 0.04], [0, 0, 0.03]]))

    def test_the_readmes_ten_lines_and_the_example_run_as_they_stand(self):
        text = (SOURCE / "tools/python/README.md").read_text(encoding="utf-8")
        lines = re.search(r"```python\n(.*?)```", text, re.S)[1]
        self.assertLessEqual(len(lines.splitlines()), 10)
        for program in (["-c", lines], [str(SOURCE / "tools/python/example/press.py")]):
            with tempfile.TemporaryDirectory() as folder:
                ran = subprocess.run([sys.executable, *program], cwd=folder, capture_output=True, text=True, check=False)
                self.assertEqual(ran.returncode, 0, ran.stderr)
                self.assertRegex(ran.stdout, r"^0\.\d{4} N$")
                self.assertTrue((pathlib.Path(folder) / "press.png").exists())


class Recordings(unittest.TestCase):
    def test_a_csv_and_a_bag_of_one_run_have_the_same_rows(self):
        with tempfile.TemporaryDirectory() as folder:
            with Daemon("--record", f"{folder}/run"), hapticd.Device("touch", domain=DOMAIN) as device:
                played = device.play(press(500), np.full(1500, 3, np.uint32))
            bag = hapticd.recording(f"{folder}/run")
        pressed = bag.position[:, 2] < 0.02151
        self.assertGreater(pressed.sum(), 300)
        self.assertTrue((bag.buttons[pressed][10:300] == 3).all())
        self.assertAlmostEqual(bag.force[pressed][250, 2], played.force[-1, 2], delta=0.1 * played.force[-1, 2])
        csv = hapticd.recording(SOURCE / "config/scenes/cube/press.csv")
        self.assertEqual(csv.pose.shape, (len(csv.t), 7))
        with self.assertRaisesRegex(ValueError, "needs the columns"):
            hapticd.recording(SOURCE / "config/scenes/cube/cube.yaml")


class Devices(unittest.TestCase):
    def test_a_motion_is_answered_and_felt_as_offline(self):
        with Daemon(), hapticd.Device("touch", domain=DOMAIN) as device:
            played = device.play(press(9000))
            state = device.state
        print(f"{len(played.sent)} slots, {played.sent.sum()} sent, {played.on_time.sum()} answered on time, {100 * played.answered_share:.2f} % at all; state {state}")
        self.assertGreater(played.answered_share, 0.9 if REALTIME else 0.5)
        offline = hapticd.run("cube", press(1000))
        self.assertAlmostEqual(played.force[-1, 2], offline.force[-1, 2], delta=0.02 * offline.force[-1, 2])

    def test_poses_at_ones_own_pace_and_zero_without_them(self):
        with Daemon(), hapticd.Device("touch", domain=DOMAIN) as device:
            for z in np.linspace(0.030, 0.0215, 100):
                device.set_pose((0, 0, z))
                time.sleep(0.02)
            self.assertGreater(device.force[2], 0.02)
            time.sleep(0.4)
            self.assertEqual(abs(device.force).max(), 0)
            with self.assertRaisesRegex(hapticd.Error, "unit quaternion"):
                device.set_pose((0, 0, 0, 0, 0, 0, 0))
            with self.assertRaisesRegex(hapticd.Error, "a pose is"):
                device.set_pose((0, 0))

    def test_no_daemon_is_an_error_that_names_the_domain(self):
        with hapticd.Device("touch", domain=DOMAIN) as device:
            device.set_pose((0, 0, 0.03))
            time.sleep(0.2)
            self.assertRegex(device.state["meaning"], f"no daemon answered.*domain {DOMAIN}")
            with self.assertRaisesRegex(hapticd.Error, "no daemon answered"):
                device.play(press(100), arm_timeout=0.3)
        with self.assertRaisesRegex(hapticd.Error, "closed"):
            device.set_pose((0, 0, 0))
        with self.assertRaisesRegex(hapticd.Error, "tuch"):
            hapticd.Device("tuch")


if __name__ == "__main__":
    unittest.main(verbosity=2)
