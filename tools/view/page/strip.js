// The side strip: what the loops say of themselves, in words and small charts.
import { bar, histogram, line, nice, percentile } from './charts.js';
import { cividis, css } from './colour.js';

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

export class Strip {
  constructor() {
    this.force = [];
    this.blocks = 0;
    this.past = [];  // of counts, for a live histogram
    this.health = new Map();
    this.status = { daemon: false, devices: [] };
    this.chosen = null;
    this.bodies = [];
  }

  takeStatus(status) {
    this.status = status;
    if (!status.devices.some(d => d.id === this.chosen)) this.chosen = status.devices[0]?.id ?? null;
    if (!status.daemon) this.clear();
    this.words();
  }
  takeScene(scene) { this.bodies = scene.bodies; }
  takeHealth(health) {
    this.health.set(health.id, health);
    if (this.chosen === null) this.chosen = health.id;
    if (health.id !== this.chosen) return;
    this.takeForce(health);
    if (health.wake) this.takeCounts(health);
    document.body.classList.toggle('recorded', !health.wake);
    this.words();
    this.dirty = true;
  }

  clear() {
    this.force = [];
    this.blocks = 0;
    this.past = [];
    this.health.clear();
    this.dirty = true;
  }

  // Each message has the newest second: what one that was skipped had, the next has too.
  takeForce({ blocks, force }) {
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
    const seen = this.force.filter(v => !Number.isNaN(v));
    const newest = seen.at(-1) ?? 0;
    line($('force-chart'), this.force, BLOCK_S, SECONDS, nice(Math.max(...seen, 0.05) * 1.05), 'N, largest in 10 ms');
    $('force-now').textContent = `${newest.toFixed(3)} N`;
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
      !b.awake ? 'asleep' : `${b.reference_age} steps old${b.error ? `, off ${b.error.toExponential(0)}` : ''}${b.degraded ? ', degraded' : ''}`]);
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
    $('devices').innerHTML = this.status.devices.map(d => {
      const name = this.health.get(d.id)?.device || 'device';
      return `<li><span>${escape(name)} · id ${d.id}</span>${d.status & 1 ? 'disarmed' : 'connected'}</li>`;
    }).join('');
  }
}
