// The bundle: three.js from its modules and not as a whole, without what no part of the scene asks for. Those are the
// shaders of its own materials, of which the scene has none but that of wide lines, and what is named in `ABSENT`.

import { readFile } from "node:fs/promises";
import { basename, resolve } from "node:path";
import { build } from "esbuild";

const THREE = resolve("node_modules/three/src/Three.js");
const KEPT = ["common", "colorspace_fragment", "colorspace_pars_fragment"];
const ABSENT = {
  "DFGLUTData.js": "export const getDFGLUT = () => null;",
  "PMREMGenerator.js": "export class PMREMGenerator {}",
  "WebGLOutput.js": "export class WebGLOutput {}",
  "WebGLShadowMap.js": "export class WebGLShadowMap { render() {} }",
  "WebXRManager.js": `export class WebXRManager {
    enabled = false; isPresenting = false;
    addEventListener() {} setAnimationLoop() {} getEnvironmentBlendMode() {}
  }`,
};

const lean = {
  name: "lean",
  setup({ onResolve, onLoad }) {
    onResolve({ filter: /^three$/ }, () => ({ path: THREE, sideEffects: false }));
    onLoad({ filter: /ShaderChunk[\\/].*\.glsl\.js$/ }, async ({ path }) => {
      const name = basename(path, ".glsl.js");
      return { contents: KEPT.includes(name) ? await readFile(path, "utf8") : 'export default "";' };
    });
    onLoad({ filter: /ShaderLib[\\/].*\.glsl\.js$/ }, () => ({ contents: 'export const vertex = "", fragment = "";' }));
    onLoad({ filter: /[\\/]src[\\/].*\.js$/ }, ({ path }) => {
      const contents = ABSENT[basename(path)];
      return contents && { contents };
    });
  },
};

await build({
  entryPoints: ["main.js"],
  outfile: "../view.bundle.js",
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "utf8",
  legalComments: "none",
  plugins: [lean],
});
