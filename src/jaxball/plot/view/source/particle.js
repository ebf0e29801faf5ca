// Particles: dots, the box around their paths, on whose bottom these have a shadow, and the velocity.

import { Group, Mesh, SphereGeometry, Vector3 } from "three";
import { row } from "./data.js";
import { place } from "./labels.js";
import { solid } from "./materials.js";
import { Arrow, curve, segments } from "./shapes.js";
import { css, readable } from "./theme.js";

const FAINT = { transparent: true, opacity: 0.45 };
const ROOM = 1.5; // from the paths to the box, in radii

export class Particle extends Group {
  constructor(run, _components, { palette }) {
    super();
    this.run = run;
    this.masses = [];
    const colour = () => readable(run.colour ?? palette.components[0]);
    this.add(new Mesh(new SphereGeometry(0.6 * run.radius, 32, 20), solid(colour)));
  }

  show(k) {
    this.position.fromArray(row(this.run.arrays.centre, k));
  }
}

export class Velocity extends Group {
  constructor(body, { palette }, scales) {
    super();
    this.body = body;
    this.scales = scales;
    this.velocity = new Arrow(6 * body.run.radius, () => readable(palette.momentum));
    this.palette = palette;
    this.add(this.velocity);
  }

  get named() {
    return [[this.velocity, "v", this.palette.momentum]];
  }

  show(k) {
    const v = new Vector3().fromArray(row(this.body.run.arrays.velocity, k));
    this.velocity.set(this.body.position, v.multiplyScalar(this.scales.velocity));
  }
}

// The box with the axes of x, y and z at the corner where all are least.
export class Box extends Group {
  constructor({ bodies, palette }) {
    super();
    const [low, high] = extremes(bodies);
    const corner = (i, j, k) => [i ? high[0] : low[0], j ? high[1] : low[1], k ? high[2] : low[2]];
    const edges = [];
    this.corners = [];
    for (const i of [0, 1]) {
      for (const j of [0, 1]) {
        edges.push(...corner(0, i, j), ...corner(1, i, j), ...corner(i, 0, j), ...corner(i, 1, j));
        edges.push(...corner(i, j, 0), ...corner(i, j, 1));
        this.corners.push(corner(i, j, 0), corner(i, j, 1));
      }
    }
    this.frame = new Group();
    this.frame.add(segments(edges, () => css("grid"), 1));
    this.names = [corner(1, 0, 0), corner(0, 1, 0), corner(0, 0, 1)].map((end, j) => {
      const colour = () => readable(palette.components[j]);
      this.frame.add(segments([...low, ...end], colour, 2.6));
      return [place(this.frame, end), "xyz"[j], colour];
    });
    this.shadows = new Group();
    for (const { arrays, colour } of bodies) {
      const points = Array.from(arrays.centre.values, (value, i) => (i % 3 === 2 ? low[2] : value));
      const whole = curve(points.length > 3 ? points : [...points, ...points]);
      this.shadows.add(segments(whole, () => (colour ? readable(colour) : css("soft")), 1.4, FAINT));
    }
    this.add(this.frame, this.shadows);
  }
}

function extremes(bodies) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (const { arrays, radius } of bodies) {
    arrays.centre.values.forEach((value, i) => {
      low[i % 3] = Math.min(low[i % 3], value - ROOM * radius);
      high[i % 3] = Math.max(high[i % 3], value + ROOM * radius);
    });
  }
  return [low, high];
}
