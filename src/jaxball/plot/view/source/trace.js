// Paths up to the time that is shown: of contact points, of points of a body, or of a body as a whole.

import { Group, Quaternion, Vector3 } from "three";
import { modeAt, row, STILL } from "./data.js";
import { curve, segments } from "./shapes.js";
import { readable } from "./theme.js";

export class Trace extends Group {
  // Three numbers in `points` for each time of the body, without the displacement of a plane that moves.
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
    this.line.geometry.instanceCount = k;
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
    for (const { line, counts } of this.lines) line.geometry.instanceCount = counts[k];
  }
}

export function contactPoints({ arrays, times, radius: r }, axes, centres = arrays.centre) {
  const up = axes.map((line) => line[2]);
  const points = [];
  for (let k = 0; k < times.length; k++) {
    const [centre, moved] = [row(centres, k), row(arrays.moved, k, STILL)];
    for (let j = 0; j < 3; j++) points.push(centre[j] - moved[j] - (r - 0.004 * r) * up[j]);
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
