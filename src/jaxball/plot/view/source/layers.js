// What of a scene can be shown and hidden, by its name.

const FEW = 2; // bodies: of more, forces are hidden at first

// Each layer has its objects, whether these are seen at first, and a colour with the kind of its key.
export function layersOf({ bodies, friction, cone, palette }, stage) {
  const arrows = (name) => stage.arrows.map((of) => of[name]).filter(Boolean);
  const parts = (name) => stage.bodies.map((body) => body[name]).filter(Boolean);
  const { larger } = stage.arrows[0].scales ?? {};
  const few = bodies.length <= FEW;
  const hasRails = bodies.some((body) => body.rails.length);
  const trail = bodies.length > 1 ? null : palette.trail; // several traces have the bodies' colours
  const layers = {
    rolls: () => [
      ["Normal force N", arrows("normal"), few, palette.normal, "arrow"],
      [`Friction f${larger > 1 ? `, ${larger} times as long` : ""}`, arrows("friction"), few, palette.friction, "arrow"],
      ["Slip velocity vₛ", arrows("slip"), few, palette.slip, "arrow"],
      ["Angular velocity ω", arrows("spin"), false, palette.spin, "arrow"],
      ["Angular momentum Π about the contact point", arrows("momentum"), false, palette.momentum, "arrow"],
      [`N + f, cone of μ = ${friction ?? cone}`, arrows("cone"), few],
      ["Centre of mass", parts("centreOfMass"), true],
      ["Contact point", arrows("contact"), true],
      ["Trace", stage.traces, true, trail, "line"],
      ["Motion that is held, dashed", stage.ghosts.filter(Boolean), true],
      ["Estimate, 95 % ellipse", stage.estimates.filter(Boolean), true, palette.momentum, "line"],
      ["Target path", [stage.ground.wanted].filter(Boolean), true],
      ["Obstacles", [stage.ground.obstacles].filter(Boolean), true],
      ["Rails", hasRails ? parts("rails") : [], true],
      ["Axes of space, e", [stage.spaceAxes], false],
      ["Axes of the body, E, dashed", parts("axes"), false],
    ],
    rigid: () => [
      ["Angular velocity ω", arrows("spin"), true, palette.spin, "arrow"],
      ["Angular momentum L", arrows("momentum"), true, palette.momentum, "arrow"],
      ["Vector ξ, to which ω is orthogonal", arrows("xi"), true, palette.xi, "arrow"],
      ["Centre of mass", parts("centreOfMass"), true],
      ["Fixed point", parts("fixedPoint"), true],
      [`Trace of ${bodies[0].tip.name}`, stage.traces, true, bodies.length > 1 ? null : bodies[0].tip.colour, "line"],
      ["Trace of ω, the herpolhode", stage.herpolhodes, false, bodies.length > 1 ? null : palette.spin, "line"],
      ["Axes of space, e", [stage.spaceAxes], true],
      ["Axes of the body, E, dashed", parts("axes"), true],
    ],
    particle: () => [
      ["Velocity", arrows("velocity"), few, palette.momentum, "arrow"],
      ["Path", stage.traces, true, trail, "line"],
      ["Shadow of the path", [stage.box.shadows], true],
      ["Box", [stage.box.frame], true],
    ],
    drawn: () => [
      ["Picture", stage.bodies, true],
      ["Path of the last point", stage.traces, true, trail, "line"],
    ],
  };
  const named = stage.labels.all.length ? [["Names", [stage.labels], true]] : [];
  return [...layers[stage.kind]().filter(([, objects]) => objects.length), ...named];
}
