// Graphs over time on plain canvases, with a cursor at the time shown. What does not move is drawn once, behind it.

import { modeAt, nearest } from "./data.js";
import { sample, tint } from "./legend.js";
import { css, readable } from "./theme.js";

const DASHES = [[5, 4], [1.5, 2.5]];
const EARLIER = [4, 3]; // of the first of two runs
const ROUNDING = 1e-12; // of the size of what is drawn: less is 0
const ROUNDING_OF_SUMS = 2.5e-7; // whose terms are in float32
const [NEAR, MOSTLY, INTERLEAVED] = [2, 0.8, 9]; // pixels between lines that hide each other, most of the time; dashes
const BAND = 0.2; // how much of its colour a band has
const LABELLED = 2; // bodies: the values of more are not written
const [LEFT, RIGHT, TOP, BOTTOM] = [46, 8, 6, 20];

export class Plot {
  constructor(view, { title, series, level, levels = [], valued = true, size = 0, gaps = false }, seek) {
    this.title = title;
    this.gaps = gaps; // whether no line crosses from one mode to another
    this.times = view.times;
    this.valued = valued && view.bodies.length <= LABELLED; // whether labels have the values at the time shown
    this.levels = level && view.friction !== null ? [{ name: level, value: view.friction }, ...levels] : levels;
    this.modes = view.bodies.length === 1 ? view.bodies[0] : {}; // bands of several would lie on one another
    this.colours = view.palette.modes;
    this.series = series.map((one) => {
      const curves = view.bodies.filter((body) => body.arrays[one.array]).map((body) => curveOf(body, one));
      return { name: one.name, colour: one.colour, dash: one.dash ?? [], curves };
    });
    this.curves = this.series.flatMap((one) => one.curves);
    withoutRounding(this.curves, size);
    this.canvas = document.createElement("canvas");
    const [start, end] = [this.times[0], this.times[this.times.length - 1]];
    for (const [name, value] of Object.entries({
      role: "slider",
      tabindex: 0,
      "aria-label": `${title} over time; click, drag or press the arrow keys to go to a time`,
      "aria-valuemin": start,
      "aria-valuemax": end,
    })) this.canvas.setAttribute(name, value);
    this.still = document.createElement("canvas");
    this.figure = document.createElement("figure");
    this.figure.className = "plot";
    const caption = document.createElement("figcaption");
    const heading = document.createElement("b");
    heading.textContent = title;
    caption.append(heading);
    for (const one of this.series) {
      one.label = document.createElement("span");
      one.text = document.createTextNode("");
      const colour = one.colour ?? (one.curves.length === 1 ? one.curves[0].colour : null);
      if (colour) {
        one.label.append(sample(colour, one.dash));
        tint(one.label, colour);
      }
      one.label.append(one.text);
      caption.append(one.label);
    }
    this.levels.forEach(({ name, value }, j) => {
      const label = document.createElement("span");
      label.append(sample("ink", DASHES[j % DASHES.length]), `${name} = ${value}`);
      caption.append(label);
    });
    caption.classList.toggle("pair", view.bodies.length === 2); // which has room for values of any length
    this.figure.append(caption, this.canvas);
    this.range = this.limits();
    const go = (event) => {
      if (event.buttons & 1 || event.type === "pointerdown") seek(this.timeAt(event.offsetX));
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      go(event);
    });
    this.canvas.addEventListener("pointermove", go);
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
  }

  limits() {
    let [low, high] = [Infinity, -Infinity];
    const include = (value) => {
      if (!Number.isFinite(value)) return;
      low = Math.min(low, value);
      high = Math.max(high, value);
    };
    for (const { times, at } of this.curves) for (let k = 0; k < times.length; k++) include(at(k));
    for (const { value } of this.levels) include(value);
    if (low > high) return [-1, 1];
    // A constant is shown against 0, and 0 against ±1; rounding is no motion.
    if (high - low <= 1e-6 * Math.max(Math.abs(low), Math.abs(high))) {
      [low, high] = low || high ? [Math.min(low, 0), Math.max(high, 0)] : [-1, 1];
    }
    const slack = 0.06 * (high - low);
    return [low - slack, high + slack];
  }

  get span() {
    return [this.times[0], Math.max(this.times[this.times.length - 1], this.times[0] + 1e-9)];
  }

  x(t) {
    const [a, b] = this.span;
    return LEFT + ((t - a) / (b - a)) * (this.width - LEFT - RIGHT);
  }

  y(value) {
    const [low, high] = this.range;
    return TOP + ((high - value) / (high - low)) * (this.height - TOP - BOTTOM);
  }

  timeAt(x) {
    const [a, b] = this.span;
    const share = (x - LEFT) / (this.width - LEFT - RIGHT);
    return a + Math.min(Math.max(share, 0), 1) * (b - a);
  }

  redraw() {
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    if (!this.width || !this.height) return;
    for (const canvas of [this.canvas, this.still]) {
      canvas.width = Math.round(this.width * devicePixelRatio);
      canvas.height = Math.round(this.height * devicePixelRatio);
    }
    const pen = this.still.getContext("2d");
    pen.scale(devicePixelRatio, devicePixelRatio);
    this.drawModes(pen);
    this.drawAxes(pen);
    this.levels.forEach((level, j) => this.drawLevel(pen, level.value, DASHES[j % DASHES.length]));
    const shared = this.shared();
    for (const curve of this.curves) this.drawCurve(pen, curve, shared.get(curve));
    if (this.shown !== undefined) this.show(this.shown);
  }

  drawAxes(pen) {
    pen.font = "11px system-ui, sans-serif";
    pen.lineWidth = 1;
    pen.fillStyle = css("soft");
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const value of ticks(...this.range, 4)) {
      const y = Math.round(this.y(value)) + 0.5;
      stroke(pen, css("line"), [[LEFT, y], [this.width - RIGHT, y]]);
      pen.fillText(short(value), LEFT - 6, y);
    }
    pen.textAlign = "center";
    pen.textBaseline = "top";
    for (const t of ticks(...this.span, Math.max(2, Math.floor(this.width / 75)))) {
      pen.fillText(short(t), this.x(t), this.height - BOTTOM + 6);
    }
    const floor = this.height - BOTTOM + 0.5;
    stroke(pen, css("soft"), [[LEFT, floor], [this.width - RIGHT, floor]]);
  }

  // Bands where the body slides or flies, and a thin line at each switch.
  drawModes(pen) {
    const [top, bottom] = [TOP, this.height - BOTTOM];
    pen.globalAlpha = BAND;
    for (const [mode, start, end] of this.modes.spells ?? []) {
      pen.fillStyle = this.colours[mode] ?? "transparent";
      pen.fillRect(this.x(start), top, this.x(end) - this.x(start), bottom - top);
    }
    pen.globalAlpha = 1;
    pen.lineWidth = 0.5;
    for (const t of this.modes.switches ?? []) stroke(pen, css("soft"), [[this.x(t), top], [this.x(t), bottom]]);
  }

  drawLevel(pen, value, dash) {
    pen.setLineDash(dash);
    const y = this.y(value);
    stroke(pen, css("ink"), [[LEFT, y], [this.width - RIGHT, y]]);
    pen.setLineDash([]);
  }

  // Which lines lie on one another, and the places of each among these: they have dashes in the gaps of the others.
  shared() {
    const found = new Map();
    const height = (curve, k) => this.y(curve.at(k));
    const near = (a, b) => {
      if (a.times !== b.times) return false;
      let [close, known] = [0, 0];
      for (let k = 0; k < a.times.length; k++) {
        const apart = Math.abs(height(a, k) - height(b, k));
        if (!Number.isFinite(apart)) continue;
        known++;
        if (apart < NEAR) close++;
      }
      return known > 0 && close >= MOSTLY * known;
    };
    const left = this.curves.filter((curve) => !curve.earlier);
    while (left.length) {
      const group = left.filter((curve) => curve === left[0] || near(left[0], curve)); // one of no numbers is near none
      group.forEach((curve) => left.splice(left.indexOf(curve), 1));
      const solid = group.filter((curve) => !curve.dash.length).length;
      if (group.length < 2 || (group.length === 2 && solid === 1)) continue;
      group.forEach((curve, k) => found.set(curve, [k, group.length]));
    }
    return found;
  }

  drawCurve(pen, { times, at, colour, dash, earlier }, shared) {
    pen.lineWidth = 1.6;
    pen.strokeStyle = readable(colour);
    pen.lineJoin = "round";
    if (shared) {
      const [k, n] = shared;
      if (k) {
        pen.setLineDash([INTERLEAVED, (n - 1) * INTERLEAVED]);
        pen.lineDashOffset = k * INTERLEAVED;
      }
    } else pen.setLineDash(earlier ? EARLIER : dash);
    pen.globalAlpha = earlier ? 0.75 : 1;
    pen.beginPath();
    let drawing = false;
    for (let k = 0; k < times.length; k++) {
      const value = at(k);
      const known = Number.isFinite(value);
      if (this.gaps && k && times[k] === times[k - 1] && this.changes(times[k])) drawing = false;
      if (known) pen[drawing ? "lineTo" : "moveTo"](this.x(times[k]), this.y(value));
      drawing = known;
    }
    pen.stroke();
    pen.setLineDash([]);
    pen.lineDashOffset = 0;
    pen.globalAlpha = 1;
  }

  // Whether one mode follows another at a time.
  changes(t) {
    return (this.modes.spells ?? []).some(([, start]) => start === t);
  }

  // Each curve at its own time that is nearest to t.
  show(t) {
    this.shown = t;
    for (const { name, curves, text } of this.series) {
      const values = curves.map(({ times, at }) => written(at(nearest(times, t))));
      text.data = this.valued ? `${name} ${values.join(" | ")}` : name;
    }
    this.canvas.setAttribute("aria-valuenow", t);
    const told = this.valued ? this.series.map(({ text }) => text.data).join(", ") : "";
    this.canvas.setAttribute("aria-valuetext", `t = ${short(t)}${told && `: ${told}`}`);
    if (!this.width) return;
    const pen = this.canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.drawImage(this.still, 0, 0);
    pen.scale(devicePixelRatio, devicePixelRatio);
    pen.lineWidth = 1;
    const x = this.x(t);
    this.canvas.dataset.cursor = x;
    stroke(pen, css("ink"), [[x, TOP], [x, this.height - BOTTOM]]);
    for (const { times, at, colour } of this.curves) {
      const k = nearest(times, t);
      if (!Number.isFinite(at(k))) continue;
      pen.fillStyle = readable(colour);
      pen.beginPath();
      pen.arc(this.x(times[k]), this.y(at(k)), 3, 0, 2 * Math.PI);
      pen.fill();
    }
  }
}

// A series of one body: the sum of some columns of its array or their norm, which may be over another array.
function curveOf(body, { array, columns, norm, over, colour, dash = [] }) {
  const { values, width } = body.arrays[array];
  const divisor = over && body.arrays[over].values;
  const of = (k) => {
    const found = columns.map((column) => values[k * width + column]);
    return norm ? Math.hypot(...found) : found.reduce((sum, value) => sum + value, 0);
  };
  // No friction is enough where nothing presses, and in flight none is needed.
  const flies = (k) => modeAt(body, body.times[k]) === "flight";
  const ratio = (k) => (divisor[k] > 0 ? of(k) / divisor[k] : flies(k) ? NaN : Infinity);
  const sums = columns.length > 1 && !norm;
  const at = divisor ? ratio : of;
  return { times: body.times, colour: colour ?? body.colour, dash, earlier: body.dashed, sums, at };
}

// What is rounding beside the size of such a quantity, or beside the largest that is drawn, is 0.
function withoutRounding(curves, size) {
  let most = size;
  for (const { times, at } of curves) {
    for (let k = 0; k < times.length; k++) if (Number.isFinite(at(k))) most = Math.max(most, Math.abs(at(k)));
  }
  for (const curve of curves) {
    const [at, least] = [curve.at, most * (curve.sums ? ROUNDING_OF_SUMS : ROUNDING)];
    curve.at = (k) => (Math.abs(at(k)) <= least ? 0 : at(k));
  }
}

function stroke(pen, colour, points) {
  pen.strokeStyle = colour;
  pen.beginPath();
  for (const [x, y] of points) pen.lineTo(x, y);
  pen.stroke();
}

// Round numbers between two others, about `count` of them.
function ticks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw * 0.999);
  const found = [];
  for (let j = Math.ceil(low / step - 1e-9); j * step <= high + 1e-9 * step; j++) found.push(j * step);
  return found;
}

const written = (value) => (Number.isNaN(value) ? "–" : value === 0 ? "0" : value.toPrecision(3).replace("-", "−"));
const short = (value) => String(Number(value.toPrecision(6))).replace("-", "−");
