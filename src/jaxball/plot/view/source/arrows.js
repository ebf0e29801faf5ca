// Of a body that rolls: forces and the angular momentum at its contact point, with the cone of friction, and its angular
// velocity.

import { ConeGeometry, DoubleSide, Group, Mesh, RingGeometry, Vector3 } from "three";
import { row } from "./data.js";
import { flat } from "./materials.js";
import { Arrow, matrixOf } from "./shapes.js";
import { css, readable } from "./theme.js";
import { footOf, ON_MESH } from "./trace.js";

export class Arrows extends Group {
  constructor(body, { axes, palette, friction, cone = null }, scales) {
    super();
    Object.assign(this, { body, palette, scales });
    const r = body.run.radius;
    const colour = (name) => () => readable(palette[name]);
    this.turn = matrixOf(axes);
    this.up = new Vector3(0, 0, 1).applyMatrix4(this.turn);
    this.normal = new Arrow(r, colour("normal"));
    this.friction = new Arrow(r, colour("friction"));
    this.spin = new Arrow(r, colour("spin"));
    this.momentum = new Arrow(r, colour("momentum"));
    if (body.run.arrays.slip) this.slip = new Arrow(r, colour("slip"));
    this.contact = new Mesh(
      new RingGeometry(0.035 * r, 0.07 * r, 40),
      flat(() => readable(body.run.colour ?? palette.trail), { side: DoubleSide }),
    );
    this.add(...[this.normal, this.friction, this.spin, this.momentum, this.slip, this.contact].filter(Boolean));
    if (friction ?? cone) this.add(this.coneOf(friction ?? cone, r));
  }

  // All forces from the contact point that friction can bear, and the one that is needed. The cone is as high as N is
  // long, so that the force ends in its rim or within it, unless friction cannot bear it.
  coneOf(mu, r) {
    const geometry = new ConeGeometry(mu, 1, 48, 1, true).rotateX(-Math.PI / 2).translate(0, 0, 0.5);
    const thin = { transparent: true, opacity: 0.16, side: DoubleSide, depthWrite: false };
    const sheet = new Mesh(geometry, flat(() => css("ink"), thin));
    this.whole = new Arrow(r, () => css("ink"));
    this.cone = new Group();
    this.cone.add(sheet, this.whole);
    this.sheet = sheet;
    return this.cone;
  }

  // Each arrow by its name.
  get named() {
    const sum = this.whole ? [[this.whole, "N + f", "ink"]] : [];
    const { normal, friction, spin, momentum, slip } = this.palette;
    return [
      [this.normal, "N", normal, true],
      [this.friction, this.scales.larger > 1 ? `${this.scales.larger} f` : "f", friction],
      [this.spin, "ω", spin],
      [this.momentum, "Π", momentum],
      [this.slip, "vₛ", slip],
      ...sum,
    ].filter(([arrow]) => arrow);
  }

  // The axes of the ground at the contact point: those of a plane, or of the tangent plane of a surface.
  stand({ normal, tangent }, k) {
    if (!normal) return;
    this.up.fromArray(row(normal, k));
    const first = new Vector3().fromArray(row(tangent, k));
    this.turn.makeBasis(first, this.up.clone().cross(first), this.up);
  }

  show(k) {
    const { body, scales, up } = this;
    const { arrays, radius: r } = body.run;
    this.stand(arrays, k);
    this.contact.quaternion.setFromRotationMatrix(this.turn);
    this.sheet?.quaternion.setFromRotationMatrix(this.turn);
    const inSpace = (array) => new Vector3().fromArray(row(array, k)).applyQuaternion(body.quaternion);
    const foot = body.position.clone().add(footOf(arrays, k, up, r));
    const N = up.clone().multiplyScalar(scales.force * row(arrays.normal_force, k)[0]);
    const [f1, f2] = row(arrays.friction, k);
    const f = new Vector3(f1, f2, 0).applyMatrix4(this.turn).multiplyScalar(scales.force);
    const height = arrays.height ? row(arrays.height, k)[0] : 0; // of a body that flies
    this.contact.position.copy(foot).addScaledVector(up, (arrays.normal ? 1.05 * ON_MESH : 0.006) * r - height);
    this.normal.set(foot, N);
    this.friction.set(foot, f.clone().multiplyScalar(scales.larger));
    this.momentum.set(foot, inSpace(arrays.angular_momentum).multiplyScalar(scales.momentum));
    if (this.slip) {
      const [v1, v2] = row(arrays.slip, k);
      const slips = new Vector3(v1, v2, 0).applyMatrix4(this.turn).multiplyScalar(scales.slip);
      this.slip.set(this.contact.position, slips);
    }
    this.spin.set(body.position, inSpace(arrays.angular_velocity).multiplyScalar(scales.rate));
    if (this.cone) {
      this.sheet.position.copy(foot);
      this.sheet.visible = N.length() > 0;
      this.sheet.scale.setScalar(Math.max(N.length(), 1e-9));
      this.whole.set(foot, N.clone().add(f));
    }
  }
}
