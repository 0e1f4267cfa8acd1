"""The page of `haptic fleet` in a browser, with two stations that it starts itself.

page_test.py BIN_DIR SOURCE_DIR DOMAIN: exit code 0 if all holds, 77 without a browser. With --pictures DIR the
screenshots stay, at three widths, light and dark.
"""
import base64
import os
import re
import signal
import subprocess
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, '..', 'view'))
from browser import Browser, find_browser, wait_for

binaries, source, domain = sys.argv[1:4]
keep = sys.argv[sys.argv.index('--pictures') + 1] if '--pictures' in sys.argv else None
children = []


def start(*command):
    child = subprocess.Popen([os.path.join(binaries, command[0]), *command[1:], '--domain', domain],
                             stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    children.append(child)
    return child


def daemon(station):
    child = subprocess.Popen([os.path.join(binaries, 'hapticd'), os.path.join(source, 'config/scenes/cube/cube.yaml'),
                              '--domain', domain, '--station', station], stdin=subprocess.DEVNULL,
                             stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    children.append(child)
    return child


def picture(browser, name, width):
    browser.call('Emulation.setDeviceMetricsOverride', width=width, height=900, deviceScaleFactor=1, mobile=False)
    time.sleep(0.7)
    clip = {'x': 0, 'y': 0, 'width': width, 'height': 900, 'scale': 1}
    data = browser.call('Page.captureScreenshot', format='png', clip=clip)['data']
    with open(os.path.join(keep, f'{name}_{width}.png'), 'wb') as out:
        out.write(base64.b64decode(data))


def pictures(browser, name):
    if not keep:
        return
    os.makedirs(keep, exist_ok=True)
    for theme in ('light', 'dark'):
        browser.call('Emulation.setEmulatedMedia', features=[{'name': 'prefers-color-scheme', 'value': theme}])
        for width in (480, 800, 1280):
            picture(browser, f'{name}_{theme}', width)


def state(browser, station):
    return browser.ask(f"document.getElementById('station-{station}')?.dataset.state")


program = find_browser()
if not program:
    print('no Chromium here')
    sys.exit(77)
browser, code = Browser(program), 1
try:
    fleet = start('haptic', 'fleet', '--page', '--port', '0')
    url = next(found.group(0) for line in fleet.stdout if (found := re.search(r'http://\S+', line)))
    browser.open(url)
    wait_for(lambda: browser.ask("!!window.hapticFleet && hapticFleet.figures().connected"), 20, 'the page')
    wait_for(lambda: browser.ask("!document.getElementById('empty').hidden"), 5, 'a word where there is no station')
    pictures(browser, 'empty')
    first, second = daemon('bench2'), daemon('bench10')
    for station in ('bench2', 'bench10'):
        wait_for(lambda: state(browser, station) == 'idle', 30, station)
    titles = browser.ask("[...document.querySelectorAll('.tile h2')].map(e => e.textContent)")
    assert titles == ['bench2', 'bench10'], titles  # as people count
    wait_for(lambda: 'Touch' in browser.ask("document.querySelector('.tile .what').textContent"), 5, 'the device')
    time.sleep(3)
    pictures(browser, 'fleet')

    killed = time.monotonic()
    second.send_signal(signal.SIGKILL)
    wait_for(lambda: state(browser, 'bench10') == 'lost', 2, 'the loss')
    seen = time.monotonic() - killed
    assert seen <= 1.2, seen  # 0.2: a browser that draws by software beside a daemon
    assert 'bench10' in browser.ask("document.getElementById('attention').textContent")
    pictures(browser, 'lost')

    # A tile opens its station's view, which knows nothing of the other.
    browser.open(url.rstrip('/') + browser.ask("document.getElementById('station-bench2').getAttribute('href')"))
    wait_for(lambda: browser.figures().get('triangles'), 30, "the station's view")
    assert browser.ask('location.port') != re.search(r':(\d+)/', url).group(1)
    assert not browser.errors, browser.errors
    print(f'loss seen after {seen:.2f} s')
    code = 0
except AssertionError as error:
    print(error, browser.errors)
finally:
    for child in children:
        child.terminate()
    for child in children:
        try:
            child.wait(10)
        except subprocess.TimeoutExpired:
            child.kill()
    browser.close()
sys.exit(code)
