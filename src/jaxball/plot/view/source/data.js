// The dictionary of a run, with its arrays as typed arrays.

const TYPES = { float32: Float32Array, float64: Float64Array };
const FORMAT = "jaxball view";
const VERSION = 1;

export function readRun(text) {
  const run = JSON.parse(text);
  if (run.format !== FORMAT || run.version !== VERSION) {
    throw new Error(`This page reads ${FORMAT} ${VERSION}, but it holds ${run.format} ${run.version}.`);
  }
  for (const [name, array] of Object.entries(run.arrays)) run.arrays[name] = decoded(array);
  return run;
}

function decoded({ type, shape, data }) {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const width = shape.slice(1).reduce((product, size) => product * size, 1);
  return { values: new TYPES[type](bytes.buffer), shape, width };
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

export function largest(values) {
  let found = 0;
  for (const value of values) if (Number.isFinite(value)) found = Math.max(found, Math.abs(value));
  return found;
}
