// Camera, and the loop that draws: only when something changed, and with fewer pixels before fewer frames.
import * as THREE from './vendor/three.module.min.js';
import { OrbitControls } from './vendor/OrbitControls.js';
import { variable } from './colour.js';
import { drawnBySoftware } from './material.js';

const SLOW_MS = 30, FAST_MS = 12;
const LEAST_RATIO = 0.6;

export class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !drawnBySoftware(), powerPreference: 'high-performance' });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(32, 1, 1e-4, 10);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.addEventListener('change', () => this.touch());
    this.home = null;
    this.dirty = true;
    this.ratio = Math.min(devicePixelRatio, 2);
    this.cost = 0;
    this.frames = 0;
    this.onFrame = () => false;  // returns whether something moved
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
    requestAnimationFrame(() => this.frame());
  }

  touch() { this.dirty = true; }

  resize() {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    if (!w || !h) return;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(w, h, false);
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    this.touch();
  }

  recolour() {
    this.scene.background = new THREE.Color(variable('--ground'));
    this.touch();
  }

  // Looks at what matters in the middle of all there is, from the right, in front and above.
  frameBox(what, all) {
    const centre = what.getCenter(new THREE.Vector3()).lerp(all.getCenter(new THREE.Vector3()), 0.6);
    const radius = Math.max(what.getSize(new THREE.Vector3()).length() / 2, 1e-4);
    this.home = { centre, radius };
    this.reset();
  }
  reset() {
    if (!this.home) return;
    const { centre, radius } = this.home;
    const distance = 1.1 * radius / Math.sin(THREE.MathUtils.degToRad(this.camera.fov / 2));
    this.camera.position.copy(centre).addScaledVector(new THREE.Vector3(0.74, -0.5, 0.66).normalize(), distance);
    this.camera.near = radius / 50;
    this.camera.far = 40 * radius;
    this.controls.minDistance = radius / 10;
    this.controls.maxDistance = 12 * radius;
    this.controls.target.copy(centre);
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.touch();
  }
  turn(right, up) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const s = new THREE.Spherical().setFromVector3(new THREE.Vector3(offset.x, offset.z, -offset.y));
    s.theta += right;
    s.phi = Math.min(Math.max(s.phi - up, 0.05), Math.PI - 0.05);
    const v = new THREE.Vector3().setFromSpherical(s);
    this.camera.position.copy(this.controls.target).add(new THREE.Vector3(v.x, -v.z, v.y));
    this.controls.update();
    this.touch();
  }
  zoom(factor) {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
    this.touch();
  }

  frame() {
    requestAnimationFrame(() => this.frame());
    // Not the time that comes with the call: it is the frame's, and may lie before the newest message.
    const now = performance.now();
    const moved = this.onFrame(now);
    if (!moved && !this.dirty) return;
    this.dirty = false;
    const begun = performance.now();
    this.renderer.render(this.scene, this.camera);
    this.adapt(performance.now() - begun, now);
    if (moved) ++this.frames;
  }

  // Where drawing is by software, pixels are what costs.
  adapt(spent, now) {
    const between = now - (this.last ?? now);
    this.last = now;
    if (between > 0 && between < 200) this.cost += 0.1 * (Math.max(spent, between - 17) - this.cost);
    const most = Math.min(devicePixelRatio, 2);
    if (this.cost > SLOW_MS && this.ratio > LEAST_RATIO) this.setRatio(Math.max(LEAST_RATIO, this.ratio * 0.85));
    else if (this.cost < FAST_MS && this.ratio < most && now - (this.changed ?? 0) > 4000)
      this.setRatio(Math.min(most, this.ratio * 1.15));
  }
  setRatio(ratio) {
    this.ratio = ratio;
    this.cost = (SLOW_MS + FAST_MS) / 2;
    this.changed = performance.now();
    this.resize();
  }
}
