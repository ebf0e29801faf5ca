// The ball or disk: its shell, rails, masses, arms and centre of mass, moved by the pose of the body.

import {
  BackSide, CylinderGeometry, DoubleSide, FrontSide, Group, Mesh, OctahedronGeometry, PlaneGeometry,
  SphereGeometry, Vector3,
} from "three";
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
    this.add(run.body === "disk" ? hoop(r, shell) : glassy(arrays.surface?.values ?? sphere(r), shell));
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

const [AROUND, DOWN] = [96, 48]; // the sides of a surface along a parallel, and along a meridian

// The points of a sphere, row by row from the pole E3 down, and in each row around it from E1 on.
function sphere(r) {
  const points = [];
  for (let i = 0; i <= DOWN; i++) {
    for (let j = 0; j <= AROUND; j++) {
      const [polar, azimuth] = [(Math.PI * i) / DOWN, (2 * Math.PI * j) / AROUND];
      points.push(r * Math.sin(polar) * Math.cos(azimuth), r * Math.sin(polar) * Math.sin(azimuth), r * Math.cos(polar));
    }
  }
  return points;
}

// A surface of glass. Meridians about E3, of which the one through E1 is marked, show that it turns.
function glassy(points, colour) {
  const shell = new Group();
  const geometry = new PlaneGeometry(1, 1, AROUND, DOWN); // whose vertices lie in the same order
  geometry.attributes.position.copyArray(points);
  geometry.computeVertexNormals();
  for (const [side, order] of [[BackSide, -1], [FrontSide, 5]]) {
    const half = new Mesh(geometry, glass(colour, side));
    half.renderOrder = order;
    shell.add(half);
  }
  const at = (i, j) => [0, 1, 2].map((k) => points[3 * (i * (AROUND + 1) + j) + k]);
  const along = (count, point) => curve(Array.from({ length: count + 1 }, (_, k) => point(k)).flat());
  const lines = [];
  for (let j = 0; j < AROUND; j += AROUND / 12) lines.push(...along(DOWN, (i) => at(i, j)));
  for (let i = DOWN / 4; i < DOWN; i += DOWN / 4) lines.push(...along(AROUND, (j) => at(i, j)));
  const thin = { transparent: true, opacity: 0.3, depthWrite: false };
  shell.add(
    segments(lines, colour, 1, thin),
    segments(along(DOWN, (i) => at(i, 0)), colour, 2.6, { ...thin, opacity: 0.8 }),
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
