// One station's tile: built once, then only what has changed is written.
const SVG = 'http://www.w3.org/2000/svg';
const WIDTH = 100, HEIGHT = 40, BINS = 99, LEAST_N = 0.2;
const PLAIN = '–';

const make = (tag, name, ...children) => {
  const e = document.createElement(tag);
  if (name) e.className = name;
  e.append(...children);
  return e;
};
const say = (e, text) => { if (e.textContent !== text) e.textContent = text; };
const fixed = (x, n) => typeof x === 'number' ? x.toFixed(n) : PLAIN;
const seconds = s => s < 100 ? `${s.toFixed(0)} s` : s < 6000 ? `${(s / 60).toFixed(0)} min` : `${(s / 3600).toFixed(0)} h`;
const late = us => us < 1000 ? `${us.toFixed(0)} µs` : `${(us / 1000).toFixed(1)} ms`;
const clock = s => `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, '0')}`;
const largest = (list, of) => list.reduce((m, x) => Math.max(m, of(x) ?? 0), 0);

export const shown = name => name || '(no name)';
// What is wrong, in a line; what the state says already is left out.
export const complaint = s => s.faults.filter(f => f.what !== s.state).map(f => f.detail ? `${f.what} ${f.detail}` : f.what).join(', ');

// Force against time, drawn in a box of its own scale; a gap ends a stretch.
function points(trace, most) {
  const from = BINS - trace.length;
  return trace.map((f, i) => f === null ? '' : `${((from + i) * WIDTH / BINS).toFixed(1)},${(HEIGHT - 2 - f / most * (HEIGHT - 4)).toFixed(1)}`).filter(p => p).join(' ');
}

export class Tile {
  constructor(name) {
    this.name = name;
    this.title = make('h2', '', shown(name));
    this.state = make('span', 'state');
    this.what = make('p', 'what');
    this.svg = document.createElementNS(SVG, 'svg');
    this.svg.setAttribute('viewBox', `0 0 ${WIDTH} ${HEIGHT}`);
    this.svg.setAttribute('preserveAspectRatio', 'none');
    this.svg.setAttribute('aria-hidden', 'true');
    this.force = make('b');
    this.most = make('span');
    this.now = make('p', 'now', this.force, this.most);
    this.figures = this.list(['haptic', 'simulation', 'step', 'late by']);
    this.operation = this.list(['operation', 'gone', 'pieces', 'path']);
    this.faults = make('p', 'faults');
    this.element = make('a', 'tile', make('div', 'row', this.title, this.state), this.what,
      make('div', 'force', this.svg, this.now), this.figures.element, this.operation.element, this.faults);
    this.element.href = `/fleet/open.html?station=${encodeURIComponent(name)}`;
    this.element.target = '_blank';
    this.element.rel = 'noopener';
    this.element.id = `station-${name}`;
    this.figures.of['late by'].parentElement.title = 'wake-ups of the haptic loop, 99.9 % of the last seconds';
  }

  list(names) {
    const of = {}, element = document.createElement('dl');
    for (const name of names) {
      of[name] = make('dd');
      element.append(make('div', '', make('dt', '', name), of[name]));
    }
    return { element, of };
  }

  show(s) {
    this.station = s;
    const live = s.devices.filter(d => d.live), first = live[0] ?? s.devices[0] ?? {};
    this.element.dataset.state = s.state;
    this.element.classList.toggle('warned', s.faults.length > 0 && s.state !== 'lost' && s.state !== 'ended');
    say(this.state, s.state);
    const kinds = [...new Set(s.devices.map(d => d.device || `device ${d.id}`))];
    say(this.what, [s.scene, kinds.join(' + '), s.host].filter(t => t).join(' · '));
    this.what.title = this.what.textContent;
    this.element.setAttribute('aria-label', `${shown(s.station)}: ${s.state}. ${complaint(s)}. Opens its view.`);
    this.showForce(s);
    const figure = this.figures.of;
    say(figure.haptic, live.length ? `${fixed(first.haptic_hz, 0)} Hz` : PLAIN);
    say(figure.simulation, !live.length ? PLAIN : typeof first.sim_hz === 'number' ? `${fixed(first.sim_hz, 1)} Hz` : 'elsewhere');
    say(figure.step, live.length && typeof first.step_ms === 'number' ? first.period_ms ? `${fixed(first.step_ms, 1)}/${fixed(first.period_ms, 0)} ms` : `${fixed(first.step_ms, 1)} ms` : PLAIN);
    say(figure['late by'], typeof first.wake_p999_us === 'number' && live.length ? late(first.wake_p999_us) : PLAIN);
    figure.haptic.classList.toggle('bad', s.faults.some(f => f.what.startsWith('haptic loop slow')));
    figure.simulation.classList.toggle('bad', s.faults.some(f => f.what.startsWith('simulation slow')));
    this.showOperation(s);
    this.showFaults(s);
  }

  showForce(s) {
    const traces = s.devices.map(d => d.force_trace_n ?? []);
    while (this.svg.children.length < traces.length) this.svg.append(document.createElementNS(SVG, 'polyline'));
    while (this.svg.children.length > traces.length) this.svg.lastChild.remove();
    const most = Math.max(LEAST_N, largest(traces, t => largest(t, f => f)));
    traces.forEach((t, i) => this.svg.children[i].setAttribute('points', points(t, most)));
    const heard = s.devices.some(d => d.live && d.force_n !== undefined);
    say(this.force, heard ? `${largest(s.devices.filter(d => d.live), d => d.force_n).toFixed(2)} N` : PLAIN);
    const limit = largest(s.devices, d => d.max_force_n);
    say(this.most, limit ? `of ${limit.toFixed(1)} N` : ' ');
  }

  showOperation(s) {
    const of = this.operation.of, bodies = s.operation.flatMap(o => o.bodies ?? []), hands = s.operation.flatMap(o => o.hands ?? []);
    const some = s.operation.length > 0;
    say(of.operation, some ? clock(largest(s.operation, o => o.time_s)) : PLAIN);
    say(of.gone, some ? `${(100 * largest(bodies, b => b.volume_gone_share)).toFixed(0)} %` : PLAIN);
    say(of.pieces, some ? String(largest(bodies, b => b.pieces)) : PLAIN);
    say(of.path, some ? `${(1e3 * hands.reduce((sum, h) => sum + h.path_m, 0)).toFixed(0)} mm` : PLAIN);
    const event = s.operation.map(o => o.newest_event).find(e => e);
    of.operation.parentElement.title = event ? `newest event: ${event.what} ${event.who} at ${clock(event.t)}` : '';
  }

  showFaults(s) {
    const ago = seconds(s.heard_ms / 1e3);
    const silent = s.state === 'lost' ? `silent for ${ago}` : s.state === 'ended' ? `said good-bye ${ago} ago` : '';
    const text = [silent, complaint(s)].filter(t => t).join(' · ');
    if (text) {
      if (!this.strong || this.strong.parentElement !== this.faults) this.faults.replaceChildren(this.strong = make('b'));
      say(this.strong, text);
      this.faults.title = text;
      return;
    }
    this.strong = null;
    const past = s.lines.findLast(l => l.for_s !== undefined);
    const refused = [...new Set(s.devices.map(d => d.refused).filter(r => r))];
    say(this.faults, past ? `${past.what} for ${fixed(past.for_s, 1)} s, ${seconds(past.ago_s)} ago` : refused.length ? `without ${refused.join(', ')}` : 'no faults');
    this.faults.title = this.faults.textContent;
  }
}
