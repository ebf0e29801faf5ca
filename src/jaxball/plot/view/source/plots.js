// Graphs over time on plain canvases, with a cursor at the time shown. What does not move is drawn once, behind it.

import { css, readable } from "./theme.js";

const [LEFT, RIGHT, TOP, BOTTOM] = [46, 8, 6, 20];

export class Plot {
  constructor(run, { title, series, level }, seek) {
    this.times = run.arrays.time.values;
    this.level = level && run.friction !== null ? { name: level, value: run.friction } : null;
    this.series = series.map(({ name, colour, array, columns }) => {
      const { values, width } = run.arrays[array];
      return { name, colour, at: (k) => columns.reduce((sum, column) => sum + values[k * width + column], 0) };
    });
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("aria-label", `${title} over time; click or drag to go to a time`);
    this.still = document.createElement("canvas");
    this.figure = document.createElement("figure");
    this.figure.className = "plot";
    const caption = document.createElement("figcaption");
    const heading = document.createElement("b");
    heading.textContent = title;
    caption.append(heading);
    for (const one of this.series) {
      one.label = document.createElement("span");
      caption.append(one.label);
    }
    if (this.level) {
      const label = document.createElement("span");
      label.textContent = `- - ${this.level.name} = ${this.level.value}`;
      caption.append(label);
    }
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
    for (const one of this.series) for (let k = 0; k < this.times.length; k++) include(one.at(k));
    if (this.level) include(this.level.value);
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
    this.drawAxes(pen);
    if (this.level) this.drawLevel(pen);
    for (const one of this.series) this.drawCurve(pen, one);
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

  drawLevel(pen) {
    pen.setLineDash([5, 4]);
    const y = this.y(this.level.value);
    stroke(pen, css("ink"), [[LEFT, y], [this.width - RIGHT, y]]);
    pen.setLineDash([]);
  }

  drawCurve(pen, one) {
    pen.lineWidth = 1.6;
    pen.strokeStyle = readable(one.colour);
    pen.lineJoin = "round";
    pen.beginPath();
    let drawing = false;
    for (let k = 0; k < this.times.length; k++) {
      const value = one.at(k);
      const known = Number.isFinite(value);
      if (known) pen[drawing ? "lineTo" : "moveTo"](this.x(this.times[k]), this.y(value));
      drawing = known;
    }
    pen.stroke();
  }

  show(k) {
    this.shown = k;
    for (const one of this.series) {
      one.label.style.color = readable(one.colour);
      one.label.textContent = `${one.name} ${one.at(k).toPrecision(3).replace("-", "−")}`;
    }
    if (!this.width) return;
    const pen = this.canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.drawImage(this.still, 0, 0);
    pen.scale(devicePixelRatio, devicePixelRatio);
    pen.lineWidth = 1;
    const x = this.x(this.times[k]);
    this.canvas.dataset.cursor = x;
    stroke(pen, css("ink"), [[x, TOP], [x, this.height - BOTTOM]]);
    for (const one of this.series) {
      if (!Number.isFinite(one.at(k))) continue;
      pen.fillStyle = readable(one.colour);
      pen.beginPath();
      pen.arc(x, this.y(one.at(k)), 3, 0, 2 * Math.PI);
      pen.fill();
    }
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

const short = (value) => String(Number(value.toPrecision(6))).replace("-", "−");
