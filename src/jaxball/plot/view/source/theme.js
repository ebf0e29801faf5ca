// Light or dark, and colours that can be read on either.

import { Color } from "three";

const CONTRAST = 4.6; // a little more, because colours of a page are whole numbers
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

// A colour of the figures, which are on white: on black, the dark ones are made lighter. "ink" is the colour of text.
export function readable(colour) {
  if (colour === "ink") return css("ink");
  if (!isDark()) return colour;
  const hsl = new Color(colour).getHSL({}, "srgb");
  return `#${new Color().setHSL(hsl.h, hsl.s * 0.7, Math.max(hsl.l, 0.62), "srgb").getHexString()}`;
}

// The same colour as that of a text, darker or lighter where it would be hard to read: WCAG asks for a contrast of 4.5.
export function legible(colour) {
  const shown = new Color(readable(colour));
  const hsl = shown.getHSL({}, "srgb");
  const step = isDark() ? 0.02 : -0.02;
  for (let l = hsl.l; contrast(shown) < CONTRAST && l >= 0 && l <= 1; l += step) shown.setHSL(hsl.h, hsl.s, l, "srgb");
  return `#${shown.getHexString()}`;
}

// With the paper that is nearest to it, of the page and of its panels.
function contrast(colour) {
  const own = luminance(colour);
  return Math.min(
    ...["paper", "panel"].map((name) => {
      const paper = luminance(new Color(css(name)));
      return (Math.max(own, paper) + 0.05) / (Math.min(own, paper) + 0.05);
    }),
  );
}

// A Color has its numbers in linear light.
const luminance = ({ r, g, b }) => 0.2126 * r + 0.7152 * g + 0.0722 * b;
