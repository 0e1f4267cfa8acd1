"""What viewers cost the haptic loop: `haptic soak --attach` beside 0, 1, 2, 10 … of them, in rounds of turned order.

viewers.py BIN_DIR SOURCE_DIR DOMAIN [--viewers 0 2 10] [--rounds 6] [--seconds 15] [--anywhere]

One daemon on the cube, one `haptic view`, and a process that reads each viewer's WebSocket to the last frame. That
process keeps off the haptic thread's core, as a browser on another machine does; with --anywhere it may have it. Prints a
row for each run, then of each percentile the median over the rounds, its range, its ratio to none, and the share of pairs
in which a run with viewers read more than one without (one half is chance). A benchmark: run it with nothing else on the
machine.
"""
import argparse
import json
import os
import re
import selectors
import statistics
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from browser import WebSocket


def read(port, count):
    """Messages read from `count` viewers' sockets until stdin ends."""
    ready = selectors.DefaultSelector()
    ready.register(sys.stdin, selectors.EVENT_READ)
    for _ in range(count):
        viewer = WebSocket('127.0.0.1', port, '/live')
        viewer.messages = 0
        ready.register(viewer.socket, selectors.EVENT_READ, viewer)
    viewers = [key.data for key in ready.get_map().values() if key.data]
    while True:
        for key, _ in ready.select():
            if key.data is None:
                print(sum(viewer.messages for viewer in viewers))
                return
            take(key.data)


def take(viewer):
    """Whole frames out of what has come, thrown away; a ping is answered."""
    viewer.buffer += viewer.socket.recv(1 << 20)
    while len(viewer.buffer) >= 2:
        first, n, head = viewer.buffer[0], viewer.buffer[1] & 127, 2
        if n > 125:
            head = 4 if n == 126 else 10
            n = int.from_bytes(viewer.buffer[2:head], 'big')
        if len(viewer.buffer) < head + n:
            return
        viewer.buffer = viewer.buffer[head + n:]
        viewer.messages += 1
        if first & 15 == 9:
            viewer.socket.sendall(bytes([0x8a, 0x80, 0, 0, 0, 0]))


def run(options, viewers, scratch):
    tool = os.path.join(options.binaries, 'haptic')
    quiet = {'stdout': subprocess.DEVNULL, 'stderr': subprocess.DEVNULL}
    piped = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE, 'text': True}
    scene = os.path.join(options.source, 'config/scenes/cube/cube.yaml')
    daemon = subprocess.Popen([os.path.join(options.binaries, 'hapticd'), scene, '--domain', options.domain], **quiet)
    view = reader = None
    try:
        time.sleep(1.5)
        if viewers:
            view = subprocess.Popen([tool, 'view', '--port', '0', '--domain', options.domain], **piped)
            port = re.search(r':(\d+)/', view.stdout.readline()).group(1)
            reader = subprocess.Popen([sys.executable, __file__, '--read', port, str(viewers)], **piped)
            cores = sorted(os.sched_getaffinity(0))
            if len(cores) > 1 and not options.anywhere:
                os.sched_setaffinity(reader.pid, cores[:-1])
        time.sleep(1)
        figures = os.path.join(scratch, 'soak.json')
        subprocess.run([tool, 'soak', '--attach', '--domain', options.domain, '--duration', str(options.seconds), '--json',
                        figures], check=False, **quiet)
        with open(figures, encoding='utf-8') as text:
            soak = json.load(text)
        os.remove(figures)
        row = {f'{what} {q}': soak[key][q.replace('.', '_')]
               for what, key in (('wake', 'wake_us'), ('step', 'compute_us'), ('state age', 'state_age_us'))
               for q in ('p50', 'p99', 'p99.9')}
        row['cyclictest p99'] = soak['cyclictest_us']['p99']
        return row, int(reader.communicate('')[0]) if reader else 0
    finally:
        for process in (reader, view, daemon):
            if process and process.poll() is None:
                process.terminate()
                process.wait()


def share_larger(values, base):
    """Mann and Whitney's U over its largest value."""
    return sum((v > b) + 0.5 * (v == b) for v in values for b in base) / (len(values) * len(base))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('binaries')
    parser.add_argument('source')
    parser.add_argument('domain')
    parser.add_argument('--viewers', type=int, nargs='+', default=[0, 2, 10])
    parser.add_argument('--rounds', type=int, default=6)
    parser.add_argument('--seconds', type=float, default=15)
    parser.add_argument('--anywhere', action='store_true')
    options = parser.parse_args()
    rows = {n: [] for n in options.viewers}
    with tempfile.TemporaryDirectory() as scratch:
        for r in range(options.rounds):
            turn = r % len(options.viewers)
            for n in options.viewers[turn:] + options.viewers[:turn]:
                row, messages = run(options, n, scratch)
                rows[n].append(row)
                print(f'{n:3d} viewers, {messages:6d} messages:', ', '.join(f'{k} {v:.1f}' for k, v in row.items()), flush=True)
    none = options.viewers[0]
    for key in rows[none][0]:
        line = f'{key:15s}'
        base = [row[key] for row in rows[none]]
        for n in options.viewers:
            values = [row[key] for row in rows[n]]
            middle = statistics.median(values)
            line += f' | {n:2d}: {middle:6.1f} ({min(values):.1f}–{max(values):.1f})'
            if n != none:
                line += f' ×{middle / statistics.median(base):.2f}, {share_larger(values, base):.2f}'
        print(line)


if __name__ == '__main__':
    if sys.argv[1:2] == ['--read']:
        read(int(sys.argv[2]), int(sys.argv[3]))
    else:
        main()
