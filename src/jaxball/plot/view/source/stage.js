// The camera, and the frame of reference that the world is seen in. The camera's up is against gravity; a frame moves
// the world and never the camera, which is the viewer's.

import { Group, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { nearest, row } from "./data.js";
import { partsOf } from "./kinds.js";
import { Labels } from "./labels.js";
import { repaint } from "./materials.js";
import { axesFrom } from "./shapes.js";
import { css } from "./theme.js";

const FIELD = 28; // degrees, of view
const AROUND = 1.5; // radii, of what is in view around the bodies
const MOST_NAMES = 12; // masses: of more, names would hide each other
const STEP = Math.PI / 24; // by which a key turns the camera
const NEAR = 5; // radii: paths no wider are seen as a whole at first
const NEAR_ON_SURFACES = 40; // likewise, where the form of the ground is to be seen

export class Stage {
  constructor(canvas, view, layer) {
    this.view = view;
    this.labels = new Labels(layer);
    this.canvas = canvas;
    this.radius = Math.max(...view.bodies.map((body) => body.radius));
    const { kind, shapes, arrows, traces, herpolhodes, ghosts, estimates, ground, box } = partsOf(view);
    Object.assign(this, { kind, bodies: shapes, arrows, traces, herpolhodes, ghosts, estimates, ground, box });
    this.followed = this.bodies.length - 1;
    this.margin = 0;
    this.spaceAxes = axesOf(view);
    this.world = new Group();
    const all = [shapes, arrows, traces, herpolhodes, ghosts, estimates];
    this.moving = shapes.map((_, i) => all.map((parts) => parts[i]).filter(Boolean));
    this.world.add(...this.moving.flat(), ...[ground, box, this.spaceAxes].filter(Boolean));
    this.scene = new Scene();
    this.scene.add(this.world);
    this.camera = new PerspectiveCamera(FIELD, 1, 0.01, 1e4);
    this.camera.up.set(0, 0, 1);
    this.bounds = this.boundsOf();
    this.writeNames();
    const { clientWidth, clientHeight } = canvas.parentElement;
    const seen = (view.floor?.mesh ? NEAR_ON_SURFACES : NEAR) * this.radius * Math.min(1, clientWidth / clientHeight || 1);
    const whole = kind !== "rolls" || this.bodies.length > 1 || this.bounds.radius <= seen;
    this.frame = whole ? "ground" : "follow";
    try {
      this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    } catch {
      this.renderer = null; // the browser has no WebGL: the graphs are shown alone
      return;
    }
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.render());
    this.controls.addEventListener("start", () => (this.moved = true)); // by the viewer, whose camera is left alone
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
  }

  writeNames() {
    const names = [...(this.spaceAxes?.names ?? []), ...(this.box?.names ?? [])];
    for (const body of this.bodies) names.push(...(body.axes?.names ?? []));
    for (const arrows of this.arrows) {
      names.push(...arrows.named.map(([arrow, text, colour, left]) => [arrow.tip, text, () => colour, left]));
    }
    const masses = this.bodies.length > 1 ? [] : this.bodies[0].run.masses;
    if (masses.length <= MOST_NAMES) {
      const first = (name) => masses.findIndex((mass) => mass.name === name);
      masses.forEach(({ name, colour }, i) => {
        if (first(name) === i) names.push([this.bodies[0].masses[i], name, () => colour]);
      });
    }
    for (const name of names) this.labels.add(...name);
  }

  // Turns the camera about what it looks at, or comes nearer.
  turn(across, upwards, nearer = 1) {
    if (!this.renderer) return;
    this.moved = true;
    const { camera, controls } = this;
    const from = camera.position.clone().sub(controls.target);
    const length = from.length() * nearer;
    const elevation = Math.asin(from.z / from.length()) + upwards * STEP;
    const azimuth = Math.atan2(from.y, from.x) + across * STEP;
    const limit = Math.PI / 2 - 0.01;
    const e = Math.min(Math.max(elevation, -limit), limit);
    from.set(Math.cos(e) * Math.cos(azimuth), Math.cos(e) * Math.sin(azimuth), Math.sin(e)).multiplyScalar(length);
    camera.position.copy(controls.target).add(from);
    controls.update();
    this.render();
  }

  get leader() {
    return this.bodies[this.followed];
  }

  setFrame(frame) {
    this.frame = frame;
    this.place();
    this.reset();
  }

  follow(i) {
    this.followed = i;
    this.place();
    this.render();
  }

  // Sees all paths from the ground, and the body that is followed from the other frames.
  reset() {
    if (!this.renderer) return;
    const { camera } = this.view;
    const [e, a] = [camera.elevation, camera.azimuth].map((angle) => (angle * Math.PI) / 180);
    const towards = new Vector3(Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e));
    const near = (1.9 * this.leader.run.radius) / Math.sin(this.halfAngle());
    const distance = this.frame === "ground" ? this.farEnough(towards) : near;
    this.camera.near = distance / 500;
    this.camera.far = distance * 50 + 10 * this.bounds.radius;
    this.camera.updateProjectionMatrix();
    this.moved = false;
    this.controls.target.set(0, 0, 0);
    this.camera.position.copy(towards.multiplyScalar(distance));
    this.controls.update();
    this.render();
  }

  halfAngle() {
    return Math.atan(Math.tan((FIELD * Math.PI) / 360) * Math.min(1, this.camera.aspect));
  }

  // The distance from which the bodies are in view wherever they come.
  farEnough(towards) {
    const right = new Vector3(0, 0, 1).cross(towards).normalize();
    const above = towards.clone().cross(right);
    const tall = Math.tan((FIELD * Math.PI) / 360);
    const wide = tall * this.camera.aspect;
    let distance = 0;
    for (const centre of this.centres()) {
      const from = centre.sub(this.bounds.middle);
      const need = Math.max(
        (Math.abs(from.dot(right)) + AROUND * this.radius) / wide,
        (Math.abs(from.dot(above)) + AROUND * this.radius) / tall,
      );
      distance = Math.max(distance, need + from.dot(towards));
    }
    return distance;
  }

  // A sphere around everywhere that the bodies are, and their box.
  boundsOf() {
    const low = new Vector3(Infinity, Infinity, Infinity);
    const high = low.clone().negate();
    for (const centre of this.centres()) {
      low.min(centre);
      high.max(centre);
    }
    return { middle: low.clone().add(high).divideScalar(2), radius: low.distanceTo(high) / 2 + 1.25 * this.radius };
  }

  *centres() {
    for (const { arrays, times } of this.view.bodies) {
      for (let k = 0; k < times.length; k++) yield new Vector3().fromArray(row(arrays.centre, k));
    }
    for (const corner of this.box?.corners ?? this.view.floor?.corners ?? this.view.corners ?? []) yield new Vector3().fromArray(corner);
  }

  // The middle of the view is that of what `margin` pixels on the right leave free.
  resize(margin = this.margin) {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    this.margin = margin;
    if (!this.renderer || !width || !height) return;
    this.sized = true;
    this.size = { width, height };
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = (width - margin) / height;
    this.camera.setViewOffset(width - margin, height, 0, 0, width, height);
    // A frame may have its width only later, and what was in view then would be beneath the settings.
    if (this.moved) this.render();
    else this.reset();
  }

  // Each body at its own time that is nearest to t.
  show(t) {
    this.bodies.forEach((body, i) => {
      const k = nearest(body.run.times, t);
      for (const part of this.moving[i]) part.show(k);
      if (i === this.followed) this.ground?.show(body.run, k);
    });
    this.place();
    this.render();
  }

  place() {
    const { world, leader } = this;
    world.quaternion.identity();
    if (this.frame === "body") world.quaternion.copy(leader.quaternion).invert();
    const centre = this.frame === "ground" ? this.bounds.middle : leader.position;
    world.position.copy(centre).applyQuaternion(world.quaternion).negate();
  }

  repaint() {
    repaint();
    this.labels.repaint();
    this.render();
  }

  render() {
    if (!this.sized) return;
    this.renderer.render(this.scene, this.camera);
    this.labels.place(this.camera, this.size.width, this.size.height);
  }
}

// Those of space, at the origin on the plane; where bodies turn about points of their own, at each. A box has its own, a picture what its function draws.
function axesOf({ axes, floor, bodies }) {
  if (["particle", "drawn"].includes(bodies[0].body)) return null;
  const whole = new Group();
  whole.names = [];
  const colours = [0, 1, 2].map(() => () => css(floor ? "ink" : "soft"));
  for (const { radius: r, arrays } of floor ? bodies.slice(0, 1) : bodies) {
    const [length, width] = floor ? [0.8 * r, 2.6] : [1.35 * r, 1.2];
    const foot = floor ? axes.map((line) => line[2] * (floor.height + 0.01 * r)) : Array.from(row(arrays.centre, 0));
    const ends = [0, 1, 2].map((j) => foot.map((value, i) => value + length * axes[i][j]));
    const found = axesFrom(foot, ends, colours, "e", width);
    whole.add(found);
    whole.names.push(...found.names);
  }
  return whole;
}
