// A body on the stage: smooth where it was whole, in a second colour where it was cut, moved between two states.
//
// Triangles come by node. A node on the edge of a cut is two vertices, one of each side, so that neither normals nor
// colours run over the edge. Between two states the nodes go straight, in the time that states take to come: the picture
// is one state behind, and moves at the screen's rate.
import * as THREE from './vendor/three.module.min.js';
import { CUT, LOOSE } from './protocol.js';
import { CUT_FACE, LOOSE_PIECE, TISSUE, cividis } from './colour.js';
import { glass, matter } from './material.js';

// The least that the whole map stands for [m, –]: below it, it would show rounding.
const LEAST = { displacement: 1e-4, strain: 0.02 };

export class Tissue {
  constructor(info) {
    this.info = info;
    this.glassy = !info.deformable || info.shell;
    this.group = new THREE.Group();
    this.geometry = new THREE.BufferGeometry();
    this.solid = matter();
    this.glass = glass(info.deformable ? [0.55, 0.68, 0.74] : [0.5, 0.56, 0.62]);
    this.mesh = new THREE.Mesh(this.geometry, this.glassy ? this.glass : this.solid);
    this.lines = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ transparent: true, opacity: 0.28 }));
    this.lines.visible = false;
    this.mesh.frustumCulled = this.lines.frustumCulled = false;
    this.mesh.renderOrder = this.glassy ? 2 : 0;
    this.group.add(this.mesh, this.lines);
    this.rest = this.from = this.to = this.now = this.surface = null;
    this.part = 1;
    this.interval = 40;
    this.removed = 0;
    this.colouring = 'plain';
    this.largest = { displacement: 0, strain: 0 };
  }

  setRest(nodes) {
    this.rest = nodes;
    if (!this.now || this.now.length !== nodes.length) {
      this.now = new Float32Array(nodes);
      this.from = this.to = this.strain = null;
    }
    this.rebuild();
  }

  setSurface({ triangles, flags, removed }) {
    this.surface = { triangles, flags };
    this.removed = removed;
    this.rebuild();
  }

  setMotion({ nodes, strain }, now) {
    if (this.rest && nodes.length !== this.rest.length) return;
    const since = now - (this.arrived ?? now);
    this.arrived = now;
    if (since > 5 && since < 500) this.interval += 0.1 * (since - this.interval);
    this.strain = strain;
    if (!this.now || !this.to) {
      this.now = new Float32Array(nodes);
      this.from = this.now;
      this.part = 0.999;
    } else {
      this.from = this.now.slice();
      this.part = 0;
    }
    this.to = nodes;
    this.began = now;
    if (!this.vertexNode) this.rebuild();
  }

  // Vertices of the surface: a node and which side of a cut.
  rebuild() {
    if (!this.surface || !this.now) return;
    const { triangles, flags } = this.surface;
    const vertexOf = new Map(), nodes = [], sides = [];
    const index = new Uint32Array(triangles.length);
    for (let i = 0; i < triangles.length; ++i) {
      const node = triangles[i], side = flags[Math.floor(i / 3)];
      if (3 * node + 2 >= this.now.length) return;  // of another mesh: its nodes are still to come
      const key = 4 * node + side;
      let vertex = vertexOf.get(key);
      if (vertex === undefined) {
        vertex = nodes.length;
        vertexOf.set(key, vertex);
        nodes.push(node);
        sides.push(side);
      }
      index[i] = vertex;
    }
    this.vertexNode = Uint32Array.from(nodes);
    this.vertexSide = Uint8Array.from(sides);
    this.geometry.dispose();
    this.geometry.setIndex(new THREE.BufferAttribute(index, 1));
    for (const name of ['position', 'normal', 'color']) {
      const attribute = new THREE.BufferAttribute(new Float32Array(3 * nodes.length), 3);
      attribute.setUsage(THREE.DynamicDrawUsage);
      this.geometry.setAttribute(name, attribute);
    }
    this.edges = null;
    this.place();
  }

  edgeIndex() {
    const seen = new Set(), out = [], index = this.geometry.index.array;
    for (let i = 0; i < index.length; i += 3)
      for (const [a, b] of [[0, 1], [1, 2], [2, 0]]) {
        const p = Math.min(index[i + a], index[i + b]), q = Math.max(index[i + a], index[i + b]);
        const key = p * 1e6 + q;
        if (!seen.has(key)) { seen.add(key); out.push(p, q); }
      }
    return new THREE.BufferAttribute(Uint32Array.from(out), 1);
  }

  // Moves on to the instant; true if anything moved.
  advance(now) {
    if (!this.to || this.part >= 1 || !this.vertexNode) return false;
    this.part = Math.min(Math.max((now - this.began) / this.interval, 0), 1);
    const { now: x, from, to } = this, f = this.part;
    for (let i = 0; i < x.length; ++i) x[i] = from[i] + f * (to[i] - from[i]);
    this.place();
    return true;
  }

  place() {
    const position = this.geometry.attributes.position, p = position.array, { now: x, vertexNode } = this;
    for (let v = 0; v < vertexNode.length; ++v) {
      const n = 3 * vertexNode[v];
      p[3 * v] = x[n]; p[3 * v + 1] = x[n + 1]; p[3 * v + 2] = x[n + 2];
    }
    position.needsUpdate = true;
    this.geometry.computeVertexNormals();
    this.paint();
    if (this.lines.visible) {
      this.edges ??= this.edgeIndex();
      this.lines.geometry.setAttribute('position', position);
      this.lines.geometry.setIndex(this.edges);
    }
  }

  paint() {
    if (this.glassy || !this.vertexNode) return;
    const colour = this.geometry.attributes.color, c = colour.array;
    const value = this.scalar();
    for (let v = 0; v < this.vertexNode.length; ++v) {
      const of = value ? cividis(value(this.vertexNode[v]))
        : this.vertexSide[v] & LOOSE ? LOOSE_PIECE : this.vertexSide[v] & CUT ? CUT_FACE : TISSUE;
      c[3 * v] = of[0]; c[3 * v + 1] = of[1]; c[3 * v + 2] = of[2];
    }
    colour.needsUpdate = true;
  }

  // Of a node, over the largest there was; null: plain.
  scalar() {
    if (this.colouring === 'displacement' && this.rest) {
      const far = n => Math.hypot(this.now[3 * n] - this.rest[3 * n], this.now[3 * n + 1] - this.rest[3 * n + 1],
                                  this.now[3 * n + 2] - this.rest[3 * n + 2]);
      return this.scaled('displacement', far);
    }
    if (this.colouring === 'strain' && this.strain) return this.scaled('strain', n => this.strain[n]);
    return null;
  }
  scaled(name, of) {
    let largest = this.largest[name];
    for (const n of this.vertexNode) largest = Math.max(largest, of(n));
    this.largest[name] = largest;
    const scale = 1 / Math.max(largest, LEAST[name]);
    return n => scale * of(n);
  }
  // What the end of the map stands for.
  scale(name) { return Math.max(this.largest[name] ?? 0, LEAST[name] ?? 0); }

  colour(by) {
    this.colouring = by;
    this.largest = { displacement: 0, strain: 0 };
    this.paint();
  }
  wireframe(on, ink) {
    this.lines.visible = on && !this.glassy;
    this.lines.material.color.set(ink);
    if (on && this.vertexNode) this.place();
  }
  // solid, glass or hidden
  show(how) {
    this.glassy = how === 'glass';
    this.group.visible = how !== 'hidden';
    this.mesh.material = this.glassy ? this.glass : this.solid;
    this.mesh.renderOrder = this.glassy ? 2 : 0;
    this.paint();
  }
  onDark(dark) { this.glass.uniforms.strength.value = dark ? 1 : 1.35; }

  box() { return this.now ? new THREE.Box3().setFromArray(this.now) : new THREE.Box3(); }
  triangles() { return this.surface ? this.surface.triangles.length / 3 : 0; }
  cutTriangles() { return this.surface ? this.surface.flags.reduce((n, f) => n + (f & CUT), 0) : 0; }
  dispose() {
    this.geometry.dispose();
    this.lines.geometry.dispose();
    this.solid.dispose();
    this.glass.dispose();
  }
}
