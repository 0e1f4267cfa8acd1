"""Two network namespaces, the link between them, and the programs that run there (tests/network/run)."""
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import time

SIMULATION, EDGE = "10.214.0.1", "10.214.0.2"


class Skip(Exception):
    pass


def sh(*command):
    return subprocess.run([str(c) for c in command], check=True, capture_output=True, text=True).stdout


class Place:
    """Two namespaces, the link between them, and what runs there."""

    def __init__(self, binaries):
        self.bin = binaries
        self.names = [f"hapticd-{os.getpid()}-{side}" for side in ("sim", "edge")]
        self.link = None
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="hapticd-network-"))
        self.children = []

    def __enter__(self):
        try:
            for name in self.names:
                sh("ip", "netns", "add", name)
                sh("ip", "-n", name, "link", "set", "lo", "up")
        except (subprocess.CalledProcessError, FileNotFoundError) as error:
            self.__exit__()
            raise Skip(f"network namespaces are not permitted here ({error})")
        return self

    def __exit__(self, *_):
        self.end_all()
        self.unlink()
        for name in self.names:
            subprocess.run(["ip", "netns", "del", name], capture_output=True)
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self, side, log, *command):
        full = ["ip", "netns", "exec", self.names[side], *map(str, command)]
        with open(self.folder / log, "w") as out:
            child = subprocess.Popen(full, stdout=out, stderr=subprocess.STDOUT)
        self.children.append(child)
        return child

    def log(self, name):
        return (self.folder / name).read_text()

    def wait_for(self, log, text, seconds=30):
        for _ in range(int(20 * seconds)):
            if re.search(text, self.log(log)):
                return
            time.sleep(0.05)
        raise RuntimeError(f"no {text!r} in {log}:\n{self.log(log)}")

    def end(self, child, number=signal.SIGTERM):
        if child.poll() is None:
            child.send_signal(number)
            try:
                child.wait(15)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        if child in self.children:
            self.children.remove(child)

    def end_all(self):
        for child in list(self.children):
            self.end(child)

    def unlink(self):
        if self.link is not None and not isinstance(self.link, str):
            self.end(self.link)
        for name in self.names:
            subprocess.run(["ip", "-n", name, "link", "del", "link0"], capture_output=True)
        self.link = None

    def cable(self):
        """Nothing but a cable."""
        self.unlink()
        sim, edge = self.names
        sh("ip", "-n", sim, "link", "add", "link0", "type", "veth", "peer", "name", "link0", "netns", edge)

    def address(self):
        for name, address in zip(self.names, (SIMULATION, EDGE)):
            sh("ip", "-n", name, "addr", "add", f"{address}/24", "dev", "link0")
            sh("ip", "-n", name, "link", "set", "link0", "up")

    def connect(self, delay, jitter, loss):
        """By netem where the kernel has it, else by a program; returns which."""
        self.cable()
        sim, edge = self.names
        netem = ["netem", "limit", "20000", "delay", f"{delay}ms", f"{jitter}ms", "loss", f"{100 * loss}%"]
        tried = [subprocess.run(["tc", "-n", n, "qdisc", "add", "dev", "link0", "root", *netem], capture_output=True)
                 for n in self.names]
        by = "tc netem"
        if any(t.returncode for t in tried):
            self.unlink()
            if not os.path.exists("/dev/net/tun"):
                raise Skip("neither tc netem nor /dev/net/tun is there")
            by = "network_link"
            with open(self.folder / "link.log", "w") as out:
                self.link = subprocess.Popen([str(self.bin / "network_link"), sim, edge, "--delay", str(delay),
                                              "--jitter", str(jitter), "--loss", str(loss)],
                                             stdout=out, stderr=subprocess.STDOUT)
            self.wait_for("link.log", "ready", 5)
        self.address()
        return by
