// The side strip: what the loops say of themselves, in words and small charts.
import { bar, histogram, lines, nice, percentile } from './charts.js';
import { cividis, css, variable } from './colour.js';
import { accentOf } from './instrument.js';

const $ = id => document.getElementById(id);
const SECONDS = 10, BLOCK_S = 0.01, WINDOW_MS = 10000;
const PARTS = ['publish', 'collision', 'assembly', 'factor', 'free motion', 'condense', 'solve'];
const PART_COLOURS = PARTS.map((_, i) => css(cividis((i + 0.5) / PARTS.length)));
const TICKS = [[10, '10 µs'], [100, '100'], [1000, '1 ms'], [10000, '10']];

// The bins of server/observe/health.h, in µs.
const BEGINS = [0];
for (let q = 0; q < 56; ++q) BEGINS.push(2 ** (10 + Math.floor(q / 4)) * (1 + (q % 4) / 4) / 1000);

// haptic/device.h
const BITS = ['disarmed', 'holding', 'ramping down', 'ramping up', 'problem old', 'problem lost', 'gap', 'rejected',
  'latched', 'conflict', 'saturated', 'slew limited', 'not finite', 'solver cap', 'blending', 'contacts dropped',
  'second daemon'];
const ORDINARY = new Set([0, 3, 10, 11, 14]);

const us = x => Number.isNaN(x) ? '–' : x < 100 ? x.toFixed(0) : String(Number(x.toPrecision(2)));
const rows = list => list.map(([k, v]) => `<dt>${k}</dt><dd>${v}</dd>`).join('');
const escape = text => String(text).replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);

// The newest ten seconds of a device's force, a value each block.
class Trace {
  constructor() {
    this.force = [];
    this.blocks = 0;
  }

  // Each message has the newest second: what one that was skipped had, the next has too.
  take({ blocks, force }) {
    if (blocks < this.blocks) this.force = [];  // begun anew, or gone back
    const n = force.length / 4, have = blocks < this.blocks ? 0 : this.blocks;
    let fresh = Math.min(blocks - have, n);
    const missed = Math.min(blocks - have - fresh, SECONDS / BLOCK_S);
    for (let i = 0; i < missed; ++i) this.force.push(NaN);
    for (let i = n - fresh; i < n; ++i) this.force.push(force[4 * i + 3]);
    const most = SECONDS / BLOCK_S + 1;
    if (this.force.length > most) this.force.splice(0, this.force.length - most);
    this.blocks = blocks;
  }
  get newest() { return this.force.findLast(v => !Number.isNaN(v)) ?? 0; }
}

export class Strip {
  constructor() {
    this.trace = new Map();  // by device
    this.past = [];  // of counts, for a live histogram
    this.health = new Map();
    this.status = { daemon: false, devices: [] };
    this.chosen = null;
    this.bodies = [];
    this.instruments = [];
    $('devices').addEventListener('click', e => {
      const id = e.target.closest('[data-device]')?.dataset.device;
      if (id !== undefined) this.choose(Number(id));
    });
  }

  // Of the chosen device.
  get force() { return this.trace.get(this.chosen)?.force ?? []; }
  get blocks() { return this.trace.get(this.chosen)?.blocks ?? 0; }

  // What the charts and words are about; the forces are all devices'.
  choose(id) {
    this.picked = true;
    if (id === this.chosen) return;
    this.chosen = id;
    this.past = [];
    this.words();
    this.dirty = true;
  }
  choice(devices) {
    const first = this.instruments[0]?.device;
    return devices.some(d => d.id === first) ? first : devices[0]?.id ?? null;
  }

  // The devices of the world that is shown; of one alone, the chosen one.
  traces() {
    const shown = this.instruments.length > 1 ? this.instruments : [{ device: this.chosen, name: '' }];
    return shown.map(({ device, name }, i) => ({
      id: device, name, colour: variable(accentOf(i)),
      force: this.trace.get(device)?.force ?? [], blocks: this.trace.get(device)?.blocks ?? 0,
      newest: this.trace.get(device)?.newest ?? 0,
    }));
  }

  takeStatus(status) {
    this.status = status;
    if (!status.devices.some(d => d.id === this.chosen)) this.chosen = this.choice(status.devices);
    if (!status.daemon) this.clear();
    this.words();
  }
  takeScene(scene) {
    this.bodies = scene.bodies;
    this.instruments = scene.instruments;
    if (!this.picked) this.chosen = this.choice(this.status.devices);
    this.words();
    this.dirty = true;
  }
  takeHealth(health) {
    this.health.set(health.id, health);
    this.chosen ??= this.instruments[0]?.device ?? health.id;
    if (!this.trace.has(health.id)) this.trace.set(health.id, new Trace());
    this.trace.get(health.id).take(health);
    this.dirty = true;
    if (health.id !== this.chosen) return;
    if (health.wake) this.takeCounts(health);
    document.body.classList.toggle('recorded', !health.wake);
    this.words();
  }

  clear() {
    this.picked = false;
    this.trace.clear();
    this.past = [];
    this.health.clear();
    this.dirty = true;
  }

  takeCounts({ wake, solve }) {
    const now = performance.now();
    const before = this.past.at(-1);
    if (before && before.wake.some((n, i) => n > wake[i])) this.past = [];
    this.past.push({ now, wake, solve });
    while (this.past.length > 2 && now - this.past[1].now > WINDOW_MS) this.past.shift();
  }
  recent(name) {
    const newest = this.past.at(-1)?.[name], oldest = this.past[0]?.[name];
    return newest ? newest.map((n, i) => n - (this.past.length > 1 ? oldest[i] : 0)) : [];
  }

  // Ten times a second is as often as anything new comes.
  draw(now) {
    if (!this.dirty || now - (this.drawn ?? -1e9) < 90) return;
    this.dirty = false;
    this.drawn = now;
    const traces = this.traces(), blocks = Math.max(...traces.map(t => t.blocks));
    const largest = Math.max(0.05, ...traces.flatMap(t => t.force).filter(v => !Number.isNaN(v)));
    lines($('force-chart'), traces.map(t => ({ values: t.force, behind: blocks - t.blocks, colour: t.colour })),
      BLOCK_S, SECONDS, nice(largest * 1.05), 'N, largest in 10 ms');
    const several = traces.length > 1;
    $('force-of').textContent = several ? 'Force on the devices' : 'Force on the device';
    $('force-now').textContent = several ? '' : `${traces[0].newest.toFixed(3)} N`;
    $('force-traces').innerHTML = !several ? '' : traces.map(t =>
      `<li><i></i>${escape(t.name)}<b>${t.newest.toFixed(3)} N</b></li>`).join('');
    document.querySelectorAll('#force-traces i').forEach((e, i) => { e.style.background = traces[i].colour; });
    for (const name of ['wake', 'solve']) {
      const counts = this.recent(name);
      if (!counts.length) continue;
      histogram($(`${name}-chart`), counts, BEGINS, TICKS);
      $(`${name}-text`).textContent =
        `p50 ${us(percentile(counts, BEGINS, 50))} · p99.9 ${us(percentile(counts, BEGINS, 99.9))} µs`;
    }
    const health = this.health.get(this.chosen);
    if (health?.parts_ms) {
      const sum = health.parts_ms.reduce((a, b) => a + b, 0);
      bar($('step-chart'), health.parts_ms, PART_COLOURS, Math.max(health.period_ms, sum));
      $('step-now').textContent = `${sum.toFixed(1)} of ${health.period_ms.toFixed(0)} ms`;
      $('step-now').classList.toggle('late', sum > health.period_ms);
      $('step-parts').innerHTML = PARTS.map((name, i) =>
        `<li><i data-part="${i}"></i>${name}<b>${health.parts_ms[i].toFixed(2)}</b></li>`).join('');
      document.querySelectorAll('#step-parts i').forEach((e, i) => { e.style.background = PART_COLOURS[i]; });
    }
  }

  words() {
    const device = this.status.devices.find(d => d.id === this.chosen), health = this.health.get(this.chosen);
    document.querySelectorAll('#strip .live').forEach(e => { e.hidden = device && device.haptic_hz === undefined; });
    if (!device) {
      for (const id of ['tissue', 'safety', 'status-bits', 'devices']) $(id).innerHTML = '';
      for (const id of ['haptic-rate', 'step-now', 'force-now']) $(id).textContent = '';
      return;
    }
    if (device.haptic_hz !== undefined)
      $('haptic-rate').textContent = `${device.haptic_hz.toFixed(0)} Hz · ${device.misses} missed`;
    const of = id => this.bodies.find(b => b.id === id)?.name ?? id;
    const bases = (health?.bodies ?? []).map(b => [
      `base of ${escape(of(b.body))}`,
      !b.awake ? 'asleep' : `${b.reference_age} steps old${b.error ? `, off\u00a0${b.error.toExponential(0).replace("-", "\u2011")}` : ''}${b.degraded ? ', degraded' : ''}`]);
    $('tissue').innerHTML = rows([
      ['elements removed', `<b id="removed">${device.removed}</b>`],
      ['fragments aspirated', device.aspirated],
      ['compliance', escape(health?.compliance ?? '–')],
      ...bases]);
    const bits = BITS.map((name, i) => [name, i]).filter(([, i]) => device.status >> i & 1);
    $('status-bits').innerHTML = (device.status & 1 ? '' : '<li class="well">armed</li>') +
      bits.map(([name, i]) => `<li${ORDINARY.has(i) ? '' : ' class="warn"'}>${name}</li>`).join('');
    const safety = [];
    if (device.rejected !== undefined)
      safety.push(['watchdog', device.status & 0b1110110 ? 'acting' : 'quiet'], ['states rejected', device.rejected], ['conflicts', device.conflicts]);
    if (health?.energy !== undefined)
      safety.push(['energy taken in', `${(1000 * health.energy + 0).toFixed(2).replace('-0.00', '0.00')} mJ`],
        ['passivity', health.energy_least < -5e-6 ? `made ${(-1000 * health.energy_least).toFixed(2)} mJ` : 'kept']);
    if (device.refused) safety.push(['real time', `without ${escape(device.refused)}`]);
    $('safety').innerHTML = rows(safety);
    const several = this.status.devices.length > 1;
    $('devices').innerHTML = this.status.devices.map(d => {
      const name = this.health.get(d.id)?.device || 'device';
      const held = this.instruments.length > 1 && this.instruments.find(i => i.device === d.id);
      const words = `${held ? `${escape(held.name)} · ` : ''}${escape(name)} · id ${d.id}`;
      const choice = several ? `<button data-device="${d.id}" aria-pressed="${d.id === this.chosen}">${words}</button>` : `<span>${words}</span>`;
      return `<li>${choice}${d.status & 1 ? 'disarmed' : 'connected'}</li>`;
    }).join('');
  }
}
