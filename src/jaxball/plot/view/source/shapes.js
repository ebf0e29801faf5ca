// What the scene is made of: lines of some pixels' width, rods and arrows.

import { ConeGeometry, CylinderGeometry, Group, Matrix4, Mesh, Object3D, Quaternion, Vector3 } from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import { paint, solid } from "./materials.js";

// Segments between the points 2 j and 2 j + 1, each three numbers.
export function segments(points, colour, width, options = {}) {
  const geometry = new LineSegmentsGeometry();
  geometry.setPositions(points);
  const material = paint(new LineMaterial({ linewidth: width, ...options }), colour);
  const found = new LineSegments2(geometry, material);
  found.frustumCulled = false;
  if (options.dashed) found.computeLineDistances();
  return found;
}

// The points of a curve as those of its segments.
export function curve(points) {
  const found = [];
  for (let j = 0; j + 3 < points.length; j += 3) for (let i = 0; i < 6; i++) found.push(points[j + i]);
  return found;
}

export function circle(point, count = 96) {
  const points = [];
  for (let j = 0; j <= count; j++) points.push(...point((2 * Math.PI * j) / count));
  return curve(points);
}

const up = new Vector3(0, 1, 0);
const turn = new Quaternion();

// A rod of unit length, to be laid between two points.
export class Rod extends Mesh {
  constructor(radius, material) {
    super(new CylinderGeometry(radius, radius, 1, 12), material);
  }

  between(a, b) {
    const along = b.clone().sub(a);
    const length = along.length();
    this.visible = length > 1e-9;
    if (!this.visible) return;
    this.position.copy(a).addScaledVector(along, 0.5);
    this.scale.set(1, length, 1);
    this.quaternion.copy(turn.setFromUnitVectors(up, along.divideScalar(length)));
  }
}

export class Arrow extends Group {
  constructor(r, colour) {
    super();
    this.r = r;
    const material = solid(colour);
    this.shaft = new Mesh(new CylinderGeometry(0.018 * r, 0.018 * r, 1, 12), material);
    this.head = new Mesh(new ConeGeometry(0.055 * r, 0.16 * r, 20), material);
    this.tip = new Object3D(); // beside which its name is
    this.inner = new Group();
    this.inner.add(this.shaft, this.head, this.tip);
    this.add(this.inner);
  }

  set(from, vector) {
    const length = vector.length();
    this.inner.visible = Number.isFinite(length) && length > 0.02 * this.r;
    if (!this.inner.visible) return;
    const head = Math.min(0.16 * this.r, 0.6 * length);
    this.head.scale.setScalar(head / (0.16 * this.r));
    this.head.position.y = length - head / 2;
    this.tip.position.y = length + 0.07 * this.r;
    this.shaft.scale.y = length - head;
    this.shaft.position.y = (length - head) / 2;
    this.position.copy(from);
    this.quaternion.setFromUnitVectors(up, vector.clone().divideScalar(length));
  }
}

const SUBSCRIPTS = "₁₂₃";

// Three axes from a point with their ends' names: those of a body are dashed, those of space are not.
export function axesFrom(foot, ends, colours, letter, width, options = {}) {
  const found = new Group();
  found.names = ends.map((end, j) => {
    found.add(segments([...foot, ...end], colours[j], width, options));
    const tip = new Object3D();
    tip.position.fromArray(end.map((value, i) => value + 0.08 * (value - foot[i])));
    found.add(tip);
    return [tip, letter + SUBSCRIPTS[j], colours[j]];
  });
  return found;
}

export function bodyAxes(r, colours, letter) {
  const ends = [0, 1, 2].map((j) => [0, 1, 2].map((i) => (i === j ? 1.25 * r : 0)));
  const dashed = { dashed: true, dashSize: 0.09 * r, gapSize: 0.05 * r };
  return axesFrom([0, 0, 0], ends, colours, letter, 2.4, dashed);
}

export function matrixOf(rows) {
  const [a, b, c] = rows;
  return new Matrix4().set(...a, 0, ...b, 0, ...c, 0, 0, 0, 0, 1);
}
