// Puts the page together: the run's texts, the scene, the graphs, and what the viewer can do.

import { readRun } from "./data.js";
import { Player } from "./player.js";
import { Plot } from "./plots.js";
import { Stage } from "./stage.js";
import { followTheme, readable } from "./theme.js";

const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4, 8, 16];
const FRAMES = { ground: "Ground", follow: "Follow", body: "Body frame" };
const element = (id) => document.getElementById(id);

const run = readRun(element("run").textContent);
const times = run.arrays.time.values;
const stage = new Stage(element("scene"), run);
const plots = run.plots.map((plot) => new Plot(run, plot, (t) => player.goTo(t)));
const player = new Player(times, show, (playing) => element("play").classList.toggle("playing", playing));
const digits = Math.min(6, Math.max(2, Math.ceil(-Math.log10((times[times.length - 1] - times[0]) / times.length || 1))));

function show(k) {
  stage.show(k);
  for (const plot of plots) plot.show(k);
  element("clock").textContent = `t = ${times[k].toFixed(digits)}`;
  element("slider").value = k;
  element("slider").setAttribute("aria-valuetext", `t = ${times[k].toFixed(digits)}`);
}

function writeTexts() {
  document.title = run.title;
  element("title").textContent = run.title;
  element("units").textContent = run.units;
  element("status").textContent = run.message;
  element("status").classList.toggle("failed", !run.ok);
  element("apology").hidden = Boolean(stage.renderer);
  element("apology").textContent = "This browser has no WebGL, which the scene needs; the graphs work without it.";
  element("plots").append(...plots.map((plot) => plot.figure));
}

const keyed = []; // keys of colours, which change with the theme

function key(colour) {
  const dot = document.createElement("i");
  dot.className = "key";
  keyed.push([dot, colour]);
  return dot;
}

function writeMasses() {
  const names = new Map(run.masses.map((mass) => [mass.name, mass.colour]));
  for (const [name, colour] of names) {
    const item = document.createElement("li");
    item.append(key(colour), name);
    element("masses").append(item);
  }
}

function choice(type, text, checked, changed, colour) {
  const label = document.createElement("label");
  const input = document.createElement("input");
  Object.assign(input, { type, checked });
  if (type === "radio") input.name = "frame";
  input.addEventListener("change", () => changed(input.checked));
  label.append(input, text);
  if (colour) label.append(key(colour));
  return label;
}

function writeChoices() {
  const { arrows, body, ground, spaceAxes } = stage;
  const [blue, red, yellow] = run.palette.components;
  for (const [frame, text] of Object.entries(FRAMES)) {
    element("frames").append(choice("radio", text, stage.frame === frame, () => stage.setFrame(frame)));
  }
  const layers = [
    ["Normal force N", arrows.normal, true, blue],
    ["Friction f", arrows.friction, true, red],
    ["Angular velocity ω", arrows.spin, false, yellow],
    [`N + f, cone of μ = ${run.friction}`, arrows.cone, true],
    ["Centre of mass", body.centreOfMass, true],
    ["Contact point", arrows.contact, true],
    ["Trace", ground.trace, true, run.palette.trail],
    ["Rails", run.rails.length ? body.rails : null, true],
    ["Axes of space", spaceAxes, false],
    ["Axes of the body", body.axes, false],
  ];
  for (const [text, object, visible, colour] of layers.filter(([, object]) => object)) {
    object.visible = visible;
    const changed = (checked) => {
      object.visible = checked;
      stage.render();
    };
    element("layers").append(choice("checkbox", text, visible, changed, colour));
  }
  element("settings").open = !matchMedia("(max-width: 720px)").matches;
}

function listen() {
  const click = (id, action) =>
    element(id).addEventListener("click", (event) => {
      action();
      event.currentTarget.blur(); // so that the space bar plays, and does not press the button again
    });
  click("play", () => player.toggle());
  click("back", () => player.step(-1));
  click("forward", () => player.step(1));
  click("reset", () => stage.reset());
  const slider = element("slider");
  slider.max = times.length - 1;
  slider.addEventListener("input", () => player.goToFrame(Number(slider.value)));
  for (const speed of SPEEDS) element("speed").append(new Option(`${speed}×`, speed, speed === 1, speed === 1));
  element("speed").addEventListener("change", (event) => (player.speed = Number(event.target.value)));
  element("loop").addEventListener("change", (event) => (player.loop = event.target.checked));
  addEventListener("keydown", (event) => {
    const own = event.target.closest?.("select, summary, input:not([type=range])");
    const act = { " ": () => player.toggle(), ArrowLeft: () => player.step(-1), ArrowRight: () => player.step(1) }[event.key];
    if (own || !act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  });
}

writeTexts();
writeMasses();
writeChoices();
listen();
followTheme(element("theme"), () => {
  stage.repaint();
  for (const plot of plots) plot.redraw();
  for (const [dot, colour] of keyed) dot.style.background = readable(colour);
});
player.goTo(times[0]);

// For tests and scripts. The pose is read from the scene, in axes whose third points against gravity.
window.jaxball = {
  time: () => times[player.k],
  goTo: (t) => {
    player.pause();
    player.goTo(t);
  },
  pose: () => ({
    time: times[player.k],
    centre: stage.body.position.toArray(),
    quaternion: stage.body.quaternion.toArray(),
    masses: stage.body.masses.map((mass) => mass.position.toArray()),
  }),
};
