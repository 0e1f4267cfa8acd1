"""A headless Chromium driven over its DevTools protocol: the standard library alone."""
import base64
import json
import os
import shutil
import socket
import struct
import subprocess
import tempfile
import time
import urllib.request
import zlib


class WebSocket:
    """A client's end of RFC 6455, text alone."""

    def __init__(self, host, port, path):
        self.socket = socket.create_connection((host, port), timeout=30)
        self.buffer = b''
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f'GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
                             f'Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n').encode())
        while b'\r\n\r\n' not in self.buffer:
            self.buffer += self.socket.recv(65536)
        head, self.buffer = self.buffer.split(b'\r\n\r\n', 1)
        if b' 101 ' not in head.split(b'\r\n')[0]:
            raise RuntimeError(head.decode())

    def send(self, text, kind=1):
        data, mask = text.encode() if isinstance(text, str) else text, os.urandom(4)
        n = len(data)
        head = bytes([0x80 | kind]) + (bytes([0x80 | n]) if n < 126 else bytes([0x80 | 126]) + struct.pack('>H', n) if n < 65536
                                else bytes([0x80 | 127]) + struct.pack('>Q', n))
        self.socket.sendall(head + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(data)))

    def _read(self, n):
        while len(self.buffer) < n:
            more = self.socket.recv(1 << 20)
            if not more:
                raise ConnectionError('closed')
            self.buffer += more
        out, self.buffer = self.buffer[:n], self.buffer[n:]
        return out

    def receive(self):
        text = b''
        while True:
            first, second = self._read(2)
            n = second & 0x7f
            if n == 126:
                n = struct.unpack('>H', self._read(2))[0]
            elif n == 127:
                n = struct.unpack('>Q', self._read(8))[0]
            data = self._read(n)
            if first & 0x0f == 8:
                raise ConnectionError('closed')
            if first & 0x0f == 9:  # asked whether it lives
                self.send(data, 10)
            if first & 0x0f in (0, 1):
                text += data
                if first & 0x80:
                    return text.decode()


class Browser:
    """One page of 1280 × 720 pixels."""

    def __init__(self, program, dark=False):
        self.home = tempfile.mkdtemp(prefix='haptic-view-')
        self.process = subprocess.Popen(
            [program, '--headless=new', '--no-sandbox', '--disable-gpu', '--use-angle=swiftshader',
             '--enable-unsafe-swiftshader', '--disable-quic', '--no-first-run', '--disable-background-networking',
             '--disable-component-update', '--disable-sync', '--hide-scrollbars', '--window-size=1280,720',
             '--remote-debugging-port=0', f'--user-data-dir={self.home}', 'about:blank'],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        chosen = os.path.join(self.home, 'DevToolsActivePort')
        wait_for(lambda: os.path.exists(chosen) and len(open(chosen).read().split()) == 2, 30, 'the browser')
        port, path = open(chosen).read().split()
        self.port = int(port)
        self.socket = WebSocket('127.0.0.1', self.port, path)
        self.number = 0
        self.errors = []
        self.session = None
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        self.session = self.call('Target.attachToTarget', targetId=target, flatten=True)['sessionId']
        for domain in ('Runtime', 'Log', 'Page'):
            self.call(f'{domain}.enable')
        self.call('Emulation.setDeviceMetricsOverride', width=1280, height=720, deviceScaleFactor=1, mobile=False)
        self.call('Emulation.setEmulatedMedia',
                  features=[{'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}])

    def call(self, method, **parameters):
        self.number += 1
        message = {'id': self.number, 'method': method, 'params': parameters}
        if self.session:
            message['sessionId'] = self.session
        self.socket.send(json.dumps(message))
        while True:
            answer = json.loads(self.socket.receive())
            if answer.get('id') == self.number:
                if 'error' in answer:
                    raise RuntimeError(f'{method}: {answer["error"]}')
                return answer['result']
            self._note(answer)

    def _note(self, event):
        of = event.get('params', {})
        if event.get('method') == 'Runtime.exceptionThrown':
            self.errors.append(of['exceptionDetails'].get('exception', {}).get('description', str(of)))
        elif event.get('method') == 'Runtime.consoleAPICalled' and of['type'] in ('error', 'assert'):
            self.errors.append(str([a.get('value', a.get('description')) for a in of['args']]))
        elif event.get('method') == 'Log.entryAdded' and of['entry']['level'] == 'error':
            self.errors.append(of['entry']['text'] + ' ' + of['entry'].get('url', ''))

    def open(self, url):
        self.call('Page.navigate', url=url)

    def ask(self, expression):
        result = self.call('Runtime.evaluate', expression=expression, returnByValue=True, awaitPromise=True)
        if 'exceptionDetails' in result:
            raise RuntimeError(result['exceptionDetails']['exception'].get('description', expression))
        return result['result'].get('value')

    def figures(self):
        return self.ask('window.hapticView ? hapticView.figures() : {}')

    def png(self, scale=1):
        clip = {'x': 0, 'y': 0, 'width': 1280, 'height': 720, 'scale': scale}
        return base64.b64decode(self.call('Page.captureScreenshot', format='png', clip=clip)['data'])

    def key(self, key, text=None):
        code = {' ': 'Space'}.get(key, f'Key{key.upper()}' if len(key) == 1 else key)
        for kind in ('keyDown', 'keyUp'):
            self.call('Input.dispatchKeyEvent', type=kind, key=key, code=code, text=key if kind == 'keyDown' and len(key) == 1 else '')

    def close(self):
        try:
            self.call('Browser.close')
        except (OSError, RuntimeError):
            pass
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        shutil.rmtree(self.home, ignore_errors=True)


def wait_for(condition, seconds, what):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        value = condition()
        if value:
            return value
        time.sleep(0.05)
    raise AssertionError(f'{what}: not within {seconds} s')


def pixels(png):
    """Rows of (r, g, b) of an 8-bit RGB or RGBA picture."""
    at, width, height, channels, data = 8, 0, 0, 0, b''
    while at < len(png):
        n, kind = struct.unpack('>I4s', png[at:at + 8])
        body = png[at + 8:at + 8 + n]
        if kind == b'IHDR':
            width, height, depth, colour = struct.unpack('>IIBB', body[:10])
            channels = {2: 3, 6: 4}[colour]
            assert depth == 8
        elif kind == b'IDAT':
            data += body
        at += 12 + n
    data = zlib.decompress(data)
    step, before, rows = width * channels, bytearray(width * channels), []
    for y in range(height):
        how, line = data[y * (step + 1)], bytearray(data[y * (step + 1) + 1:(y + 1) * (step + 1)])
        for i in range(step):
            a = line[i - channels] if i >= channels else 0
            b, c = before[i], before[i - channels] if i >= channels else 0
            if how == 4:
                p = a + b - c
                near = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))
                add = near[2]
            else:
                add = (0, a, b, (a + b) // 2)[how]
            line[i] = (line[i] + add) & 255
        rows.append([tuple(line[i:i + 3]) for i in range(0, step, channels)])
        before = line
    return rows


def find_browser():
    return next((p for p in map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome')) if p), None)


def get(url):
    return urllib.request.urlopen(url, timeout=5).read()
