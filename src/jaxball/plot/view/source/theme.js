// Light or dark, and colours that can be read on either.

import { Color } from "three";

const root = document.documentElement;
const prefers = matchMedia("(prefers-color-scheme: dark)");

export function followTheme(button, changed) {
  const set = (dark) => {
    root.dataset.theme = dark ? "dark" : "light";
    changed();
  };
  button.addEventListener("click", () => set(!isDark()));
  prefers.addEventListener("change", (event) => set(event.matches));
  set(prefers.matches);
}

export const isDark = () => root.dataset.theme === "dark";

export const css = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();

// A colour of the figures, which are on white: on black, the dark ones are made lighter.
export function readable(colour) {
  if (!isDark()) return colour;
  const hsl = new Color(colour).getHSL({}, "srgb");
  return `#${new Color().setHSL(hsl.h, hsl.s * 0.7, Math.max(hsl.l, 0.62), "srgb").getHexString()}`;
}
