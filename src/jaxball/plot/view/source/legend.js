// Keys of colours: of the bodies, one of which is followed, of the number that colours them, and of the masses
// or axes.

import { legible, readable } from "./theme.js";

const AXES = { rigid: ["E₁", "E₂", "E₃"], particle: ["x", "y", "z"], drawn: [] };
const keyed = []; // what changes with the theme

// A dot, or a line of a width, or the square of a band.
export function key(colour, kind = "dot") {
  const dot = document.createElement("i");
  dot.className = `key ${kind}`;
  dot.setAttribute("aria-hidden", "true");
  keyed.push(() => (dot.style.background = readable(colour)));
  return dot;
}

// The line of a series as it is drawn in its graph.
export function sample(colour, dash) {
  const line = document.createElement("canvas");
  const [width, height] = [20, 8];
  line.className = "sample";
  line.setAttribute("aria-hidden", "true");
  const paint = () => {
    line.width = width * devicePixelRatio;
    line.height = height * devicePixelRatio;
    const pen = line.getContext("2d");
    pen.scale(devicePixelRatio, devicePixelRatio);
    pen.strokeStyle = readable(colour);
    pen.lineWidth = 2;
    pen.setLineDash(dash);
    pen.moveTo(0, height / 2);
    pen.lineTo(width, height / 2);
    pen.stroke();
  };
  keyed.push(paint);
  return line;
}

// A text in a colour.
export function tint(element, colour) {
  keyed.push(() => (element.style.color = legible(colour)));
}

export function repaintKeys() {
  for (const paint of keyed) paint();
}

export const short = (value) => String(Number(value.toPrecision(4))).replace("-", "−");

// Of the masses, or of the axes where there are none: those of rigid bodies, and those of space of particles; and of the
// bands of graphs.
export function partKeys({ bodies, floor, palette }) {
  const names = new Map(bodies.flatMap((body) => body.masses).map((mass) => [mass.name, mass.colour]));
  if (!floor) AXES[bodies[0].body].forEach((name, j) => names.set(name, palette.components[j]));
  const [{ spells = [] }, ...others] = bodies;
  const modes = others.length ? [] : spells.map(([mode]) => mode).filter((mode) => palette.modes[mode]);
  const bands = [...new Set(modes)].map((mode) => [mode, palette.modes[mode], "band"]);
  return [...[...names].map(([name, colour]) => [name, colour, "dot"]), ...bands].map(([name, colour, kind]) => {
    const item = document.createElement("li");
    item.append(key(colour, kind), name);
    return item;
  });
}

// A button for each body, of which the one that is followed is pressed.
export function bodyKeys(bodies, followed, follow) {
  const buttons = bodies.map((body, i) => {
    const button = document.createElement("button");
    const value = body.value === null ? "" : ` ${short(body.value)}`;
    Object.assign(button, { type: "button", title: `Follow ${body.name}` });
    button.append(key(body.colour), body.name);
    const number = document.createElement("span");
    number.textContent = value;
    button.append(number);
    button.addEventListener("click", () => {
      follow(i);
      press(i);
      button.blur();
    });
    return button;
  });
  const press = (i) => buttons.forEach((button, j) => button.setAttribute("aria-pressed", i === j));
  press(followed);
  return buttons;
}

// The colours of a number from its least value to its largest.
export function colourBar({ name, low, high, logarithmic, stops }) {
  const [label, bar, ends] = ["p", "i", "p"].map((tag) => document.createElement(tag));
  label.textContent = logarithmic ? `${name}, logarithmic` : name;
  bar.className = "bar";
  keyed.push(() => (bar.style.background = `linear-gradient(to right, ${stops.map(readable).join(", ")})`));
  for (const value of [low, high]) {
    const end = document.createElement("span");
    end.textContent = short(value);
    ends.append(end);
  }
  ends.className = "ends";
  return [label, bar, ends];
}
