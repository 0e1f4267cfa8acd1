// An instrument as its primitives, the places where it touches, and the forces that it feels there; and all of a scene.
import * as THREE from './vendor/three.module.min.js';
import { STEEL, variable } from './colour.js';
import { matter } from './material.js';
import { PRESSED_TISSUE } from './protocol.js';

const MOST_CONTACTS = 128;
const TRIANGLE = 3;  // a record of nine coordinates
const TINT = 0.3;  // of an instrument's colour in its steel

function primitive(shape, radius, half) {
  const geometry = shape === 0 ? new THREE.SphereGeometry(radius, 24, 16)
    : shape === 1 ? new THREE.CapsuleGeometry(radius, 2 * half, 8, 24)
    : new THREE.CylinderGeometry(radius, radius, 2 * half, 28);
  return geometry.rotateX(Math.PI / 2);  // three's length is along y, ours along z
}

class Instrument {
  constructor(accent) {
    this.accent = accent;  // the name of a CSS variable
    this.group = new THREE.Group();
    this.body = new THREE.Group();
    this.steel = matter(STEEL, 0.22);
    this.ink = new THREE.MeshBasicMaterial({ color: variable(accent) || 0x1f6fb2, depthTest: false, transparent: true });
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
    this.total = new THREE.Vector3();
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
    const corners = [];  // of the triangles of convex parts
    for (let i = 0; i + 10 <= list.length; i += 10) {
      if (list[i] === TRIANGLE) {
        corners.push(...list.slice(i + 1, i + 10));
        continue;
      }
      const mesh = new THREE.Mesh(primitive(list[i], list[i + 1], list[i + 2]), this.steel);
      mesh.position.set(list[i + 3], list[i + 4], list[i + 5]);
      mesh.quaternion.set(list[i + 6], list[i + 7], list[i + 8], list[i + 9]);
      this.body.add(mesh);
    }
    if (corners.length) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(corners), 3));
      geometry.computeVertexNormals();
      this.body.add(new THREE.Mesh(geometry, this.steel));
    }
    this.tip = list.length >= 10 && list[0] !== TRIANGLE ? list[1] : 0.001;
  }

  setPose([x, y, z, qx, qy, qz, qw], now, interval) {
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
  }

  setContacts(contacts) {
    this.contacts = contacts.slice(0, MOST_CONTACTS);
    this.total = this.contacts.reduce((sum, c) => sum.add(c.force), new THREE.Vector3());
  }

  // scale: metres per newton; size: of the scene.
  arrows(scale, size) {
    const m = new THREE.Matrix4(), q = new THREE.Quaternion(), total = this.total;
    const up = new THREE.Vector3(0, 1, 0), thin = 0.0042 * size;
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

  // tinted: one of several, to be told from the others.
  recolour(tinted) {
    this.ink.color.set(variable(this.accent));
    const { r, g, b } = this.ink.color.getRGB({}, THREE.SRGBColorSpace), part = tinted ? TINT : 0;
    this.steel.uniforms.own.value.fromArray([r, g, b].map((c, i) => STEEL[i] + part * (c - STEEL[i])));
  }

  dispose() {
    this.setShape([]);
    this.steel.dispose();
    this.ink.dispose();
    for (const mesh of [this.shafts, this.heads, this.dots]) { mesh.geometry.dispose(); mesh.dispose(); }
  }
}

export const accentOf = i => i === 0 ? '--accent' : `--accent-${i + 1}`;

// All of a scene, in its order; their forces have one scale.
export class Instruments {
  constructor() {
    this.group = new THREE.Group();
    this.list = [];
    this.size = 0.01;
    this.largest = 0;
    this.setShapes([{ name: '', device: null, primitives: [] }]);
  }

  get first() { return this.list[0]; }
  get contacts() { return this.list.flatMap(i => i.contacts); }
  ofDevice(id) { return this.list.find(i => i.device === id) ?? this.first; }

  setShapes(described) {
    while (this.list.length > Math.max(described.length, 1)) {
      const gone = this.list.pop();
      this.group.remove(gone.group);
      gone.dispose();
    }
    if (!described.length) this.first.setShape([]);
    described.forEach(({ name, device, primitives }, i) => {
      if (!this.list[i]) {
        this.list.push(new Instrument(accentOf(i)));
        this.list[i].forces.visible = this.first.forces.visible;
        this.group.add(this.list[i].group);
      }
      Object.assign(this.list[i], { name, device });
      this.list[i].setShape(primitives);
    });
  }

  setContacts({ instruments, contacts, pressing }, now, interval) {
    this.list.forEach((tool, i) => {
      if (7 * i + 7 <= instruments.length) tool.setPose(instruments.subarray(7 * i, 7 * i + 7), now, interval);
    });
    const felt = this.list.map(() => []);
    for (let c = 0; 7 * c + 7 <= contacts.length; ++c) {
      const [x, y, z, fx, fy, fz] = contacts.subarray(7 * c, 7 * c + 6), [by, on] = pressing.subarray(2 * c, 2 * c + 2);
      // On an instrument: what a hand feels.
      felt[by]?.push({ place: new THREE.Vector3(x, y, z), force: new THREE.Vector3(-fx, -fy, -fz) });
      if (on !== PRESSED_TISSUE) felt[on]?.push({ place: new THREE.Vector3(x, y, z), force: new THREE.Vector3(fx, fy, fz) });
    }
    this.list.forEach((tool, i) => tool.setContacts(felt[i]));
    this.arrows();
  }
  clearContacts() {
    for (const tool of this.list) tool.setContacts([]);
    this.arrows();
  }
  arrows() {
    this.largest = Math.max(0.995 * this.largest, ...this.list.map(i => i.total.length()), 1e-4);
    for (const tool of this.list) tool.arrows(0.42 * this.size / this.largest, this.size);
  }

  advance(now) { return this.list.map(i => i.advance(now)).some(Boolean); }
  // Whose device nobody holds; devices: as in a status.
  ghosts(devices) {
    const held = ({ device }) => ((devices.find(d => d.id === device) ?? (this.list.length > 1 ? null : devices[0]))?.status ?? 1) & 1;
    return this.list.map(i => i.ghost(Boolean(held(i)))).some(Boolean);
  }
  showForces(on) { for (const tool of this.list) tool.forces.visible = on; }
  recolour() { for (const tool of this.list) tool.recolour(this.list.length > 1); }
}
