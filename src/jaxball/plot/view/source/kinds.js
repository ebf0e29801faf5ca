// The parts of a scene of each kind: what rolls, rigid bodies about fixed points, particles, and what a function draws.

import { Arrows } from "./arrows.js";
import { Body } from "./body.js";
import { largest, row } from "./data.js";
import { Drawing, NoArrows } from "./drawn.js";
import { Estimate, Ghost } from "./ghost.js";
import { Ground } from "./ground.js";
import { Box, Particle, Velocity } from "./particle.js";
import { RigidBody, Vectors } from "./rigid.js";
import { Surface } from "./surface.js";
import { contactPoints, Trace, TraceOnMatter, Trail, turned } from "./trace.js";

const LONGEST = 1.3; // of an arrow over all runs, in radii of the first body
const ENOUGH = 0.3; // of the longest arrow
const THIN = { transparent: true, opacity: 0.6 };

// How long arrows are: the same for all bodies, and for both forces.
function scalesOf(bodies) {
  const per = (most, length = LONGEST) => (most > 0 ? (length * bodies[0].radius) / most : 0);
  return {
    force: per(largest(bodies, "normal_force", "friction")),
    larger: larger(largest(bodies, "normal_force"), largest(bodies, "friction")),
    slip: per(largest(bodies, "slip"), 1.1),
    rate: per(largest(bodies, "angular_velocity")),
    momentum: per(largest(bodies, "angular_momentum")),
    velocity: per(largest(bodies, "velocity"), 4),
  };
}

// By how much friction is drawn larger than N, a round number, where it would be too short to be seen beside it.
function larger(N, f) {
  if (!(N > 0 && f > 1e-9 * N)) return 1;
  return [1, 2, 5, 10, 20, 50, 100].find((factor) => factor * f >= ENOUGH * N) ?? 100;
}

const KINDS = {
  rolls: { Shape: Body, Vectors: Arrows },
  rigid: { Shape: RigidBody, Vectors },
  particle: { Shape: Particle, Vectors: Velocity },
  drawn: { Shape: Drawing, Vectors: NoArrows },
};

// The shape, the arrows and the traces of each body, and what they stand in: a ground, a box or nothing.
export function partsOf(view) {
  const { bodies, axes, palette } = view;
  const kind = view.floor ? "rolls" : bodies[0].body;
  const { Shape, Vectors } = KINDS[kind];
  const scales = scalesOf(bodies);
  const shapes = bodies.map((run) => new Shape(run, palette.components, view));
  const traces = bodies.map((run) => {
    if (run.arrays.nodes) return new TraceOnMatter(run, view.floor.mesh[1], palette.trail);
    if (kind === "rolls") return new (run.spells ? Trail : Trace)(run, contactPoints(run, axes), palette.trail);
    if (kind === "particle" || kind === "drawn") return new Trace(run, run.arrays.centre.values, palette.trail);
    return new Trace(run, turned(run, () => run.tip.place), run.tip.colour, 2.4);
  });
  const ends = ({ angular_velocity: Omega }) => (k) => row(Omega, k).map((value) => value * scales.rate);
  const herpolhodes = bodies.map((run) =>
    kind === "rigid" ? new Trace(run, turned(run, ends(run.arrays)), palette.spin, 1.6, THIN) : null,
  );
  const ghosts = bodies.map((run) =>
    run.arrays.nominal_centre ? new Ghost(run, contactPoints(run, axes, run.arrays.nominal_centre, run.arrays.nominal_normal)) : null,
  );
  const up = axes.map((line) => line[2]);
  const estimates = bodies.map((run) => (run.arrays.estimate ? new Estimate(run, up, palette.momentum) : null));
  return {
    kind,
    shapes,
    ghosts,
    estimates,
    arrows: shapes.map((shape) => new Vectors(shape, view, scales)),
    traces,
    herpolhodes: herpolhodes.filter(Boolean),
    ground: view.floor ? new (view.floor.mesh ? Surface : Ground)(view, bodies[0].radius) : null,
    box: kind === "particle" ? new Box(view) : null,
  };
}
