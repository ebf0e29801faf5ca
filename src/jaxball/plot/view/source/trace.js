// Paths up to the time that is shown: of contact points, of points of a body, or of a body as a whole.

import { Group, Quaternion, Vector3 } from "three";
import { row, STILL } from "./data.js";
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

export function contactPoints({ arrays, times, radius: r }, axes) {
  const up = axes.map((line) => line[2]);
  const points = [];
  for (let k = 0; k < times.length; k++) {
    const [centre, moved] = [row(arrays.centre, k), row(arrays.moved, k, STILL)];
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
