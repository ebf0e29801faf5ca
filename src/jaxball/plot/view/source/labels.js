// Names beside things in the scene: texts of the page, which move with what they name.

import { Object3D, Vector3 } from "three";
import { legible } from "./theme.js";

const at = new Vector3();

export class Labels {
  constructor(layer) {
    this.layer = layer;
    this.all = [];
    this.visible = true;
  }

  // A name to the right or the left of an object of the scene, in a colour; where the object is hidden, so is the name.
  add(object, text, colour, left = false) {
    const element = document.createElement("span");
    element.textContent = text;
    this.layer.append(element);
    this.all.push({ object, element, colour, left });
  }

  place(camera, width, height) {
    for (const { object, element, left } of this.all) {
      const inFront = this.visible && isShown(object) && at.setFromMatrixPosition(object.matrixWorld).project(camera).z < 1;
      element.hidden = !inFront;
      if (!inFront) continue;
      const [x, y] = [((at.x + 1) / 2) * width, ((1 - at.y) / 2) * height];
      const beside = left ? " translateX(calc(-100% - 8px))" : "";
      element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)${beside}`;
    }
  }

  repaint() {
    for (const { element, colour } of this.all) element.style.color = legible(colour());
  }
}

function isShown(object) {
  for (let here = object; here; here = here.parent) if (!here.visible) return false;
  return true;
}

// A place in the scene that has a name and nothing else.
export function place(parent, point) {
  const found = new Object3D();
  found.position.fromArray(point);
  parent.add(found);
  return found;
}
