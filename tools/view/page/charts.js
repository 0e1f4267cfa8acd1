// Small charts on 2D canvases: a line against time, a histogram on a logarithmic axis, a bar of parts.
import { variable } from './colour.js';

function begin(canvas) {
  const ratio = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  const g = canvas.getContext('2d');
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, w, h);
  g.font = '10.5px system-ui, sans-serif';
  return { g, w, h };
}

// A round number not below x.
export function nice(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  for (const m of [1, 1.5, 2, 3, 5, 7.5, 10]) if (m * power >= x * 0.999) return m * power;
  return x;
}

// series: of values, newest last, one each `step` seconds, NaN where there is none; behind: the newest one's age in
// steps; seconds: how far back the axis goes.
export function lines(canvas, series, step, seconds, most, unit) {
  const { g, w, h } = begin(canvas), left = 38, bottom = 16, top = 6;
  const y = v => top + (h - top - bottom) * (1 - v / most), x = age => w - (w - left) * age / seconds;
  g.strokeStyle = variable('--line');
  g.fillStyle = variable('--quiet');
  g.lineWidth = 1;
  g.textAlign = 'right';
  g.textBaseline = 'middle';
  for (const v of [0, most / 2, most]) {
    g.beginPath();
    g.moveTo(left, Math.round(y(v)) + 0.5);
    g.lineTo(w, Math.round(y(v)) + 0.5);
    g.stroke();
    g.fillText(Number(v.toPrecision(2)).toString(), left - 6, y(v));
  }
  g.textBaseline = 'bottom';
  g.textAlign = 'left';
  g.fillText(`−${seconds} s`, left, h);
  g.textAlign = 'right';
  g.fillText(unit, w, h);
  g.lineWidth = 1.4;
  g.lineJoin = 'round';
  for (const { values, behind, colour } of series) {
    g.strokeStyle = colour;
    g.beginPath();
    let drawing = false;
    const n = values.length;
    for (let i = 0; i < n; ++i) {
      const age = (n - 1 - i + behind) * step;
      if (age > seconds || Number.isNaN(values[i])) { drawing = false; continue; }
      if (drawing) g.lineTo(x(age), y(Math.min(values[i], most)));
      else g.moveTo(x(age), y(Math.min(values[i], most)));
      drawing = true;
    }
    g.stroke();
  }
}

// counts in the bins of server/observe/health.h; begins: each bin's beginning [µs].
export function histogram(canvas, counts, begins, ticks) {
  const { g, w, h } = begin(canvas), bottom = 14;
  const most = Math.max(...counts, 1);
  const first = begins[1], last = begins[begins.length - 1];
  const x = us => w * Math.log(Math.max(us, first) / first) / Math.log(last / first);
  g.fillStyle = variable('--plot');
  g.fillRect(0, h - bottom, w, 1);
  g.fillStyle = variable('--quiet');
  g.textBaseline = 'bottom';
  for (const [us, name] of ticks) {
    g.textAlign = x(us) < 8 ? 'left' : x(us) > w - 12 ? 'right' : 'center';
    g.fillText(name, x(us), h);
    g.fillRect(Math.round(x(us)), h - bottom, 1, 3);
  }
  g.fillStyle = variable('--accent');
  counts.forEach((n, i) => {
    if (!n) return;
    const from = x(begins[i]), to = i + 1 < begins.length ? x(begins[i + 1]) : w;
    // The square root: rare and late ones are what matters.
    const tall = Math.max((h - bottom - 3) * Math.sqrt(n / most), 1.5);
    g.fillRect(from, h - bottom - tall, Math.max(to - from - 0.5, 1), tall);
  });
}

export function percentile(counts, begins, p) {
  const all = counts.reduce((a, b) => a + b, 0);
  if (!all) return NaN;
  let below = 0;
  for (let i = 0; i < counts.length; ++i)
    if ((below += counts[i]) >= p / 100 * all) return i + 1 < begins.length ? (begins[i] + begins[i + 1]) / 2 : begins[i];
  return begins[begins.length - 1];
}

// parts [ms] from left to right; whole: the length of the bar [ms].
export function bar(canvas, parts, colours, whole) {
  const { g, w, h } = begin(canvas);
  g.fillStyle = variable('--plot');
  g.fillRect(0, 0, w, h);
  let x = 0;
  parts.forEach((ms, i) => {
    const wide = w * ms / whole;
    g.fillStyle = colours[i];
    g.fillRect(x, 0, Math.max(wide - 0.5, 0), h);
    x += wide;
  });
}
