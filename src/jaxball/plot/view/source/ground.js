// The plane: its floor, which may be the top of a wedge, a grid of one radius, a turntable, obstacles, and the path that
// is wanted. All of it moves as the plane does.

import { BufferGeometry, CircleGeometry, Float32BufferAttribute, Group, LineSegments, Mesh } from "three";
import { row, STILL } from "./data.js";
import { flat } from "./materials.js";
import { circle, curve, matrixOf, segments } from "./shapes.js";
import { css } from "./theme.js";

const MOST_LINES = 200;

export class Ground extends Group {
  constructor({ axes, floor, obstacles, wanted }, r) {
    super();
    // The plane's own axes, with its height as origin of the third.
    this.plane = new Group();
    this.plane.applyMatrix4(matrixOf(axes));
    this.plane.updateMatrix();
    const [x0, y0] = floor.low;
    const [x1, y1] = floor.high;
    const z = floor.height;
    const top = [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]];
    // Seen from outside alone: in the body frame the plane may come between the ball and the camera.
    const face = { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 };
    this.plane.add(quads([top], flat(() => css("ground"), face)));
    if (floor.tilted) {
      const sides = floor.top.map((corner, j) => {
        const next = (j + 1) % 4;
        return [corner, floor.base[j], floor.base[next], floor.top[next]];
      });
      this.add(quads(sides, flat(() => css("side"), face)));
    }
    if (floor.table > 0) this.plane.add(this.table(floor, r));
    else this.plane.add((this.grid = new LineSegments(lines(floor, r, STILL), flat(() => css("grid")))));
    this.floor = floor;
    this.r = r;
    if (obstacles.length) this.plane.add(this.discs(obstacles, floor.height, r));
    this.add(this.plane);
    if (!wanted) return;
    this.wanted = segments(lifted(curve(wanted), axes, 0.006 * r), () => css("ink"), 2, {
      dashed: true, dashSize: 0.14 * r, gapSize: 0.1 * r,
    });
    this.add(this.wanted);
  }

  table({ table, centre, height }, r) {
    const plate = new Mesh(new CircleGeometry(table, 96), flat(() => css("side")));
    const lines = [];
    for (let radius = r; radius <= table; radius += r) {
      lines.push(...circle((a) => [radius * Math.cos(a), radius * Math.sin(a), 0.002 * r]));
    }
    for (let j = 1; j < 12; j++) {
      const a = (j * Math.PI) / 6;
      lines.push(0, 0, 0.002 * r, table * Math.cos(a), table * Math.sin(a), 0.002 * r);
    }
    const mark = [0, 0, 0.003 * r, table, 0, 0.003 * r];
    this.turning = new Group();
    this.turning.position.set(centre[0], centre[1], height + 0.001 * r);
    this.turning.add(plate, thin(lines), segments(mark, () => css("shell"), 2));
    return this.turning;
  }

  discs(obstacles, height, r) {
    this.obstacles = new Group();
    for (const [x, y, radius] of obstacles) {
      const disc = new Group();
      const shade = { opacity: 0.3, transparent: true, depthWrite: false };
      const edge = circle((a) => [radius * Math.cos(a), radius * Math.sin(a), 0]);
      disc.add(new Mesh(new CircleGeometry(radius, 96), flat(() => css("shell"), shade)));
      disc.add(segments(edge, () => css("shell"), 2));
      disc.position.set(x, y, height + 0.005 * r);
      this.obstacles.add(disc);
    }
    return this.obstacles;
  }

  // As it is at the k-th time of a body.
  show({ arrays }, k) {
    this.position.fromArray(row(arrays.moved, k, STILL));
    if (this.turning) this.turning.rotation.z = row(arrays.turned, k)[0];
    else if (arrays.belt) this.grid.geometry = lines(this.floor, this.r, row(arrays.belt, k));
  }
}

function lifted(points, axes, height) {
  return points.map((value, i) => value + height * axes[i % 3][2]);
}

// The grid after a belt has moved it.
function lines({ low, high, height }, r, moved) {
  const points = [];
  const z = height + 0.001 * r;
  let step = r;
  while (Math.max(high[0] - low[0], high[1] - low[1]) / step > MOST_LINES) step *= 10;
  const places = (i) => {
    const first = moved[i] + step * Math.ceil((low[i] - moved[i]) / step);
    return Array.from({ length: Math.floor((high[i] - first) / step) + 1 }, (_, j) => first + j * step);
  };
  for (const x of places(0)) points.push(x, low[1], z, x, high[1], z);
  for (const y of places(1)) points.push(low[0], y, z, high[0], y, z);
  return positions(points);
}

function positions(points) {
  return new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
}

function thin(points) {
  return new LineSegments(positions(points), flat(() => css("grid")));
}

function quads(corners, material) {
  const points = corners.flatMap(([a, b, c, d]) => [...a, ...b, ...c, ...a, ...c, ...d]);
  return new Mesh(positions(points), material);
}
