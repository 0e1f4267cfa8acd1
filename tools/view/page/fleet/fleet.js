// The stations' page: tiles by name, counts that filter, and on top whoever needs somebody.
import { connect } from '/connection.js';
import { theme } from '/theme.js';
import { Tile, complaint, shown } from '/fleet/tile.js';

const $ = id => document.getElementById(id);
const STATES = ['in use', 'idle', 'fault', 'lost', 'ended'];
const order = new Intl.Collator('en', { numeric: true });

const tiles = new Map();  // by the station's name
let names = [], only = null, connected = false, place = '';

const list = () => names.map(n => tiles.get(n)).filter(t => t?.station);

function arrange() {
  const wanted = names.map(n => tiles.get(n)).filter(t => t);
  const shownTiles = wanted.filter(t => !only || t.station?.state === only).map(t => t.element);
  const now = [...$('tiles').children];
  if (now.length !== shownTiles.length || now.some((e, i) => e !== shownTiles[i])) $('tiles').replaceChildren(...shownTiles);
  $('empty').hidden = !connected || names.length > 0;
}

function count() {
  const of = Object.fromEntries(STATES.map(s => [s, 0]));
  for (const t of list()) ++of[t.station.state];
  const buttons = [[null, names.length, names.length === 1 ? 'station' : 'stations'], ...STATES.filter(s => of[s] || s === only).map(s => [s, of[s], s])];
  const said = JSON.stringify([buttons, only]);
  if (said === count.said) return;
  count.said = said;
  $('states').replaceChildren(...buttons.map(([state, n, word]) => {
    const b = document.createElement('button'), strong = document.createElement('b');
    strong.textContent = n;
    b.append(strong, ` ${word}`);
    b.setAttribute('aria-pressed', String(state === only));
    b.addEventListener('click', () => { only = state === only ? null : state; count(); arrange(); });
    return b;
  }));
}

function attend() {
  const troubled = list().filter(t => t.station.state === 'lost' || t.station.state === 'fault');
  const said = JSON.stringify(troubled.map(t => [t.name, t.station.state, complaint(t.station)]));
  if (said === attend.said) return;
  attend.said = said;
  $('attention').replaceChildren(...troubled.map(t => {
    const item = document.createElement('li'), link = document.createElement('a'), strong = document.createElement('b');
    strong.textContent = shown(t.name);
    link.append(strong, ` ${t.station.state === 'lost' ? 'lost' : complaint(t.station)}`);
    link.className = t.station.state;
    link.href = `#station-${encodeURIComponent(t.name)}`;
    link.addEventListener('click', e => {
      e.preventDefault();
      only = null;
      arrange();
      count();
      t.element.scrollIntoView({ block: 'center' });
      t.element.focus();
    });
    item.append(link);
    return item;
  }));
}

function refresh() {
  arrange();
  count();
  attend();
  const troubled = list().filter(t => t.station.state === 'lost' || t.station.state === 'fault').length;
  document.title = `${troubled ? `(${troubled}) ` : ''}${names.length} ${names.length === 1 ? 'station' : 'stations'}`;
}

function take(message) {
  if (message.kind === 'fleet') {
    names = [...message.names].sort(order.compare);
    for (const name of tiles.keys()) if (!names.includes(name)) tiles.delete(name);
    if (place !== message.place) $('place').textContent = $('empty-place').textContent = place = message.place;
  } else if (message.kind === 'station') {
    if (!tiles.has(message.station)) tiles.set(message.station, new Tile(message.station));
    tiles.get(message.station).show(message);
  } else {
    return;
  }
  if (!refresh.asked) {
    refresh.asked = true;
    setTimeout(() => { refresh.asked = false; refresh(); }, 0);
  }
}

theme($('theme'), () => {});
const gone = $('banner');
connect(take, is => {
  connected = is;
  gone.hidden = is;
  gone.textContent = 'haptic fleet does not answer: what stands here is old';
  refresh();
});

window.hapticFleet = { figures: () => ({ connected, names, stations: Object.fromEntries(list().map(t => [t.name, t.station])) }) };
