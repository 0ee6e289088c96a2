// SPDX-License-Identifier: Apache-2.0
// Hides latency: while the user is ahead of the picture by more than one update, a copy of the last picture is warped to the
// newest camera and shown above the canvas. The next picture replaces it. The canvas itself never changes.
//
// A browser that draws without a GPU may need longer for the warped picture than it saves. So the time between animation frames
// is measured, and warping pauses for a while where it makes them slow.
import { cssTransform, fadesOf, homography } from '../../core/warp.js';
import { byId } from '../controls/dom.js';

const AHEAD_MIN = 2; // updates
const SLOW_MS = 22; // between animation frames, on average over SLOW_FRAMES
const SLOW_FRAMES = 12;
const GAP_MS = 200; // a longer time between two of them says nothing: the tab was hidden
const PAUSE_MS = 20000;
const FADE_PX = 100; // width of a strip in style.css

export function install({ warp, viewer, frames, storage, overlay }) {
  const show = () => {
    warp.show(viewer.rig, viewer.ahead, viewer.view?.background ?? [0, 0, 0, 1]);
    overlay.update();
  };
  const isOn = byId('warping');
  isOn.checked = storage.recall('warping') !== 'no';
  warp.isOn = isOn.checked;
  isOn.addEventListener('change', () => {
    storage.remember('warping', isOn.checked ? 'yes' : 'no');
    warp.isOn = isOn.checked;
  });
  viewer.on('camera', show);
  frames.on('drawn', ({ rig }) => {
    warp.drew(rig);
    overlay.drew(rig);
    show();
  });
}

export class Warp {
  #layer; #sheet; #canvas; #fades; #screen;
  #isOn = true;
  #shown = null; // camera of the picture
  #isCopied = false;
  #times = []; // of the last animation frames with a warped picture
  #watching = 0; // the request of the next one
  #pausedUntil = 0;

  /** layer: the element above the canvas, with an element that holds the copy and a strip per side; screen: the Screen. */
  constructor(layer, screen) {
    this.#layer = layer;
    this.#sheet = layer.firstElementChild;
    this.#canvas = layer.querySelector('canvas');
    this.#fades = Object.fromEntries(['left', 'right', 'top', 'bottom'].map((side) => [side, layer.querySelector(`[data-side="${side}"]`)]));
    this.#screen = screen;
  }

  /** True while a warped picture is visible. */
  get isVisible() { return !this.#layer.hidden; }

  set isOn(isOn) {
    this.#isOn = isOn;
    this.#layer.hidden = true;
  }

  /** Shows the canvas: nothing is moving, or no picture will come. */
  hide() {
    this.#layer.hidden = true;
  }

  /** A new picture is on the canvas; `rig`: its camera, or null if it is unknown. */
  drew(rig) {
    this.#shown = rig;
    this.#isCopied = false;
  }

  /** Shows the picture as `rig` would see it; `ahead`: updates that no picture shows yet. */
  show(rig, ahead, background) {
    const isPossible = this.#isOn && performance.now() >= this.#pausedUntil;
    const isMoved = rig && this.#shown && rig !== this.#shown; // other changes of the view are not predicted
    const map = isPossible && ahead >= AHEAD_MIN && isMoved && homography(this.#shown, rig, this.#screen.viewport);
    if (map) {
      if (!this.#isCopied) this.#screen.copyTo(this.#canvas);
      this.#isCopied = true;
      this.#sheet.style.transform = cssTransform(map);
      this.#layer.style.setProperty('--ground', `rgb(${background.slice(0, 3).map((c) => Math.round(255 * c)).join(' ')})`);
      // Strips of the background: a CSS mask of the canvas takes three times as long to draw without a GPU.
      for (const [side, px] of Object.entries(fadesOf(map, this.#screen.viewport))) {
        const axis = side === 'left' || side === 'right' ? 'X' : 'Y';
        this.#fades[side].style.transform = `scale${axis}(${px / FADE_PX})`;
      }
    }
    if (map && this.#layer.hidden) this.#watch();
    this.#layer.hidden = !map;
  }

  /** Measures animation frames until the layer is hidden again. */
  #watch() {
    this.#times = [];
    cancelAnimationFrame(this.#watching);
    const next = (now) => {
      if (this.#layer.hidden) return;
      if (now - this.#times.at(-1) > GAP_MS) this.#times = [];
      this.#times.push(now);
      if (this.#times.length > SLOW_FRAMES && now - this.#times.shift() > SLOW_MS * SLOW_FRAMES) {
        this.#pausedUntil = performance.now() + PAUSE_MS;
        this.#layer.hidden = true;
      } else {
        this.#watching = requestAnimationFrame(next);
      }
    };
    this.#watching = requestAnimationFrame(next);
  }
}
