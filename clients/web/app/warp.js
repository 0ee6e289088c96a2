// SPDX-License-Identifier: Apache-2.0
// Hides latency: while the user is ahead of the picture by more than one update, a copy of the last picture is warped to the
// newest camera and shown above the canvas. The next picture replaces it. The canvas itself never changes.
import { cssTransform, homography } from '../core/warp.js';

const AHEAD_MIN = 2; // updates

export class Warp {
  #layer; #canvas; #screen;
  #isOn = true;
  #shown = null; // camera of the picture
  #isCopied = false;

  /** layer: the element above the canvas; screen: the Screen. */
  constructor(layer, screen) {
    this.#layer = layer;
    this.#canvas = layer.querySelector('canvas');
    this.#screen = screen;
  }

  /** True while a warped picture is visible. */
  get isVisible() { return !this.#layer.hidden; }

  set isOn(isOn) {
    this.#isOn = isOn;
    this.#layer.hidden = true;
  }

  /** A new picture is on the canvas; `rig`: its camera, or null if it is unknown. */
  drew(rig) {
    this.#shown = rig;
    this.#isCopied = false;
  }

  /** Shows the picture as `rig` would see it; `ahead`: updates that no picture shows yet. */
  show(rig, ahead, background) {
    const map = this.#isOn && ahead >= AHEAD_MIN && rig && this.#shown && homography(this.#shown, rig, this.#screen.viewport);
    if (map) {
      if (!this.#isCopied) this.#screen.copyTo(this.#canvas);
      this.#isCopied = true;
      this.#canvas.style.transform = cssTransform(map);
      this.#layer.style.background = `rgb(${background.slice(0, 3).map((c) => Math.round(255 * c)).join(' ')})`;
    }
    this.#layer.hidden = !map;
  }
}
