// Puts the page together: its texts, the scene, the graphs, and what the viewer can do.

import { modeAt, nearest, readView } from "./data.js";
import { layersOf } from "./layers.js";
import { bodyKeys, colourBar, key, partKeys, repaintKeys } from "./legend.js";
import { Player } from "./player.js";
import { Plot } from "./plots.js";
import { Stage } from "./stage.js";
import { followTheme } from "./theme.js";

const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4, 8, 16];
const FRAMES = {
  rolls: { ground: "Ground", follow: "Follow", body: "Body frame" },
  rigid: { ground: "Space", body: "Body frame" },
  particle: { ground: "Space", follow: "Follow" },
  drawn: { ground: "Space" },
};
const element = (id) => document.getElementById(id);
const wide = matchMedia("(min-width: 721px)"); // with a scene beside which there is room for names
const wider = matchMedia("(min-width: 900px)"); // and for the settings

const view = readView(element("run").textContent);
const { times, bodies } = view;
const stage = new Stage(element("scene"), view, element("labels"));
const plots = view.plots.map((plot) => new Plot(view, plot, (t) => player.goTo(t)));
const player = new Player(times, show, (playing) => element("play").classList.toggle("playing", playing));
const digits = Math.min(6, Math.max(2, Math.ceil(-Math.log10((times[times.length - 1] - times[0]) / times.length || 1))));

function show(t) {
  stage.show(t);
  for (const plot of plots) plot.show(t);
  const mode = modeAt(bodies[stage.followed], t);
  element("clock").textContent = `t = ${t.toFixed(digits)}${mode && `, ${mode}`}`;
  element("slider").value = t;
  element("slider").setAttribute("aria-valuetext", `t = ${t.toFixed(digits)}`);
}

function writeTexts() {
  document.title = view.title;
  element("title").textContent = view.title;
  element("units").textContent = view.units;
  element("status").textContent = view.message;
  element("status").classList.toggle("failed", !view.ok);
  element("note").textContent = view.note;
  element("note").hidden = !view.note;
  element("stage").classList.toggle("blind", !stage.renderer);
  element("apology").hidden = Boolean(stage.renderer);
  element("apology").textContent = "This browser has no WebGL, which the scene needs; the graphs work without it.";
  element("plots").append(...plots.map((plot) => plot.figure));
}

function writeKeys() {
  element("masses").append(...partKeys(view));
  element("bodies").hidden = bodies.length === 1;
  if (bodies.length === 1) return;
  const follow = (i) => {
    stage.follow(i);
    show(player.time);
  };
  element("names").append(...bodyKeys(bodies, stage.followed, follow));
  element("names").classList.toggle("many", bodies.length > 6);
  if (bodies.length > 2) openWhere(element("bodies"), wide);
  else element("bodies").open = true;
  if (view.scale) element("scale").append(...colourBar(view.scale));
}

// A frame may have its width only after the page has run.
function openWhere(details, query) {
  const follow = () => (details.open = query.matches);
  query.addEventListener("change", follow);
  follow();
}

function choice(type, text, checked, changed, colour, kind) {
  const label = document.createElement("label");
  const input = document.createElement("input");
  Object.assign(input, { type, checked });
  if (type === "radio") input.name = "frame";
  input.addEventListener("change", () => changed(input.checked));
  label.append(input, text);
  if (colour) label.append(key(colour, kind));
  return label;
}

function writeChoices() {
  for (const [frame, text] of Object.entries(FRAMES[stage.kind])) {
    element("frames").append(choice("radio", text, stage.frame === frame, () => stage.setFrame(frame)));
  }
  for (const [text, objects, visible, colour, kind] of layersOf(view, stage)) {
    const set = (checked) => objects.forEach((object) => (object.visible = checked));
    set(visible);
    const changed = (checked) => {
      set(checked);
      stage.render();
    };
    element("layers").append(choice("checkbox", text, visible, changed, colour, kind));
  }
  const settings = element("settings");
  openWhere(settings, wider);
  const leaveFree = () => stage.resize(wide.matches && settings.open ? settings.offsetWidth : 0);
  settings.addEventListener("toggle", leaveFree);
  leaveFree();
}

const timeKeys = {
  " ": () => player.toggle(),
  ArrowLeft: () => player.step(-1),
  ArrowRight: () => player.step(1),
  Home: () => jaxball.goTo(times[0]),
  End: () => jaxball.goTo(times[times.length - 1]),
};
const cameraKeys = {
  " ": () => player.toggle(),
  ArrowLeft: () => stage.turn(-1, 0),
  ArrowRight: () => stage.turn(1, 0),
  ArrowUp: () => stage.turn(0, 1),
  ArrowDown: () => stage.turn(0, -1),
  "+": () => stage.turn(0, 0, 1 / 1.15),
  "-": () => stage.turn(0, 0, 1.15),
  Home: () => stage.reset(),
};

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
  Object.assign(slider, { min: times[0], max: times[times.length - 1], step: "any" });
  slider.addEventListener("input", () => player.goTo(Number(slider.value)));
  for (const speed of SPEEDS) element("speed").append(new Option(`${speed}×`, speed, speed === 1, speed === 1));
  element("speed").addEventListener("change", (event) => (player.speed = Number(event.target.value)));
  element("loop").addEventListener("change", (event) => (player.loop = event.target.checked));
  addEventListener("keydown", (event) => {
    const own = event.target.closest?.("select, summary, input:not([type=range])");
    const keys = event.target === element("scene") ? cameraKeys : timeKeys;
    const act = keys[event.key];
    if (own || !act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  });
}

writeTexts();
writeKeys();
writeChoices();
listen();
followTheme(element("theme"), () => {
  stage.repaint();
  for (const plot of plots) plot.redraw();
  repaintKeys();
});
player.goTo(times[0]);

// For tests and scripts. The pose of a body is read from the scene, in axes whose third points against gravity.
window.jaxball = {
  time: () => player.time,
  goTo: (t) => {
    player.pause();
    player.goTo(t);
  },
  bodies: () => bodies.map((body) => body.name),
  pose: (i = stage.followed) => ({
    name: bodies[i].name,
    time: bodies[i].times[nearest(bodies[i].times, player.time)],
    centre: stage.bodies[i].position.toArray(),
    quaternion: stage.bodies[i].quaternion.toArray(),
    masses: stage.bodies[i].masses.map((mass) => mass.position.toArray()),
    ghost: stage.ghosts[i]?.outline.position.toArray() ?? null,
    estimate: stage.estimates[i]?.position.toArray() ?? null,
    ellipse: stage.estimates[i]?.ellipse.matrix.elements.slice(0, 8) ?? null,
    centreOfMass: stage.bodies[i].centreOfMass?.position.toArray() ?? null,
  }),
};
