"""The page of `haptic view` in a browser, against daemons and recordings that it starts itself.

page_test.py live|recording|control|hands BIN_DIR SOURCE_DIR DOMAIN: exit code 0 if all holds, 77 without a browser; figures on
stdout. With --pictures DIR the screenshots stay.
"""
import json
import os
import re
import signal
import subprocess
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from browser import Browser, find_browser, pixels, wait_for

mode, binaries, source, domain = sys.argv[1:5]
keep = sys.argv[sys.argv.index('--pictures') + 1] if '--pictures' in sys.argv else None
figures = {}
children = []


def start(*command):
    child = subprocess.Popen([os.path.join(binaries, command[0]), *command[1:]], stdin=subprocess.DEVNULL,
                             stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    children.append(child)
    return child


def view(*options):
    child = start('haptic', 'view', '--port', '0', *options)
    for line in child.stdout:
        if found := re.search(r'http://\S+', line):
            return child, found.group(0)
    raise AssertionError('haptic view did not say where')


def check(name, truth, what=''):
    figures[name] = what if what != '' else bool(truth)
    if not truth:
        raise AssertionError(f'{name}: {what}')


def picture(browser, name):
    if keep:
        os.makedirs(keep, exist_ok=True)
        with open(os.path.join(keep, name + '.png'), 'wb') as out:
            out.write(browser.png())


def vermilion(browser):
    """Pixels of a quarter picture in the colour of what was cut."""
    return sum(r > 120 and r > 1.7 * g and g > 1.5 * b for row in pixels(browser.png(0.25)) for r, g, b in row[:240])


def live(browser):
    scene, stroke = (os.path.join(source, 'config/scenes/cataract', f) for f in ('cataract.yaml', 'stroke.csv'))
    daemon = start('hapticd', scene, '--domain', domain)
    _, url = view('--domain', domain)
    browser.open(url)
    wait_for(lambda: (f := browser.figures()).get('triangles') and f['daemon'], 20, 'the scene')
    wait_for(lambda: browser.ask("document.getElementById('banner').hidden"), 5, 'no banner')
    time.sleep(1)
    before = browser.figures()  # by now of every body
    cut_before = vermilion(browser)
    picture(browser, 'before')

    replay = start('haptic', 'replay', stroke, '--domain', domain, '--min-answered', '0')
    wait_for(lambda: browser.figures()['removed'] > 20, 60, 'removals')
    begun, a = time.monotonic(), browser.figures()
    time.sleep(4)
    spent, b = time.monotonic() - begun, browser.figures()
    figures['frames_per_second'] = round((b['frames'] - a['frames']) / spent, 1)
    figures['states_per_second'] = round((b['states'] - a['states']) / spent / 2, 1)
    figures['pixel_ratio'] = round(b['ratio'], 2)
    picture(browser, 'during')
    # How many is a matter of what else runs here (tools/view/MEASURED.md).
    check('frames_come', b['frames'] - a['frames'] > 2 * spent)
    check('force_strip_moves', b['blocks'] > a['blocks'] and b['force'] > 0, [b['blocks'] - a['blocks'], round(b['force'], 3)])
    check('cut_triangles', b['cut'] > 20, b['cut'])
    cut_now = vermilion(browser)
    check('cut_pixels', cut_now > cut_before + 20, [cut_before, cut_now])
    check('removed_text', int(browser.ask("document.getElementById('removed').textContent")) >= a['removed'])
    operation = lambda: browser.ask("document.getElementById('operation').innerText")
    wait_for(lambda: 'lens' in operation() and 'gone' in operation(), 5, 'the operation')
    figures['operation'] = operation()
    check('operation_went_on', float(re.search(r'([0-9.]+) s', operation()).group(1)) > 1)
    if keep:
        replay.wait(40)
        time.sleep(1)
        picture(browser, 'after')
        for key, name in (('c', 'displacement'), ('c', 'strain'), ('c', None), ('w', 'wireframe'), ('w', None), ('d', 'dark')):
            browser.key(key)
            time.sleep(0.5)
            if name:
                picture(browser, name)
    replay.terminate()

    daemon.send_signal(signal.SIGKILL)
    wait_for(lambda: 'Disconnected' in browser.ask("document.getElementById('banner').textContent"), 4, 'disconnected')
    check('disconnected_said', not browser.ask("document.getElementById('banner').hidden"))
    picture(browser, 'disconnected')
    start('hapticd', scene, '--domain', domain)
    wait_for(lambda: browser.ask("document.getElementById('banner').hidden"), 15, 'recovery')
    states = browser.figures()['states']
    wait_for(lambda: browser.figures()['states'] > states + 10, 10, 'states again')
    after = wait_for(lambda: (f := browser.figures())['removed'] == 0 and f, 5, 'a whole lens again')
    check('whole_again', after['triangles'] == before['triangles'], after['triangles'])


def recording(browser):
    cube = os.path.join(source, 'config/scenes/cube')
    _, url = view('--recording', os.path.join(cube, 'press.csv'), '--scene', os.path.join(cube, 'cube.yaml'))
    browser.open(url)
    wait_for(lambda: browser.figures().get('triangles'), 20, 'the scene')
    timeline = lambda: browser.ask('({t: hapticView.timeline.t, duration: hapticView.timeline.duration, '
                                   'playing: hapticView.timeline.playing, done: hapticView.timeline.done})')
    wait_for(lambda: timeline().get('done'), 30, 'the computing')
    browser.ask('hapticView.timeline.say({seek: 0, playing: false})')
    wait_for(lambda: timeline()['t'] == 0 and not timeline()['playing'], 3, 'the beginning')
    browser.key('.')
    wait_for(lambda: abs(timeline()['t'] - 0.5) < 1e-6, 3, 'half a second by a key')
    browser.ask('hapticView.timeline.say({playing: true, speed: 4})')
    a = browser.figures()
    end = wait_for(lambda: (t := timeline())['t'] == t['duration'] and not t['playing'] and t, 20, 'the end')
    b = browser.figures()
    check('played_to_the_end', end['t'] == end['duration'] and end['duration'] > 5, end['duration'])
    check('states', b['states'] - a['states'] > 20, b['states'] - a['states'])
    check('force_seen', b['force'] > 0.01, round(b['force'], 3))
    picture(browser, 'recording')
    browser.ask('hapticView.timeline.seek(2)')
    wait_for(lambda: abs(timeline()['t'] - 2) < 1e-6, 3, 'back')
    operation = lambda: browser.ask("document.getElementById('operation-time').textContent")
    wait_for(lambda: 1.5 < float(operation().split()[0]) < 2.6, 3, 'the operation as it was then')
    check('strip_went_back', browser.figures()['blocks'] <= 200 + 1, browser.figures()['blocks'])
    browser.ask('hapticView.timeline.say({speed: 1, playing: true})')
    browser.ask("document.activeElement.blur()")
    wait_for(lambda: timeline()['t'] > 2.2, 3, 'playing on')
    browser.key(' ')
    wait_for(lambda: not timeline()['playing'], 3, 'a pause by a key')


def control(browser):
    cube = os.path.join(source, 'config/scenes/cube/cube.yaml')
    start('hapticd', cube, '--domain', domain)
    _, url = view('--domain', domain, '--control')
    browser.open(url)
    wait_for(lambda: (f := browser.figures()).get('triangles') and f['daemon'], 20, 'the scene')
    wait_for(lambda: browser.ask('Boolean(hapticView.hand.map)'), 5, 'the map')
    check('marked', 'Not a haptic device' in browser.ask("document.getElementById('hand').textContent"))
    browser.key('h')
    wait_for(lambda: browser.ask('hapticView.hand.state') == 'holding', 10, 'armed')
    z = lambda: browser.ask('hapticView.instrument.to.p.z')
    before = z()
    # Down by what a person drags: into the cube.
    wait_for(lambda: browser.ask('(() => { hapticView.hand.target.z -= 0.0004; return hapticView.figures().contacts; })()'), 20, 'contact')
    check('tip_went_down', z() < before, round(1000 * (before - z()), 2))
    time.sleep(1)
    check('force', browser.figures()['force'] > 0.01, round(browser.figures()['force'], 3))
    picture(browser, 'control')
    # Far beyond: it stays within the workspace.
    browser.ask('hapticView.hand.target.set(9, 9, 9)')
    time.sleep(0.5)
    check('bounded', browser.ask('hapticView.hand.inDevice().length() <= 0.951 * hapticView.hand.map.workspace'))
    browser.key('h')
    wait_for(lambda: browser.ask('hapticView.hand.state') == 'off', 5, 'let go')
    wait_for(lambda: browser.ask('hapticView.strip.status.devices[0].status & 1') == 1, 5, 'disarmed')


def hands(browser):
    """Two instruments in one lens: two tools, each with its contacts, and a trace a device."""
    two = os.path.join(source, 'config/scenes/two_hands')
    start('hapticd', os.path.join(two, 'two_hands.yaml'), '--domain', domain)
    _, url = view('--domain', domain)
    browser.open(url)
    wait_for(lambda: (f := browser.figures()).get('triangles') and f['daemon'] and len(f['tools']) == 2, 30, 'the scene')
    wait_for(lambda: len(browser.figures()['traces']) == 2, 5, 'two traces')
    check('names', [t['name'] for t in browser.figures()['tools']] == ['phaco', 'chopper'], browser.figures()['tools'])
    check('nobody_holds_one', not any(t['held'] for t in browser.figures()['tools']))
    picture(browser, 'hands_before')
    alone = start('haptic', 'hand', '--target', os.path.join(two, 'hold.csv'), '--device-id', '1', '--duration', '3', '--domain', domain,
                  '--min-answered', '0')
    wait_for(lambda: [t['held'] for t in browser.figures()['tools']] == [False, True], 20, 'the chopper alone is held')
    alone.terminate()
    alone.wait(20)
    replay = start('haptic', 'replay', os.path.join(two, 'sculpt.csv'), os.path.join(two, 'hold.csv'), '--domain', domain,
                   '--min-answered', '0')
    seen = lambda: browser.figures()['tools']
    wait_for(lambda: all(t['shown'] and t['held'] for t in seen()), 20, 'both are held')
    both = wait_for(lambda: (t := seen()) and all(i['contacts'] for i in t) and t, 30, 'both touch')
    figures['contacts'] = [t['contacts'] for t in both]
    picture(browser, 'hands_press')
    felt = wait_for(lambda: (t := browser.figures()['traces']) and all(i['force'] > 0.05 for i in t) and t, 20, 'both feel a force')
    figures['forces'] = [round(t['force'], 3) for t in felt]
    blocks = [t['blocks'] for t in felt]
    # Of one haptic thread: the traces have one time axis, but for the messages' own period.
    check('one_time_axis', abs(blocks[0] - blocks[1]) < 100, blocks)
    wait_for(lambda: len(browser.ask("[...document.querySelectorAll('#force-traces li')].map(e => e.textContent)")) == 2, 5, 'both named')
    words = browser.ask("document.getElementById('devices').textContent")
    check('devices_named', 'phaco' in words and 'chopper' in words, words)
    browser.ask("document.querySelector('#devices [data-device=\"1\"]').click()")
    wait_for(lambda: browser.ask('hapticView.strip.chosen') == 1, 3, 'the other device chosen')
    if keep:
        wait_for(lambda: browser.figures()['removed'] > 20, 60, 'removals')
        picture(browser, 'hands_sculpt')
        browser.key('d')
        time.sleep(0.5)
        picture(browser, 'hands_dark')
    replay.terminate()
    wait_for(lambda: not any(t['held'] for t in seen()), 20, 'both are let go of')


program = find_browser()
if not program:
    print('no chromium here')
    sys.exit(77)
browser = Browser(program)
code = 0
try:
    {'live': live, 'recording': recording, 'control': control, 'hands': hands}[mode](browser)
    check('no_errors', not browser.errors and not browser.figures()['errors'], browser.errors + browser.figures()['errors'])
except (AssertionError, RuntimeError, ConnectionError) as error:
    figures['failed'] = str(error)
    figures['errors'] = list(browser.errors)
    try:
        figures['state'] = browser.figures()
        picture(browser, 'failed')
    except Exception:
        pass
    code = 1
finally:
    for child in children:
        child.terminate()
    for child in children:
        try:
            child.wait(10)
        except subprocess.TimeoutExpired:
            child.kill()
    browser.close()
print(json.dumps(figures, indent=1))
sys.exit(code)
