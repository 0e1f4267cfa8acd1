// Asks haptic fleet for a station's view, and goes there.
import { connect } from '/connection.js';

document.documentElement.dataset.theme = sessionStorage.getItem('theme') ?? (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light');
const $ = id => document.getElementById(id);
const station = new URLSearchParams(location.search).get('station') ?? '';
$('title').textContent = `Opening ${station || 'the station without a name'} …`;

let asked = false;
const socket = connect(message => {
  if (message.kind === 'fleet' && !message.names.includes(station)) $('says').textContent = 'This station is not heard.';
  if (message.kind !== 'view' || message.station !== station || !asked) return;
  if (message.fault) $('says').textContent = message.fault;
  else if (message.port) location.replace(`${location.protocol}//${location.hostname}:${message.port}/`);
}, is => {
  if (is) setTimeout(() => { asked = true; socket.send({ open: station }); }, 0);
});
