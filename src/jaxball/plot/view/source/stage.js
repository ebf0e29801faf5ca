// The camera, and the frame of reference that the world is seen in. The camera's up is against gravity; a frame moves
// the world and never the camera, which is the viewer's.

import { AmbientLight, DirectionalLight, Group, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { Arrows } from "./arrows.js";
import { Body } from "./body.js";
import { row } from "./data.js";
import { Ground } from "./ground.js";
import { repaint, segments } from "./shapes.js";
import { readable } from "./theme.js";

const FIELD = 28; // degrees, of view
const AROUND = 1.5; // radii, of what is in view around the body
const NEAR = 5; // radii: a path no wider is seen as a whole at first

export class Stage {
  constructor(canvas, run) {
    this.run = run;
    this.canvas = canvas;
    this.body = new Body(run);
    this.ground = new Ground(run);
    this.arrows = new Arrows(run, this.body);
    this.spaceAxes = axesOf(run);
    this.world = new Group();
    this.world.add(this.ground, this.body, this.arrows, this.spaceAxes);
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(FIELD, 1, 0.01, 1e4);
    this.camera.up.set(0, 0, 1);
    const light = new DirectionalLight(0xffffff, 2.2);
    light.position.set(-3, -5, 9);
    this.scene.add(this.world, new AmbientLight(0xffffff, 1.5), light);
    this.bounds = boundsOf(run);
    const { clientWidth, clientHeight } = canvas.parentElement;
    const seen = NEAR * run.radius * Math.min(1, clientWidth / clientHeight || 1);
    this.frame = this.bounds.radius <= seen ? "ground" : "follow";
    try {
      this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    } catch {
      this.renderer = null; // the browser has no WebGL: the graphs are shown alone
      return;
    }
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.render());
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
  }

  setFrame(frame) {
    this.frame = frame;
    this.place();
    this.reset();
  }

  // Sees the whole path from the ground, and the body from the other frames.
  reset() {
    if (!this.renderer) return;
    const { radius: r, camera } = this.run;
    const [e, a] = [camera.elevation, camera.azimuth].map((angle) => (angle * Math.PI) / 180);
    const towards = new Vector3(Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e));
    const distance = this.frame === "ground" ? this.farEnough(towards) : 1.9 * r / Math.sin(this.halfAngle());
    this.camera.near = distance / 500;
    this.camera.far = distance * 50 + 10 * this.bounds.radius;
    this.camera.updateProjectionMatrix();
    this.controls.target.set(0, 0, 0);
    this.camera.position.copy(towards.multiplyScalar(distance));
    this.controls.update();
    this.render();
  }

  halfAngle() {
    return Math.atan(Math.tan((FIELD * Math.PI) / 360) * Math.min(1, this.camera.aspect));
  }

  // The distance from which the body is in view wherever it comes.
  farEnough(towards) {
    const { arrays, radius: r } = this.run;
    const right = new Vector3(0, 0, 1).cross(towards).normalize();
    const above = towards.clone().cross(right);
    const tall = Math.tan((FIELD * Math.PI) / 360);
    const wide = tall * this.camera.aspect;
    let distance = 0;
    for (let k = 0; k < arrays.time.shape[0]; k++) {
      const from = new Vector3().fromArray(row(arrays.centre, k)).sub(this.bounds.middle);
      const need = Math.max(
        (Math.abs(from.dot(right)) + AROUND * r) / wide,
        (Math.abs(from.dot(above)) + AROUND * r) / tall,
      );
      distance = Math.max(distance, need + from.dot(towards));
    }
    return distance;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    const first = !this.sized;
    this.sized = true;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (first) this.reset();
    else this.render();
  }

  show(k) {
    for (const part of [this.ground, this.body, this.arrows]) part.show(k);
    this.place();
    this.render();
  }

  place() {
    const { world, body } = this;
    world.quaternion.identity();
    if (this.frame === "body") world.quaternion.copy(body.quaternion).invert();
    const centre = this.frame === "ground" ? this.bounds.middle : body.position;
    world.position.copy(centre).applyQuaternion(world.quaternion).negate();
  }

  repaint() {
    repaint();
    this.render();
  }

  render() {
    if (this.sized) this.renderer.render(this.scene, this.camera);
  }
}

// A sphere around everywhere that the body is.
function boundsOf({ arrays, radius: r }) {
  const low = new Vector3(Infinity, Infinity, Infinity);
  const high = low.clone().negate();
  for (let k = 0; k < arrays.time.shape[0]; k++) {
    const centre = new Vector3().fromArray(row(arrays.centre, k));
    low.min(centre);
    high.max(centre);
  }
  return { middle: low.clone().add(high).divideScalar(2), radius: low.distanceTo(high) / 2 + 1.25 * r };
}

// Those of space, at the origin on the plane.
function axesOf({ radius: r, axes, floor, palette }) {
  const found = new Group();
  const foot = axes.map((line) => line[2] * (floor.height + 0.01 * r));
  for (let j = 0; j < 3; j++) {
    const end = foot.map((value, i) => value + 0.8 * r * axes[i][j]);
    found.add(segments([...foot, ...end], () => readable(palette.components[j]), 2.6));
  }
  return found;
}
