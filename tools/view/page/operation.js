// What an operation has come to: each hand's times, what is left of each body, and what happened last.
const $ = id => document.getElementById(id);
const SHOWN = 5, KEPT = 200;

const escape = text => String(text).replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);
const seconds = s => `${(s ?? 0).toFixed(0)} s`;
const share = x => `${(100 * (x ?? 0)).toFixed(x > 0 && x < 0.1 ? 1 : 0)} %`;
const force = n => n === null ? '–' : n < 0.1 ? `${(1000 * n).toFixed(n < 0.001 ? 2 : 1)} mN` : `${n.toFixed(2)} N`;
const many = (n, what) => `${n} ${what}${n === 1 ? '' : 's'}`;
const table = (heads, lines) =>
  `<tr>${heads.map(h => `<th>${h}</th>`).join('')}</tr>` +
  lines.map(line => `<tr>${line.map(cell => `<td>${cell}</td>`).join('')}</tr>`).join('');

// server/observe/operation_events.h
const WARN = new Set(['rupture', 'touched']);
function words({ what, who, value }, hands) {
  const hand = hands[Number(who)] ?? `hand ${who}`;
  switch (what) {
    case 'crack': return `${who} cracks${value > 1 ? `, ${many(value, 'piece')}` : ''}`;
    case 'rupture': return `${who} ruptures`;
    case 'pieces': return `${who} in ${many(value, 'piece')}`;
    case 'gone': return `${share(value)} of ${who} gone`;
    case 'aspirated': return `${many(value, 'fragment')} sucked out`;
    case 'occluded': return `port of ${hand} covered`;
    case 'too_wide': return `too wide for the lumen of ${hand}`;
    case 'passed': return `through the lumen of ${hand} in ${value.toFixed(1)} s`;
    case 'vented': return `port of ${hand} free`;
    case 'touched': return `${who} touched, ${force(value)}`;
    default: return `${what} ${who}`;
  }
}

export class Operation {
  constructor() {
    this.names = [];
    this.draws = false;  // somebody has a pump
    this.flows = false;  // … with a flow
    this.happened = [];
  }

  takeScene({ instruments }) { this.names = instruments.map(i => i.name); }

  take(message) {
    // Reset, begun anew, or gone back.
    this.happened = this.happened.filter(e => e.t <= (message.time_s ?? 0) + 0.1);
    const e = message.newest_event, last = this.happened.at(-1);
    if (e && !(last && last.t === e.t && last.what === e.what && last.who === e.who)) this.happened.push(e);
    if (this.happened.length > KEPT) this.happened.shift();
    this.draw(message);
  }

  clear() {
    this.happened = [];
    $('operation').hidden = true;
  }

  draw({ time_s, hands = [], bodies = [], events }) {
    $('operation').hidden = false;
    $('operation-time').textContent = `${(time_s ?? 0).toFixed(1)} s · ${many(events, 'event')}`;
    this.draws ||= hands.some(h => h.vacuum_pa > 0);
    this.flows ||= hands.some(h => h.fluid_ml > 0);
    const pump = [...this.draws ? ['vacuum'] : [], ...this.flows ? ['fluid'] : []];
    const vacuum = h => [...this.draws ? [`${(1e-3 * (h.vacuum_pa ?? 0)).toFixed(1)} kPa`] : [],
      ...this.flows ? [`${(h.fluid_ml ?? 0).toFixed(1)} ml`] : []];
    $('operation-hands').innerHTML = table(['', 'touching', 'phaco', 'suction', ...pump, 'path'],
      hands.map((h, i) => [escape(this.names[i] ?? `hand ${i}`), seconds(h.touching_s), seconds(h.emulsifying_s),
        seconds(h.aspirating_s), ...vacuum(h), `${(1000 * (h.path_m ?? 0)).toFixed(0)} mm`]));
    $('operation-bodies').innerHTML = table(['', 'gone', 'pieces', 'loose', 'touched'],
      bodies.map(b => b.pieces === undefined ?
        [escape(b.name), '', '', '', b.touched_s > 0 ? force(b.touch_most_n) : 'never'] :
        [escape(b.name), share(b.volume_gone_share), b.pieces === b.pieces_most ? b.pieces : `${b.pieces} of ${b.pieces_most}`,
          b.pieces_loose, b.touched_s > 0 ? force(b.touch_most_n) : 'never']));
    $('operation-events').innerHTML = this.happened.slice(-SHOWN).reverse().map(e =>
      `<li${WARN.has(e.what) ? ' class="warn"' : ''}><span>${e.t.toFixed(1)} s</span>${escape(words(e, this.names))}</li>`).join('');
  }
}
