// The instrument as its primitives, the places where it touches, and the forces that it feels there.
import * as THREE from './vendor/three.module.min.js';
import { STEEL, variable } from './colour.js';
import { matter } from './material.js';

const MOST_CONTACTS = 128;

function primitive(shape, radius, half) {
  const geometry = shape === 0 ? new THREE.SphereGeometry(radius, 24, 16)
    : shape === 1 ? new THREE.CapsuleGeometry(radius, 2 * half, 8, 24)
    : new THREE.CylinderGeometry(radius, radius, 2 * half, 28);
  return geometry.rotateX(Math.PI / 2);  // three's length is along y, ours along z
}

export class Instrument {
  constructor() {
    this.group = new THREE.Group();
    this.body = new THREE.Group();
    this.steel = matter(STEEL, 0.22);
    const accent = { color: 0x1f6fb2, depthTest: false, transparent: true };
    this.ink = new THREE.MeshBasicMaterial(accent);
    const unit = new THREE.CylinderGeometry(1, 1, 1, 10).translate(0, 0.5, 0);
    this.shafts = new THREE.InstancedMesh(unit, this.ink, MOST_CONTACTS + 1);
    this.heads = new THREE.InstancedMesh(new THREE.ConeGeometry(1, 1, 14).translate(0, 0.5, 0), this.ink, MOST_CONTACTS + 1);
    this.dots = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 10, 8), this.ink, MOST_CONTACTS);
    for (const mesh of [this.shafts, this.heads, this.dots]) {
      mesh.count = 0;
      mesh.frustumCulled = false;
      mesh.renderOrder = 5;
    }
    this.forces = new THREE.Group();
    this.forces.add(this.shafts, this.heads, this.dots);
    this.group.add(this.body, this.forces);
    this.body.visible = false;
    this.size = 0.01;
    this.largest = 0;
    this.part = 1;
    this.from = { p: new THREE.Vector3(), q: new THREE.Quaternion() };
    this.to = { p: new THREE.Vector3(), q: new THREE.Quaternion() };
    this.contacts = [];
  }

  setShape(list) {
    for (const mesh of [...this.body.children]) {
      mesh.geometry.dispose();
      this.body.remove(mesh);
    }
    for (let i = 0; i + 10 <= list.length; i += 10) {
      const mesh = new THREE.Mesh(primitive(list[i], list[i + 1], list[i + 2]), this.steel);
      mesh.position.set(list[i + 3], list[i + 4], list[i + 5]);
      mesh.quaternion.set(list[i + 6], list[i + 7], list[i + 8], list[i + 9]);
      this.body.add(mesh);
    }
    this.tip = list.length >= 10 ? list[1] : 0.001;
  }

  setContacts({ instrument, contacts }, now, interval) {
    const [x, y, z, qx, qy, qz, qw] = instrument;
    // Nobody has moved it yet: it has no place.
    this.body.visible = !(x === 0 && y === 0 && z === 0 && qw === 1);
    this.from.p.copy(this.body.position);
    this.from.q.copy(this.body.quaternion);
    this.to.p.set(x, y, z);
    this.to.q.set(qx, qy, qz, qw);
    if (!this.placed) { this.from.p.copy(this.to.p); this.from.q.copy(this.to.q); }
    this.placed = this.body.visible;
    this.part = 0;
    this.began = now;
    this.interval = interval;
    this.contacts = [];
    for (let i = 0; i + 7 <= contacts.length && this.contacts.length < MOST_CONTACTS; i += 7)
      this.contacts.push({
        place: new THREE.Vector3(contacts[i], contacts[i + 1], contacts[i + 2]),
        // On the tip: what a hand feels.
        force: new THREE.Vector3(-contacts[i + 3], -contacts[i + 4], -contacts[i + 5]),
      });
    this.arrows();
  }

  arrows() {
    const total = new THREE.Vector3();
    for (const c of this.contacts) total.add(c.force);
    this.largest = Math.max(0.995 * this.largest, total.length(), 1e-4);
    const scale = 0.42 * this.size / this.largest, m = new THREE.Matrix4(), q = new THREE.Quaternion();
    const up = new THREE.Vector3(0, 1, 0), thin = 0.0042 * this.size;
    let n = 0;
    const arrow = (place, force, thick) => {
      const length = scale * force.length();
      if (length < 2 * thick) return;
      q.setFromUnitVectors(up, force.clone().normalize());
      const head = Math.min(5 * thick, 0.6 * length);
      this.shafts.setMatrixAt(n, m.compose(place, q, new THREE.Vector3(thick, length - head, thick)));
      const from = place.clone().addScaledVector(force.clone().normalize(), length - head);
      this.heads.setMatrixAt(n, m.compose(from, q, new THREE.Vector3(2.4 * thick, head, 2.4 * thick)));
      ++n;
    };
    this.contacts.forEach((c, i) => {
      arrow(c.place, c.force, 0.6 * thin);
      this.dots.setMatrixAt(i, m.compose(c.place, q.identity(), new THREE.Vector3(thin, thin, thin).multiplyScalar(1.2)));
    });
    this.dots.count = this.contacts.length;
    if (this.contacts.length > 1) arrow(this.to.p, total, 1.5 * thin);
    this.shafts.count = this.heads.count = n;
    for (const mesh of [this.shafts, this.heads, this.dots]) mesh.instanceMatrix.needsUpdate = true;
    this.total = total;
  }

  advance(now) {
    if (this.part >= 1 || !this.body.visible) return false;
    this.part = Math.min(Math.max((now - this.began) / this.interval, 0), 1);
    this.body.position.lerpVectors(this.from.p, this.to.p, this.part);
    this.body.quaternion.slerpQuaternions(this.from.q, this.to.q, this.part);
    return true;
  }

  // Nobody holds it.
  ghost(on) {
    if (this.steel.transparent === on) return false;
    this.steel.transparent = on;
    this.steel.uniforms.opacity.value = on ? 0.22 : 1;
    this.steel.depthWrite = !on;
    this.steel.needsUpdate = true;
    return true;
  }

  recolour() { this.ink.color.set(variable('--accent')); }
}
