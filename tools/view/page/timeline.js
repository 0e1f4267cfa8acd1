// Play, pause and seek in a recording; shared by all who look at it.
const $ = id => document.getElementById(id);

export class Timeline {
  constructor(connection) {
    this.connection = connection;
    this.playing = false;
    this.dragging = false;
    $('play').addEventListener('click', () => this.toggle());
    $('seek').addEventListener('input', () => { this.dragging = true; this.seek(Number($('seek').value)); });
    $('seek').addEventListener('change', () => { this.dragging = false; });
    $('speed').addEventListener('change', () => this.say({ speed: Number($('speed').value) }));
  }
  say(what) { this.connection.send({ timeline: what }); }
  toggle() { this.say({ playing: !this.playing }); }
  seek(t) { this.say({ seek: t }); }
  by(seconds) { this.seek(Math.min(Math.max(this.t + seconds, 0), this.duration)); }

  take({ t, duration, ready, playing, speed, done, failure, name }) {
    Object.assign(this, { t, duration, ready, playing, done });
    $('timeline').hidden = false;
    $('stage').classList.add('recorded');
    $('seek').max = duration;
    if (!this.dragging) $('seek').value = t;
    $('play').textContent = playing ? '❚❚' : '▶';
    $('speed').value = String(speed);
    $('time').textContent = `${t.toFixed(1)} / ${duration.toFixed(1)} s`;
    const state = failure ? `stopped at ${ready.toFixed(1)} s: ${failure}`
      : done ? `${name}: the motion as recorded, the tissue computed again`
      : `${name}: computed to ${ready.toFixed(0)} of ${duration.toFixed(0)} s`;
    $('footer').textContent = state;
  }
}
