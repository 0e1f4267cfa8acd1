// The page: what comes over the connection goes to the stage and to the strip; keys and buttons say how to look.
import * as THREE from './vendor/three.module.min.js';
import { CUT_FACE, LOOSE_PIECE, TISSUE, cividis, css, variable } from './colour.js';
import { connect } from './connection.js';
import { Hand } from './hand.js';
import { Instruments, accentOf } from './instrument.js';
import { Operation } from './operation.js';
import { Stage } from './stage.js';
import { Strip } from './strip.js';
import { theme } from './theme.js';
import { Timeline } from './timeline.js';
import { Tissue } from './tissue.js';

const $ = id => document.getElementById(id);
const LOOKS = ['solid', 'glass', 'hidden'];

const stage = new Stage($('canvas'));
const tools = new Instruments();
const strip = new Strip();
const operation = new Operation();
const bodies = new Map();
const counts = { states: 0, errors: [] };
let scene = { bodies: [], instruments: [] };
let connected = false, framed = false, wire = false, recorded = false;
stage.scene.add(tools.group);

window.addEventListener('error', e => counts.errors.push(e.message));

const connection = connect(take, now => {
  connected = now;
  banner();
});
const timeline = new Timeline(connection);
const hand = new Hand(stage, connection,
  device => {
    const held = tools.ofDevice(device);
    return held.body.visible ? held.to.p.clone() : null;
  },
  device => {
    const box = bounds();
    const centre = box.getCenter(new THREE.Vector3());
    return new THREE.Vector3(centre.x, centre.y, box.max.z + 2 * (tools.ofDevice(device).tip ?? 0));
  });

const recolour = () => {
  stage.recolour();
  tools.recolour();
  const dark = document.documentElement.dataset.theme === 'dark';
  for (const body of bodies.values()) { body.onDark(dark); body.wireframe(wire, variable('--ink')); }
  strip.dirty = true;
  legend();
};

function take(message) {
  const now = performance.now();
  switch (message.kind) {
    case 'scene': return takeScene(message);
    case 'rest': bodies.get(message.body)?.setRest(message.nodes); break;
    case 'surface':
      bodies.get(message.body)?.setSurface(message);
      size();
      break;
    case 'motion': {
      const body = bodies.get(message.body);
      if (!body) return;
      body.setMotion(message, now);
      ++counts.states;
      break;
    }
    case 'contacts':
      tools.setContacts(message, now, [...bodies.values()].find(b => b.to)?.interval ?? 40);
      break;
    case 'status':
      strip.takeStatus(message);
      if (!message.daemon) operation.clear();
      if (tools.ghosts(message.devices)) stage.touch();
      name(message);
      banner();
      return;
    case 'health': strip.takeHealth(message); hand.setMap(message); return;
    case 'operation': operation.take(message); return;
    case 'timeline': recorded = true; timeline.take(message); return;
    case 'hand': hand.take(message); return;
  }
  if (!framed && ready()) { stage.frameBox(bounds(), all()); framed = true; }
  stage.touch();
}

function takeScene(message) {
  scene = message;
  const ids = new Set(message.bodies.map(b => b.id));
  for (const [id, body] of bodies)
    if (!ids.has(id) || !same(body.info, message.bodies.find(b => b.id === id))) {
      stage.scene.remove(body.group);
      body.dispose();
      bodies.delete(id);
      framed = false;
    }
  for (const info of message.bodies) {
    if (bodies.has(info.id)) continue;
    const body = new Tissue(info);
    bodies.set(info.id, body);
    stage.scene.add(body.group);
    body.colour($('colour').value);
  }
  tools.setShapes(message.instruments);
  tools.ghosts(strip.status.devices);
  strip.takeScene(message);
  operation.takeScene(message);
  buttons();
  size();
  recolour();
}
const same = (a, b) => a.name === b.name && a.nodes === b.nodes && a.tets === b.tets;
const ready = () => bodies.size === scene.bodies.length && bodies.size > 0 && [...bodies.values()].every(b => b.vertexNode);

// Of what deforms; of everything where nothing does.
function bounds() {
  const box = new THREE.Box3();
  const soft = [...bodies.values()].filter(b => b.info.deformable);
  for (const body of soft.length ? soft : bodies.values()) box.union(body.box());
  tools.size = box.getSize(new THREE.Vector3()).length();
  return box;
}

const all = () => [...bodies.values()].reduce((box, b) => box.union(b.box()), new THREE.Box3());

function banner() {
  const text = !connected ? 'Disconnected: haptic view has ended, or cannot be reached' :
      !strip.status.daemon && !recorded ?
                            `Disconnected: no daemon is heard in DDS domain ${strip.status.domain ?? 0}` :
                            '';
  $('banner').hidden = !text;
  $('banner').textContent = text;
  if (text) { tools.clearContacts(); stage.touch(); }
}
function name(status) {
  const of = status.devices[0]?.scene;
  if (of) $('scene-name').textContent = of;
  document.title = of ? `${of} – haptic view` : 'haptic view';
}
function size() {
  const soft = scene.bodies.filter(b => b.deformable);
  $('scene-size').textContent = soft.map(b => `${b.name} ${b.tets - (bodies.get(b.id)?.removed ?? 0)} tetrahedra`).join(' · ');
}

function buttons() {
  $('bodies').replaceChildren(...scene.bodies.map((info, i) => {
    const button = document.createElement('button'), body = bodies.get(info.id);
    const say = () => {
      button.textContent = info.name;
      button.setAttribute('aria-pressed', String(body.group.visible));
      button.title = `${i + 1}: solid, glass or hidden; now ${look(body)}`;
    };
    button.addEventListener('click', () => {
      body.show(LOOKS[(LOOKS.indexOf(look(body)) + 1) % LOOKS.length]);
      say();
      stage.touch();
    });
    say();
    return button;
  }));
}
const look = body => !body.group.visible ? 'hidden' : body.glassy ? 'glass' : 'solid';

function legend() {
  const by = $('colour').value, list = $('legend');
  list.replaceChildren();
  const key = (rgb, text) => {
    const row = document.createElement('div'), dot = document.createElement('i');
    row.className = 'key';
    dot.style.background = typeof rgb === 'string' ? rgb : css(rgb);
    row.append(dot, text);
    list.append(row);
  };
  if (by === 'plain') {
    key(TISSUE, 'tissue');
    key(CUT_FACE, 'exposed by the tip');
    key(LOOSE_PIECE, 'came loose');
  } else {
    const map = document.createElement('div'), canvas = document.createElement('canvas'), ends = document.createElement('span');
    map.className = 'map';
    canvas.width = 180;
    canvas.height = 1;
    const g = canvas.getContext('2d');
    for (let x = 0; x < 180; ++x) { g.fillStyle = css(cividis(x / 179)); g.fillRect(x, 0, 1, 1); }
    ends.innerHTML = '<span>0</span><span id="legend-most"></span>';
    map.append(canvas, ends);
    list.append(map);
  }
  const several = scene.instruments.length > 1;
  (several ? scene.instruments : [null]).forEach((of, i) =>
    key(variable(accentOf(i)), several ? `force on ${of.name}` : 'force on the tip'));
}
function legendMost() {
  const most = $('legend-most');
  if (!most) return;
  const by = $('colour').value;
  const largest = Math.max(0, ...[...bodies.values()].filter(b => !b.glassy).map(b => b.scale(by)));
  most.textContent = by === 'displacement' ? `${(1000 * largest).toFixed(2)} mm moved` : `${(100 * largest).toFixed(0)} % strain`;
}

function toggle(id, act) {
  const on = $(id).getAttribute('aria-pressed') !== 'true';
  $(id).setAttribute('aria-pressed', String(on));
  act(on);
  stage.touch();
}
$('wireframe').addEventListener('click', () => toggle('wireframe', on => {
  wire = on;
  for (const body of bodies.values()) body.wireframe(on, variable('--ink'));
}));
$('forces').addEventListener('click', () => toggle('forces', on => tools.showForces(on)));
$('reset').addEventListener('click', () => { if (ready()) stage.frameBox(bounds(), all()); });
$('colour').addEventListener('change', () => {
  for (const body of bodies.values()) body.colour($('colour').value);
  legend();
  stage.touch();
});
theme($('theme'), recolour);

window.addEventListener('keydown', e => {
  if (e.ctrlKey || e.metaKey || e.altKey || e.target.matches('select, input')) return;
  const key = e.key.toLowerCase();
  const onButton = e.target.matches('button');
  if (hand.held && (key === ' ' || key === 'a')) { hand.pedal(key === ' ' ? 1 : 2, true); e.preventDefault(); return; }
  const turn = { arrowleft: [-0.08, 0], arrowright: [0.08, 0], arrowup: [0, 0.08], arrowdown: [0, -0.08] }[key];
  if (turn && hand.held) hand.move(200 * turn[0], -200 * turn[1], 0);
  else if (turn) stage.turn(...turn);
  else if (key === '+' || key === '=') stage.zoom(0.9);
  else if (key === '-') stage.zoom(1.1);
  else if (hand.held && (key === 'w' || key === 's')) hand.move(0, 0, key === 'w' ? 8 : -8);
  else if (key === 'w') $('wireframe').click();
  else if (key === 'f') $('forces').click();
  else if (key === 'r') $('reset').click();
  else if (key === 'd') $('theme').click();
  else if (key === 'h' && !$('hand').hidden) hand.toggle();
  else if (key === 'c') { $('colour').selectedIndex = ($('colour').selectedIndex + 1) % 3; $('colour').dispatchEvent(new Event('change')); }
  else if (key === ' ' && recorded && !onButton) timeline.toggle();
  else if (key === ',' && recorded) timeline.by(-0.5);
  else if (key === '.' && recorded) timeline.by(0.5);
  else if (/^[1-9]$/.test(key)) $('bodies').children[Number(key) - 1]?.click();
  else return;
  e.preventDefault();
});
window.addEventListener('keyup', e => {
  if (e.key === ' ') hand.pedal(1, false);
  if (e.key.toLowerCase() === 'a') hand.pedal(2, false);
});
window.addEventListener('blur', () => { hand.buttons = 0; });
// Nobody holds what nobody looks at.
document.addEventListener('visibilitychange', () => { if (document.hidden && hand.held) hand.release(); });

stage.onFrame = now => {
  let moved = false;
  for (const body of bodies.values()) moved = body.advance(now) || moved;
  moved = tools.advance(now) || moved;
  if (moved) legendMost();
  strip.draw(now);
  return moved;
};

const largest = values => Math.max(0, ...values.filter(v => !Number.isNaN(v)));

// For tests and for whoever is curious.
window.hapticView = {
  stage, strip, timeline, hand, tools, bodies,
  get instrument() { return tools.first; },
  figures: () => ({
    connected, daemon: strip.status.daemon, states: counts.states, frames: stage.frames, errors: counts.errors,
    ratio: stage.ratio, removed: [...bodies.values()].reduce((n, b) => n + b.removed, 0),
    triangles: [...bodies.values()].reduce((n, b) => n + b.triangles(), 0),
    cut: [...bodies.values()].reduce((n, b) => n + b.cutTriangles(), 0),
    happened: operation.happened.length, blocks: strip.blocks, force: largest(strip.force), contacts: tools.contacts.length,
    tools: tools.list.map(i => ({ name: i.name, device: i.device, shown: i.body.visible, held: !i.steel.transparent, contacts: i.contacts.length })),
    traces: strip.traces().map(t => ({ id: t.id, name: t.name, force: largest(t.force), blocks: t.blocks })),
  }),
};
