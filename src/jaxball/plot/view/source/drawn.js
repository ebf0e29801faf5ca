// What a user's function of (t, q) draws: lines, and dots where a line has a single point.

import { Group, Mesh, SphereGeometry } from "three";
import { row } from "./data.js";
import { solid } from "./materials.js";
import { curve, segments } from "./shapes.js";
import { readable } from "./theme.js";

const WIDTH = 3; // pixels

export class Drawing extends Group {
  constructor(run) {
    super();
    this.run = run;
    this.masses = [];
    this.parts = run.lines.map((colour, i) => {
      const array = run.arrays[`line_${i}`];
      const paint = () => readable(run.colour ?? colour);
      const dot = array.width === 3;
      const part = dot
        ? new Mesh(new SphereGeometry(run.radius, 32, 20), solid(paint))
        : segments(curve(row(array, 0)), paint, WIDTH);
      this.add(part);
      return { part, array, dot };
    });
  }

  show(k) {
    for (const { part, array, dot } of this.parts) {
      if (dot) part.position.fromArray(row(array, k));
      else part.geometry.setPositions(curve(row(array, k)));
    }
  }
}

// A picture has no arrows.
export class NoArrows extends Group {
  named = [];

  show() {}
}
