// What surfaces are painted with: flat, lit, or glass. Every material takes its colour from a function, which is asked
// again when the theme changes.

import { Color, ShaderMaterial } from "three";

const painted = [];

export function paint(material, colour) {
  painted.push([material, colour]);
  return material;
}

export function repaint() {
  for (const [material, colour] of painted) material.color.set(colour());
}

const PLACED = `
  varying vec3 n; varying vec3 v;
  void main() {
    vec4 p = modelViewMatrix * vec4(position, 1.0);
    n = normalMatrix * normal; v = -p.xyz;
    gl_Position = projectionMatrix * p;
  }`;
const AT_A_POINT = "void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }";
const FLAT = `
  uniform vec3 colour; uniform float opacity;
  void main() {
    gl_FragColor = vec4(colour, opacity);
    #include <colorspace_fragment>
  }`;
// Light from above and the left, at rest in the scene, with a small highlight.
const LIT = `
  uniform vec3 colour; varying vec3 n; varying vec3 v;
  void main() {
    vec3 m = normalize(n), light = normalize((viewMatrix * vec4(-0.28, -0.47, 0.84, 0.0)).xyz);
    float shine = pow(max(dot(m, normalize(light + normalize(v))), 0.0), 30.0);
    gl_FragColor = vec4(colour * (0.5 + 0.65 * max(dot(m, light), 0.0)) + 0.12 * shine, 1.0);
    #include <colorspace_fragment>
  }`;
const GLASS = `
  uniform vec3 colour; varying vec3 n; varying vec3 v;
  void main() {
    float edge = pow(1.0 - abs(dot(normalize(n), normalize(v))), 3.0);
    gl_FragColor = vec4(colour, 0.035 + 0.5 * edge);
    #include <colorspace_fragment>
  }`;

function shaded(vertexShader, fragmentShader, colour, { opacity = 1, ...options } = {}) {
  const value = new Color();
  const uniforms = { colour: { value }, opacity: { value: opacity } };
  const material = new ShaderMaterial({ vertexShader, fragmentShader, uniforms, ...options });
  material.color = value;
  return paint(material, colour);
}

export const flat = (colour, options) => shaded(AT_A_POINT, FLAT, colour, options);
export const solid = (colour, options) => shaded(PLACED, LIT, colour, options);
export const glass = (colour, side) => shaded(PLACED, GLASS, colour, { side, transparent: true, depthWrite: false });
