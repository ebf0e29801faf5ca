// Of a run under feedback: the motion that it holds, as a ghost, and the estimate of its place with its ellipse.

import { Group, Matrix4, Vector3 } from "three";
import { row, STILL, UPRIGHT } from "./data.js";
import { circle, curve, segments } from "./shapes.js";
import { css, readable } from "./theme.js";
import { ON_MESH } from "./trace.js";

const LIFT = 0.012; // radii, of what lies on the plane

const UPWARDS = new Vector3(0, 0, 1);

// The outline of the shell, dashed, where the motion has it, and its whole path.
export class Ghost extends Group {
  constructor(run, points) {
    super();
    this.run = run;
    const r = run.radius;
    const dashed = { dashed: true, dashSize: 0.08 * r, gapSize: 0.06 * r, transparent: true, opacity: 0.75 };
    const soft = () => css("soft");
    const around = [(a) => [r * Math.cos(a), 0, r * Math.sin(a)]];
    if (run.body !== "disk") {
      around.push((a) => [r * Math.cos(a), r * Math.sin(a), 0], (a) => [0, r * Math.cos(a), r * Math.sin(a)]);
    }
    this.outline = new Group();
    this.outline.add(...around.map((point) => segments(circle(point), soft, 1.6, dashed)));
    this.outline.add(segments([0, 0, 0, r, 0, 0], soft, 1.6, dashed));
    this.path = segments(curve(points), soft, 1.6, dashed);
    this.add(this.outline, this.path);
  }

  show(k) {
    this.path.position.fromArray(row(this.run.arrays.moved, k, STILL));
    this.path.quaternion.fromArray(row(this.run.arrays.carried, k, UPRIGHT));
    this.outline.position.fromArray(row(this.run.arrays.nominal_centre, k));
    this.outline.quaternion.fromArray(row(this.run.arrays.nominal_quaternion, k));
  }
}

// A cross where the body is thought to be, and the ellipse around it.
export class Estimate extends Group {
  constructor(run, up, colour) {
    super();
    this.run = run;
    this.up = new Vector3(...up);
    const r = run.radius;
    const own = () => readable(colour);
    const [a, b] = [0.07 * r, new Vector3(1, 0, 0)];
    this.cross = segments([-a, 0, 0, a, 0, 0, 0, -a, 0, 0, a, 0], own, 2);
    this.ellipse = segments(circle((t) => [Math.cos(t), Math.sin(t), 0]), own, 2);
    this.ellipse.matrixAutoUpdate = false;
    this.axes = [new Vector3(), b, new Matrix4()];
    this.add(this.cross, this.ellipse);
  }

  show(k) {
    const { arrays, radius: r } = this.run;
    const [first, second, matrix] = this.axes;
    if (arrays.normal) this.up.fromArray(row(arrays.normal, k));
    this.cross.quaternion.setFromUnitVectors(UPWARDS, this.up);
    this.position.fromArray(row(arrays.estimate, k)).addScaledVector(this.up, (arrays.normal ? 1.1 * ON_MESH : LIFT) * r);
    const half = row(arrays.ellipse, k);
    this.ellipse.matrix.copy(matrix.makeBasis(first.fromArray(half), second.fromArray(half, 3), this.up));
    this.ellipse.matrixWorldNeedsUpdate = true;
  }
}
