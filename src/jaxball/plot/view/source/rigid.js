// A rigid body about its fixed point: an ellipsoid with the body's principal axes, and its vectors.

import { BackSide, FrontSide, Group, Mesh, OctahedronGeometry, SphereGeometry, Vector3 } from "three";
import { row } from "./data.js";
import { glass, solid } from "./materials.js";
import { Arrow, bodyAxes, circle, Rod, segments } from "./shapes.js";
import { css, readable } from "./theme.js";

export class RigidBody extends Group {
  constructor(run, components) {
    super();
    this.run = run;
    this.masses = [];
    const r = run.radius;
    const shell = () => (run.colour ? readable(run.colour) : css("shell"));
    this.add(ellipsoid(run.ellipsoid, shell, components));
    this.axes = bodyAxes(r, components.map((colour) => () => readable(colour)), "E");
    const ink = solid(() => css("ink"));
    this.fixedPoint = new Mesh(new SphereGeometry(0.035 * r, 24, 16), ink);
    this.add(this.axes, this.fixedPoint);
    if (run.centre_of_mass === null) return;
    this.centreOfMass = new Mesh(new OctahedronGeometry(0.06 * r), ink);
    this.centreOfMass.position.fromArray(run.centre_of_mass);
    const stem = new Rod(0.016 * r, solid(shell));
    stem.between(new Vector3(), new Vector3().fromArray(run.tip.place));
    this.add(this.centreOfMass, stem);
  }

  show(k) {
    this.position.fromArray(row(this.run.arrays.centre, k));
    this.quaternion.fromArray(row(this.run.arrays.quaternion, k));
  }
}

// Of glass, with the three ellipses in its planes of symmetry and fainter meridians about its third axis.
function ellipsoid({ semi_axes: [a, b, c], centre, quaternion }, colour, components) {
  const found = new Group();
  found.position.fromArray(centre);
  found.quaternion.fromArray(quaternion);
  for (const [side, order] of [[BackSide, -1], [FrontSide, 5]]) {
    const half = new Mesh(new SphereGeometry(1, 64, 40).rotateX(Math.PI / 2).scale(a, b, c), glass(colour, side));
    half.renderOrder = order;
    found.add(half);
  }
  const lines = [];
  for (let j = 1; j < 8; j++) {
    const [x, y] = [a * Math.cos((j * Math.PI) / 8), b * Math.sin((j * Math.PI) / 8)];
    if (j !== 4) lines.push(...circle((t) => [x * Math.sin(t), y * Math.sin(t), c * Math.cos(t)]));
  }
  for (const height of [-Math.PI / 3, -Math.PI / 6, Math.PI / 6, Math.PI / 3]) {
    const [out, up] = [Math.cos(height), c * Math.sin(height)];
    lines.push(...circle((t) => [a * out * Math.cos(t), b * out * Math.sin(t), up]));
  }
  const ellipses = [
    (t) => [0, b * Math.cos(t), c * Math.sin(t)],
    (t) => [a * Math.cos(t), 0, c * Math.sin(t)],
    (t) => [a * Math.cos(t), b * Math.sin(t), 0],
  ];
  found.add(segments(lines, colour, 1, { transparent: true, opacity: 0.35, depthWrite: false }));
  ellipses.forEach((point, j) => found.add(segments(circle(point), () => readable(components[j]), 2)));
  return found;
}

// From the fixed point: ω, L = 𝕀Ω and the ξ of Suslov's problem.
export class Vectors extends Group {
  constructor(body, { palette }, scales) {
    super();
    this.body = body;
    this.scales = scales;
    const { radius: r, arrays } = body.run;
    const arrow = (array, colour) => (arrays[array] ? new Arrow(r, () => readable(colour)) : null);
    this.spin = arrow("angular_velocity", palette.spin);
    this.momentum = arrow("angular_momentum", palette.momentum);
    this.xi = arrow("xi", palette.xi);
    this.palette = palette;
    this.add(...[this.spin, this.momentum, this.xi].filter(Boolean));
  }

  get named() {
    const { spin, momentum, xi } = this.palette;
    return [[this.spin, "ω", spin], [this.momentum, "L", momentum], [this.xi, "ξ", xi]].filter(([arrow]) => arrow);
  }

  show(k) {
    const { position, quaternion, run } = this.body;
    const set = (arrow, array, scale) =>
      arrow?.set(position, new Vector3().fromArray(row(run.arrays[array], k)).applyQuaternion(quaternion).multiplyScalar(scale));
    set(this.spin, "angular_velocity", this.scales.rate);
    set(this.momentum, "angular_momentum", this.scales.momentum);
    set(this.xi, "xi", 1.1 * run.radius);
  }
}
