// A ground that is a surface: the mesh of its part near the paths, with lines along both coordinates. It moves, and may
// change its form.

import { BackSide, BufferGeometry, Float32BufferAttribute, FrontSide, Group, LineSegments, Mesh } from "three";
import { row, STILL, UPRIGHT } from "./data.js";
import { flat, glass, solid } from "./materials.js";
import { curve, segments } from "./shapes.js";
import { css } from "./theme.js";

const MOST_LINES = 30; // in each direction

export class Surface extends Group {
  constructor({ floor, obstacles, wanted, bodies }, r) {
    super();
    const [rows, columns] = floor.mesh;
    const mesh = bodies[0].arrays.mesh;
    this.points = new Float32BufferAttribute(row(mesh, 0), 3);
    const faces = withPoints(this.points, triangles(rows, columns));
    faces.computeVertexNormals();
    this.faces = faces;
    // Opaque from the side of the balls, sheer from the other.
    const behind = { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2, side: FrontSide };
    const back = new Mesh(faces, glass(() => css("shell"), BackSide));
    back.renderOrder = 6;
    const lines = new LineSegments(withPoints(this.points, edges(rows, columns)), flat(() => css("grid")));
    for (const part of [new Mesh(faces, solid(() => css("ground"), behind)), back, lines]) {
      part.frustumCulled = false;
      this.add(part);
    }
    this.obstacles = obstacles.length ? new Group() : null;
    for (const ring of obstacles) this.obstacles.add(segments(curve(ring), () => css("shell"), 2));
    if (this.obstacles) this.add(this.obstacles);
    if (!wanted) return;
    this.wanted = segments(curve(wanted), () => css("ink"), 2, { dashed: true, dashSize: 0.14 * r, gapSize: 0.1 * r });
    this.add(this.wanted);
  }

  // As it is at the k-th time of a body.
  show({ arrays }, k) {
    this.position.fromArray(row(arrays.moved, k, STILL));
    this.quaternion.fromArray(row(arrays.carried, k, UPRIGHT));
    if (arrays.mesh.shape[0] === 1) return;
    this.points.copyArray(row(arrays.mesh, k));
    this.points.needsUpdate = true;
    this.faces.computeVertexNormals();
  }
}

function withPoints(points, index) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", points);
  return geometry.setIndex(index);
}

function triangles(rows, columns) {
  const found = [];
  for (let i = 0; i + 1 < rows; i++) {
    for (let j = 0; j + 1 < columns; j++) {
      const [a, b] = [i * columns + j, (i + 1) * columns + j];
      found.push(a, b, b + 1, a, b + 1, a + 1);
    }
  }
  return found;
}

// Along every row and column, or of many along some, the last among them.
function edges(rows, columns) {
  const found = [];
  for (const i of some(rows)) for (let j = 0; j + 1 < columns; j++) found.push(i * columns + j, i * columns + j + 1);
  for (const j of some(columns)) for (let i = 0; i + 1 < rows; i++) found.push(i * columns + j, (i + 1) * columns + j);
  return found;
}

function some(count) {
  const lines = Math.min(count - 1, MOST_LINES);
  return Array.from({ length: lines + 1 }, (_, k) => Math.round((k * (count - 1)) / lines));
}
