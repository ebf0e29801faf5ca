// The ball or disk: its shell, rails, masses, arms and centre of mass, moved by the pose of the body.

import { BackSide, CylinderGeometry, DoubleSide, FrontSide, Group, Mesh, OctahedronGeometry, SphereGeometry, Vector3 } from "three";
import { row } from "./data.js";
import { flat, glass, solid } from "./materials.js";
import { bodyAxes, circle, curve, Rod, segments } from "./shapes.js";
import { css, readable } from "./theme.js";

export class Body extends Group {
  constructor(run) {
    super();
    this.run = run;
    const { radius: r, arrays } = run;
    const shell = () => (run.colour ? readable(run.colour) : css("shell"));
    this.add(run.body === "disk" ? hoop(r, shell) : sphere(r, shell));
    this.rails = new Group();
    run.rails.forEach((rail, j) => {
      const points = curve(arrays[`rail_${j}`].values);
      this.rails.add(segments(points, () => readable(rail.colour), 1.8, { transparent: true, opacity: 0.75 }));
    });
    const most = Math.max(...run.masses.map((mass) => Math.abs(mass.mass)), 0);
    this.masses = run.masses.map((mass) => {
      const size = most > 0 ? 0.105 * r * Math.cbrt(Math.abs(mass.mass) / most) : 0;
      return new Mesh(new SphereGeometry(Math.max(size, 0.025 * r), 32, 20), solid(() => readable(mass.colour)));
    });
    this.arms = run.arms.map((colour, j) => {
      const [, count, points] = arrays[`arms_${j}`].shape;
      const material = solid(() => readable(colour));
      return { count, points, rods: Array.from({ length: count * (points - 1) }, () => new Rod(0.017 * r, material)) };
    });
    this.centreOfMass = new Mesh(new OctahedronGeometry(0.06 * r), solid(() => css("ink")));
    const shellColour = () => css("shell");
    this.axes = bodyAxes(r, [shellColour, shellColour, shellColour], "E");
    this.add(this.rails, ...this.masses, ...this.arms.flatMap((arm) => arm.rods), this.centreOfMass, this.axes);
  }

  show(k) {
    const { arrays, masses: points, shell } = this.run;
    this.position.fromArray(row(arrays.centre, k));
    this.quaternion.fromArray(row(arrays.quaternion, k));
    const places = row(arrays.masses, k);
    this.centreOfMass.position.fromArray(shell.centre_of_mass).multiplyScalar(shell.mass);
    let whole = shell.mass;
    this.masses.forEach((mass, i) => {
      mass.position.fromArray(places, 3 * i);
      this.centreOfMass.position.addScaledVector(mass.position, points[i].mass);
      whole += points[i].mass;
    });
    this.centreOfMass.position.divideScalar(whole);
    this.arms.forEach(({ count, points, rods }, j) => {
      const bent = row(arrays[`arms_${j}`], k);
      const point = (i) => new Vector3().fromArray(bent, 3 * i);
      for (let i = 0; i < count; i++) {
        for (let p = 0; p < points - 1; p++) {
          rods[i * (points - 1) + p].between(point(i * points + p), point(i * points + p + 1));
        }
      }
    });
  }
}

// A sphere of glass. Meridians about E3, of which the one through E1 is marked, show that it turns.
function sphere(r, colour) {
  const shell = new Group();
  for (const [side, order] of [[BackSide, -1], [FrontSide, 5]]) {
    const half = new Mesh(new SphereGeometry(r, 64, 40), glass(colour, side));
    half.renderOrder = order;
    shell.add(half);
  }
  const lines = [];
  for (let j = 0; j < 6; j++) {
    const [c, s] = [Math.cos((j * Math.PI) / 6), Math.sin((j * Math.PI) / 6)];
    lines.push(...circle((a) => [r * Math.sin(a) * c, r * Math.sin(a) * s, r * Math.cos(a)]));
  }
  for (const height of [-Math.PI / 4, 0, Math.PI / 4]) {
    const [c, s] = [Math.cos(height), Math.sin(height)];
    lines.push(...circle((a) => [r * c * Math.cos(a), r * c * Math.sin(a), r * s]));
  }
  const thin = { transparent: true, opacity: 0.3, depthWrite: false };
  const marked = [];
  for (let j = 0; j <= 48; j++) marked.push(r * Math.sin((Math.PI * j) / 48), 0, r * Math.cos((Math.PI * j) / 48));
  shell.add(
    segments(lines, colour, 1, thin),
    segments(curve(marked), colour, 2.6, { ...thin, opacity: 0.8 }),
  );
  return shell;
}

// A disk in the plane of E1 and E3, with spokes.
function hoop(r, colour) {
  const disk = new Group();
  const pane = new Mesh(
    new CylinderGeometry(r, r, 0.02 * r, 96),
    flat(colour, { transparent: true, opacity: 0.1, side: DoubleSide, depthWrite: false }),
  );
  const spokes = [0, 0, 0, r, 0, 0];
  for (let j = 1; j < 12; j++) {
    const [c, s] = [r * Math.cos((j * Math.PI) / 6), r * Math.sin((j * Math.PI) / 6)];
    spokes.push(0.9 * c, 0, 0.9 * s, c, 0, s);
  }
  disk.add(
    pane,
    segments(circle((a) => [r * Math.cos(a), 0, r * Math.sin(a)]), colour, 3),
    segments(spokes, colour, 1.4, { transparent: true, opacity: 0.7 }),
  );
  return disk;
}
