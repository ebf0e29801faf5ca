// Forces at the contact point, with the cone of friction, and the angular velocity at the centre.

import { ConeGeometry, DoubleSide, Group, Mesh, MeshBasicMaterial, RingGeometry, Vector3 } from "three";
import { largest, row } from "./data.js";
import { matrixOf } from "./ground.js";
import { Arrow, paint } from "./shapes.js";
import { css, readable } from "./theme.js";

const LONGEST = 1.3; // of an arrow over the run, in radii

export class Arrows extends Group {
  constructor(run, body) {
    super();
    this.run = run;
    this.body = body;
    const { radius: r, arrays, palette } = run;
    const [blue, red, yellow] = palette.components.map((colour) => () => readable(colour));
    this.turn = matrixOf(run.axes);
    this.up = new Vector3(0, 0, 1).applyMatrix4(this.turn);
    this.normal = new Arrow(r, blue);
    this.friction = new Arrow(r, red);
    this.spin = new Arrow(r, yellow);
    const force = Math.max(largest(arrays.normal_force.values), largest(arrays.friction.values));
    this.perForce = force > 0 ? (LONGEST * r) / force : 0;
    const rate = largest(arrays.angular_velocity.values);
    this.perRate = rate > 0 ? (LONGEST * r) / rate : 0;
    this.contact = new Mesh(
      new RingGeometry(0.035 * r, 0.07 * r, 40),
      paint(new MeshBasicMaterial({ side: DoubleSide }), () => readable(palette.trail)),
    );
    this.contact.quaternion.setFromRotationMatrix(this.turn);
    this.add(this.normal, this.friction, this.spin, this.contact);
    if (run.friction !== null) this.add(this.coneOf(run.friction, r));
  }

  // All forces from the contact point that friction can bear, and the one that is needed.
  coneOf(mu, r) {
    const height = Math.min(0.9, 0.9 / mu) * r;
    const material = { transparent: true, opacity: 0.16, side: DoubleSide, depthWrite: false };
    const geometry = new ConeGeometry(mu * height, height, 48, 1, true).rotateX(-Math.PI / 2).translate(0, 0, height / 2);
    const sheet = new Mesh(geometry, paint(new MeshBasicMaterial(material), () => css("ink")));
    sheet.quaternion.setFromRotationMatrix(this.turn);
    this.whole = new Arrow(r, () => css("ink"));
    this.cone = new Group();
    this.cone.add(sheet, this.whole);
    this.sheet = sheet;
    return this.cone;
  }

  show(k) {
    const { arrays, radius: r } = this.run;
    const foot = this.body.position.clone().addScaledVector(this.up, -r);
    const N = this.up.clone().multiplyScalar(this.perForce * row(arrays.normal_force, k)[0]);
    const [f1, f2] = row(arrays.friction, k);
    const f = new Vector3(f1, f2, 0).applyMatrix4(this.turn).multiplyScalar(this.perForce);
    const Omega = new Vector3().fromArray(row(arrays.angular_velocity, k));
    this.contact.position.copy(foot).addScaledVector(this.up, 0.006 * r);
    this.normal.set(foot, N);
    this.friction.set(foot, f);
    this.spin.set(this.body.position, Omega.applyQuaternion(this.body.quaternion).multiplyScalar(this.perRate));
    if (this.cone) {
      this.sheet.position.copy(foot);
      this.whole.set(foot, N.clone().add(f));
    }
  }
}
