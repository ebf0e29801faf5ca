// Paths up to the time that is shown: of contact points, of points of a body, or of a body as a whole.

import { Group, Quaternion, Vector3 } from "three";
import { modeAt, row, STILL, UPRIGHT } from "./data.js";
import { curve, segments } from "./shapes.js";
import { readable } from "./theme.js";

const ON_PLANE = 0.004; // radii from the ground, so that it is seen
export const ON_MESH = 0.06;

export class Trace extends Group {
  // Three numbers in `points` for each time of the body, without the motion of the ground.
  constructor(body, points, colour, width = 3, options = {}) {
    super();
    this.body = body;
    // A run of one time has a trace of one point.
    const whole = curve(points.length > 3 ? points : [...points, ...points]);
    this.line = segments(whole, () => readable(body.colour ?? colour), width, options);
    this.add(this.line);
  }

  show(k) {
    this.position.fromArray(row(this.body.arrays.moved, k, STILL));
    this.quaternion.fromArray(row(this.body.arrays.carried, k, UPRIGHT));
    this.line.geometry.instanceCount = k;
  }
}

// The path on a ground that changes its form, on the pieces of it that the body has touched.
export class TraceOnMatter extends Trace {
  constructor(body, columns, colour) {
    super(body, new Array(3 * body.times.length).fill(0), colour);
    this.columns = columns;
  }

  show(k) {
    super.show(k);
    const points = [];
    for (let i = 0; i <= k; i++) points.push(...this.touched(row(this.body.arrays.nodes, i), k));
    if (k > 0) this.line.geometry.setPositions(curve(points));
    this.line.geometry.instanceCount = k;
  }

  // The place of a piece, between four nodes of the mesh, at the k-th time.
  touched([line, column], k) {
    const mesh = row(this.body.arrays.mesh, k);
    const last = mesh.length / (3 * this.columns) - 2;
    const [i, j] = [Math.min(Math.floor(line), last), Math.min(Math.floor(column), this.columns - 2)];
    const node = (p, q) => new Vector3().fromArray(mesh, 3 * ((i + p) * this.columns + j + q));
    const [near, far] = [0, 1].map((p) => node(p, 0).lerp(node(p, 1), column - j));
    const normal = node(1, 1).sub(node(0, 0)).cross(node(0, 1).sub(node(1, 0))).normalize();
    return near.lerp(far, line - i).addScaledVector(normal, ON_MESH * this.body.radius).toArray();
  }
}

// The path of a body's lowest point: dashed where it slides, and dotted and above the plane where it flies.
export class Trail extends Group {
  constructor(body, points, colour, width = 3) {
    super();
    this.body = body;
    const r = body.radius;
    const looks = {
      rolling: {},
      sliding: { dashed: true, dashSize: 0.16 * r, gapSize: 0.08 * r },
      flight: { dashed: true, dashSize: 0.04 * r, gapSize: 0.06 * r },
    };
    const parts = Object.fromEntries(Object.keys(looks).map((mode) => [mode, { points: [], counts: [0] }]));
    for (let k = 0; k + 1 < body.times.length; k++) {
      const own = modeAt(body, (body.times[k] + body.times[k + 1]) / 2);
      for (const [mode, part] of Object.entries(parts)) {
        if (mode === own) part.points.push(...points.slice(3 * k, 3 * k + 6));
        part.counts.push(part.points.length / 6);
      }
    }
    this.lines = Object.entries(parts).filter(([, part]) => part.points.length).map(([mode, part]) => {
      const line = segments(part.points, () => readable(body.colour ?? colour), width, looks[mode]);
      this.add(line);
      return { line, counts: part.counts };
    });
  }

  show(k) {
    this.position.fromArray(row(this.body.arrays.moved, k, STILL));
    this.quaternion.fromArray(row(this.body.arrays.carried, k, UPRIGHT));
    for (const { line, counts } of this.lines) line.geometry.instanceCount = counts[k];
  }
}

// From the centre of a body to its lowest point.
export function footOf({ foot }, k, normal, r) {
  return foot ? new Vector3().fromArray(row(foot, k)) : normal.clone().multiplyScalar(-r);
}

// Those of a body, or of other places of its centre with the normals there, in axes that move with the ground.
export function contactPoints({ arrays, times, radius: r }, axes, centres = arrays.centre, normals = arrays.normal) {
  const up = axes.map((line) => line[2]);
  const above = normals ? ON_MESH : ON_PLANE;
  const [point, normal, turn] = [new Vector3(), new Vector3(), new Quaternion()];
  const points = [];
  for (let k = 0; k < times.length; k++) {
    normal.fromArray(row(normals, k, up));
    point.fromArray(row(centres, k)).sub(new Vector3().fromArray(row(arrays.moved, k, STILL)));
    point.addScaledVector(normal, above * r).add(footOf(arrays, k, normal, r));
    points.push(...point.applyQuaternion(turn.fromArray(row(arrays.carried, k, UPRIGHT)).invert()).toArray());
  }
  return points;
}

// The path of a vector in body axes, which `of` says for each time, from the body's centre.
export function turned({ arrays, times }, of) {
  const [vector, centre, turn] = [new Vector3(), new Vector3(), new Quaternion()];
  const points = [];
  for (let k = 0; k < times.length; k++) {
    vector.fromArray(of(k)).applyQuaternion(turn.fromArray(row(arrays.quaternion, k)));
    points.push(...vector.add(centre.fromArray(row(arrays.centre, k))).toArray());
  }
  return points;
}
