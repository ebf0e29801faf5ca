// The dictionary of the page, with its arrays as typed arrays: each body has its own by their names.

const TYPES = { float32: Float32Array, float64: Float64Array };
const FORMAT = "jaxball view";
const VERSION = 5;
export const STILL = [0, 0, 0]; // the displacement of a ground that does not move
export const UPRIGHT = [0, 0, 0, 1]; // the quaternion of one that does not turn

export function readView(text) {
  const view = JSON.parse(text);
  if (view.format !== FORMAT || view.version !== VERSION) {
    throw new Error(`This page reads ${FORMAT} ${VERSION}, but it holds ${view.format} ${view.version}.`);
  }
  const arrays = view.arrays.map(decoded);
  for (const body of view.bodies) {
    for (const [name, place] of Object.entries(body.arrays)) body.arrays[name] = arrays[place];
    body.times = body.arrays.time.values;
  }
  view.wanted = view.wanted === null ? null : arrays[view.wanted].values;
  view.times = clock(view.bodies);
  return view;
}

function decoded({ type, shape, data }) {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const width = shape.slice(1).reduce((product, size) => product * size, 1);
  return { values: new TYPES[type](bytes.buffer), shape, width };
}

// Every time that one of the bodies has, once.
function clock(bodies) {
  const times = Float64Array.from(bodies.flatMap((body) => Array.from(body.times))).sort();
  return times.filter((t, k) => k === 0 || t > times[k - 1]);
}

// The k-th row of an array; without such an array, `otherwise`.
export function row(array, k, otherwise) {
  return array ? array.values.subarray(k * array.width, (k + 1) * array.width) : otherwise;
}

// The index of the time nearest to t, of times that increase.
export function nearest(times, t) {
  let low = 0;
  let high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return t - times[low] <= times[high] - t ? low : high;
}

// The mode of a body at a time, "" of one without a law of contact.
export function modeAt({ spells }, t) {
  const begun = spells?.findLast(([, start]) => start <= t) ?? spells?.[0];
  return begun ? begun[0] : "";
}

// The largest number by size in the arrays of these names, of any of the bodies.
export function largest(bodies, ...names) {
  let found = 0;
  for (const { arrays } of bodies) {
    for (const name of names) {
      for (const value of arrays[name]?.values ?? []) if (Number.isFinite(value)) found = Math.max(found, Math.abs(value));
    }
  }
  return found;
}
