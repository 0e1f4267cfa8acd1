// The mouse as a hand: drags the target of a simulated device in the plane of the screen. Not a haptic device.
//
// Drag: across. Wheel, or W and S: away from the eye and towards it. Space: the phaco pedal; A: aspiration.
import * as THREE from './vendor/three.module.min.js';

const $ = id => document.getElementById(id);
const SEND_MS = 20;

export class Hand {
  constructor(stage, connection, whereIsTip, tissueTop) {
    Object.assign(this, { stage, connection, whereIsTip, tissueTop });
    this.held = false;
    this.buttons = 0;
    this.maps = new Map();  // of devices, into the scene
    this.device = null;     // that a hand may be; null: not told yet
    $('hand-take').addEventListener('click', () => this.toggle());
    $('scene-reset').addEventListener('click', () => this.connection.send({ reset: true }));
    const canvas = stage.canvas;
    canvas.addEventListener('pointerdown', e => { if (this.held) this.drag = { x: e.clientX, y: e.clientY }; });
    window.addEventListener('pointerup', () => { this.drag = null; });
    window.addEventListener('pointermove', e => {
      if (!this.held || !this.drag) return;
      this.move(e.clientX - this.drag.x, e.clientY - this.drag.y, 0);
      this.drag = { x: e.clientX, y: e.clientY };
    });
    canvas.addEventListener('wheel', e => {
      if (!this.held) return;
      e.preventDefault();
      this.move(0, 0, -0.3 * e.deltaY);
    }, { passive: false });
    setInterval(() => this.send(), SEND_MS);
  }

  take(message) {
    $('hand').hidden = false;
    this.state = message.state;
    this.device = message.device;
    const words = { arming: 'Arming …', holding: 'Drag moves the tip, wheel or W and S in depth, Space is the pedal.' };
    const said = message.failure || words[message.state] || 'Moves a simulated device with the mouse.';
    $('hand-says').innerHTML = '<span></span> <strong>Not a haptic device: nobody feels it.</strong>';
    $('hand-says').firstChild.textContent = said;
    if (message.state === 'off' && this.held && this.since && performance.now() - this.since > 1000) this.release();
  }

  setMap(health) {
    if (health.frame) this.maps.set(health.id, health);
  }
  get map() { return this.maps.get(this.device); }
  get frame() { return new THREE.Quaternion(...this.map.frame); }

  toggle() { this.held ? this.release() : this.begin(); }
  begin() {
    if (!this.map) return;
    this.held = true;
    this.since = performance.now();
    this.target = this.whereIsTip(this.device) ?? this.tissueTop(this.device);
    this.stage.controls.enabled = false;
    $('stage').classList.add('held');
    $('hand-take').setAttribute('aria-pressed', 'true');
    $('hand-take').textContent = 'let go';
  }
  release() {
    this.held = false;
    this.buttons = 0;
    this.connection.send({ hand: { active: false } });
    this.stage.controls.enabled = true;
    $('stage').classList.remove('held');
    $('hand-take').setAttribute('aria-pressed', 'false');
    $('hand-take').textContent = 'take the hand';
  }

  // Pixels right, down and away.
  move(right, down, away) {
    if (!this.held) return;
    const { camera, canvas } = this.stage;
    const metre = 2 * camera.position.distanceTo(this.target) * Math.tan(THREE.MathUtils.degToRad(camera.fov / 2)) / canvas.clientHeight;
    const axis = i => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, i);
    this.target.addScaledVector(axis(0), right * metre).addScaledVector(axis(1), -down * metre).addScaledVector(axis(2), -away * metre);
    this.confine();
  }
  pedal(bit, down) { this.buttons = down ? this.buttons | bit : this.buttons & ~bit; }

  // The scene's point in the device's frame (haptic/device.h).
  inDevice() {
    const { origin, position_scale } = this.map;
    return this.target.clone().sub(new THREE.Vector3(...origin)).applyQuaternion(this.frame.invert()).divideScalar(position_scale);
  }
  confine() {
    const device = this.inDevice(), most = 0.95 * this.map.workspace;
    if (device.length() <= most) return;
    device.setLength(most).multiplyScalar(this.map.position_scale).applyQuaternion(this.frame);
    this.target.copy(device.add(new THREE.Vector3(...this.map.origin)));
  }
  send() {
    if (!this.held || !this.map) return;
    this.confine();
    this.connection.send({ hand: { active: true, target: this.inDevice().toArray(), buttons: this.buttons } });
  }
}
