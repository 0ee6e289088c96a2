// SPDX-License-Identifier: Apache-2.0
// Hides latency and the rate of the frames: while the user is ahead of the picture, a layer above the canvas shows the last picture as the newest
// camera sees it. The next picture replaces it. The canvas itself never changes. A frame with depth is drawn point by point (depth_warp.js). A
// frame without depth is copied and warped as if it were painted on a plane, once the user is ahead by more than one update.
//
// A browser that draws without a GPU may need longer for the flat warp than it saves. So the time between animation frames is
// measured, and the flat warp pauses for a while where it makes them slow.
import { cssTransform, fadesOf, homography, isFurther } from '../../core/warp.js';
import { nextFrame } from './animation.js';

const AHEAD_MIN = 2; // updates
const SLOW_MS = 22; // between animation frames, on average over SLOW_FRAMES
const SLOW_FRAMES = 12;
const GAP_MS = 200; // a longer time between two of them says nothing: the tab was hidden
const PAUSE_MS = 20000;
const STOPPED_MS = 30; // without a new camera for so long, the hand seems to have stopped
const LARGER = 1.25; // without a GPU, a frame fades in if it has so many times the width of the last one, or is final
const FADE_PX = 100; // width of a strip in style.css

/** Moving frames may show the camera this many ms ahead: they are wanted with depth, and drawn as the newest camera sees them. */
const PREDICT_MS = 300;
/** Imports the modules of parts/warp.js. A bundle that contains them, such as the notebook widget, replaces it. */
export const parts = { warp: () => import(new URL('../parts/warp.js', import.meta.url).href) };

/** Parameters of the stream that a window sets which warps frames by their depth, or does not. */
export const depthSettings = (isWanted) => ({ depth: isWanted, predict: isWanted ? PREDICT_MS : 0 });

/** Shows the newest frame for the newest camera whenever one of them changes. Sets app.wantsDepth(), which tells if frames should come with
 * depth. A client that only watches needs none: it is never ahead of the frames. */
export function follow(app) {
  const { warp, viewer, frames, overlay } = app;
  const show = () => {
    warp.show(viewer.rig, viewer.ahead, viewer.view?.background ?? [0, 0, 0, 1]);
    overlay?.update();
  };
  app.wantsDepth = () => warp.isOn && Boolean(warp.depth) && viewer.canControl;
  let before = app.wantsDepth();
  const tell = () => {
    if (app.wantsDepth() === before) return;
    before = app.wantsDepth();
    app.configure(depthSettings(before));
  };
  warp.onSwitch = tell;
  viewer.on('view', tell);
  viewer.on('camera', show);
  let isAsked = false;
  frames.on('drawn', ({ rig, isAhead }) => {
    if (!isAsked) {
      isAsked = true;
      warp.load().then(tell, () => {}); // without it, the flat warp stays
    }
    warp.drew(rig, isAhead);
    overlay?.drew(rig);
    show();
  });
}

export class Warp {
  #layer; #sheet; #canvas; #fades; #screen;
  #depth = null; // a DepthWarp, once it is loaded
  #fade = null; // a Fade, once it is loaded
  #wanted = null; // {rig, ground} to draw by depth at the next animation frame
  #isOn = true;
  onSwitch = () => {}; // called after isOn was set
  #shown = null; // camera of the picture
  #isAhead = false; // no view had this camera
  #hand = null; // the newest camera,
  #movedAt = 0; // and when it came
  #isCopied = false;
  #times = []; // of the last animation frames with a warped picture
  #watching = 0; // the request of the next one
  #pausedUntil = 0;

  /** layer: the element above the canvas, with an element that holds the copy and a strip per side, and a canvas; without the former, only frames
   * with depth are warped. screen: the Screen. */
  constructor(layer, screen) {
    this.#layer = layer;
    this.#sheet = layer.querySelector('div');
    this.#canvas = layer.querySelector('canvas');
    this.#fades = Object.fromEntries(['left', 'right', 'top', 'bottom'].map((side) => [side, layer.querySelector(`[data-side="${side}"]`)]));
    this.#screen = screen;
  }

  /** The frames by their depth (depth_warp.js); null until load() is done. */
  get depth() { return this.#depth; }

  /** Frames that replace coarser ones gradually (fade.js); null until load() is done. */
  get fade() { return this.#fade; }

  /** Loads what draws frames by their depth. Without it, they are warped as if they were flat. */
  async load() {
    const { DepthWarp, Fade } = await parts.warp();
    this.#depth = new DepthWarp(this.#layer.lastElementChild, this.#screen, () => this.hide());
    this.#fade = new Fade(this.#screen);
  }

  /** True while a warped picture is visible. */
  get isVisible() { return !this.#layer.hidden; }

  /** False: the canvas is always shown as it is. */
  get isOn() { return this.#isOn; }

  set isOn(isOn) {
    this.#isOn = isOn;
    this.hide();
    this.onSwitch();
  }

  /** Shows the canvas: nothing is moving, or no picture will come. */
  hide() {
    this.#wanted = null;
    this.#layer.hidden = true;
  }

  /** True if a predicted frame should be left out after the hand has stopped. The camera `own` of the frame is then further from the hand's camera `rig`
   * than the camera of the picture on the screen. A frame of the hand's camera follows. isNewest: the frame belongs to the newest update. */
  overshoots({ rig: own, isAhead }, rig, isNewest) {
    const hasStopped = isNewest || performance.now() - this.#movedAt > STOPPED_MS;
    return hasStopped && isAhead && this.isVisible && this.#shown !== null && isFurther(own, this.#shown, rig);
  }

  /** A frame is about to be drawn. isSharper: it is sharper than the canvas, and shows the same view; isNewest: it shows the newest view from its own
   * camera; growth: its width in widths of the last frame, Infinity if it is final. What is on the screen fades out if the frame shows the same view.
   * Without a GPU, this takes processor time from the final frame: a moving frame of the same size replaces it at once. */
  arrive(isSharper, isNewest, growth) {
    const isByDepth = this.isVisible && this.#layer.dataset.kind === 'depth';
    if (isByDepth ? isNewest && (this.#depth.isFast || growth >= LARGER) : isSharper && !this.isVisible) this.#fade?.begin(isByDepth ? this.#depth.picture : null);
    else this.#fade?.end();
  }

  /** A new picture is on the canvas. rig: its camera, or null if it is unknown; isAhead: it was drawn for a camera that is expected. */
  drew(rig, isAhead = false) {
    this.#shown = rig;
    this.#isAhead = isAhead;
    this.#isCopied = false;
  }

  /** Shows the picture as `rig` would see it; `ahead`: updates that no picture shows yet. */
  show(rig, ahead, background) {
    if (rig !== this.#hand) [this.#hand, this.#movedAt] = [rig, performance.now()];
    const isPossible = this.#isOn && performance.now() >= this.#pausedUntil;
    const isMoved = rig && this.#shown && rig !== this.#shown; // other changes of the view are not predicted
    if (this.#isOn && isMoved && (ahead > 0 || this.#isAhead) && this.#depth?.isReady) {
      if (!this.#wanted) nextFrame(() => this.#drawByDepth());
      this.#wanted = { rig, ground: background.slice(0, 3) };
      return;
    }
    this.#wanted = null;
    this.#layer.dataset.kind = 'plane';
    const map = this.#sheet && isPossible && ahead >= AHEAD_MIN && isMoved && homography(this.#shown, rig, this.#screen.viewport);
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

  #drawByDepth() {
    if (!this.#wanted) return; // the picture came meanwhile
    const { rig, ground } = this.#wanted;
    this.#wanted = null;
    this.#layer.dataset.kind = 'depth';
    this.#layer.hidden = !this.#depth.draw(rig, ground);
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
