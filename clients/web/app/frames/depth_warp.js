// SPDX-License-Identifier: Apache-2.0
// Draws the newest frame with depth as another camera sees it, on a separate canvas: with the GPU (warp_gl.js) where there is one, else pixel
// by pixel (core/warp_pixels.js), which takes a fraction of the time of WebGL on a processor. Both draw on the thread of the page, in the animation
// frame that shows the picture. A worker would show it one animation frame later; at 30 degrees per second that is half a degree.
import { cameraFromRig } from '../../core/camera.js';
import { PixelWarp } from '../../core/warp_pixels.js';
import { GlWarp } from './warp_gl.js';

const LONG_MS = 12;
const SHORT_MS = 4; // the next larger size takes less than LONG_MS then
const LONG_COUNT = 8; // drawings in a row
const PARTS = [1, 0.75, 0.5]; // of the size, where drawing takes long

/** A copy of an image whose px can be read later, although the image is closed by then. */
class Copy {
  #context = new OffscreenCanvas(1, 1).getContext('2d', { alpha: false, willReadFrequently: true });

  take(image) {
    const { canvas } = this.#context;
    if (canvas.width !== image.width || canvas.height !== image.height) [canvas.width, canvas.height] = [image.width, image.height];
    this.#context.drawImage(image, 0, 0);
  }

  get size() { return [this.#context.canvas.width, this.#context.canvas.height]; }

  read() { return new Int32Array(this.#context.getImageData(0, 0, ...this.size).data.buffer); }
}

/** Has the same methods as GlWarp. Its canvas has the size of the frame: more px would show no more of it. */
class CanvasWarp {
  #canvas; #context;
  #warp = new PixelWarp();
  #frame = new Copy();
  #map = new Copy(); // the image of its depth
  #depth = null; // {camera, cells, near, far}
  #isRead = false; // the warp has the newest frame
  #image = null; // ImageData of the canvas
  #px = null; // its px
  #box = null; // the box of px that are not background, as PixelWarp gives it
  #ground = ''; // the background of the canvas
  #frameHeight = 0;
  #level = 0; // of PARTS
  #long = 0; // drawings in a row that took long; negative: that were short

  constructor(canvas) {
    this.#canvas = canvas;
    this.#context = canvas.getContext('2d', { alpha: false });
  }

  take(image, map, depth) {
    this.#frame.take(image);
    this.#map.take(map);
    [this.#depth, this.#frameHeight, this.#isRead] = [depth, image.height, false];
    return true;
  }

  /** Reads the px of the newest frame, when the first picture of it is drawn: a frame at rest is not read. */
  #read() {
    if (this.#isRead) return;
    const { camera, cells, near, far } = this.#depth;
    const pixels = this.#frame.read();
    const values = new Uint8Array(this.#map.read()).subarray(0, cells[0] * cells[1]); // the lowest byte of each px; the lower half is the spread
    const [width, height] = this.#frame.size;
    this.#warp.take({ pixels, width, height, values, cells, camera, near, far, aspect: width / height });
    this.#isRead = true;
  }

  draw(camera, size, ground) {
    const start = performance.now();
    this.#read();
    const part = Math.min(1, this.#frameHeight / size[1]) * PARTS[this.#level];
    const [width, height] = size.map((side) => Math.max(1, Math.round(side * part)));
    if (this.#image?.width !== width || this.#image.height !== height) {
      this.#image = this.#context.createImageData(width, height);
      this.#px = new Int32Array(this.#image.data.buffer);
      this.#box = { left: 0, top: 0, right: width, bottom: height };
      [this.#canvas.width, this.#canvas.height] = [width, height];
    }
    const [red, green, blue] = ground.map((channel) => Math.round(255 * channel));
    const px = red | (green << 8) | (blue << 16) | (255 << 24);
    const box = this.#warp.draw(camera, this.#px, [width, height], px);
    if (!box) return false;
    this.#put(box, ground);
    this.#adapt(performance.now() - start);
    return true;
  }

  /** Shows what changed. The canvas is cut to what is not background, because enlarging it takes the compositor 5 ms at 1024². */
  #put(box, ground) {
    const { width, height } = this.#image;
    const before = this.#ground === String(ground) ? this.#box : { left: 0, top: 0, right: width, bottom: height };
    const [left, top] = [Math.min(before.left, box.left), Math.min(before.top, box.top)];
    this.#context.putImageData(this.#image, 0, 0, left, top, Math.max(before.right, box.right) - left, Math.max(before.bottom, box.bottom) - top);
    [this.#box, this.#ground] = [box, String(ground)];
    const percent = [box.top / height, 1 - box.right / width, 1 - box.bottom / height, box.left / width].map((part) => `${100 * part}%`);
    this.#canvas.style.clipPath = `inset(${percent.join(' ')})`;
    this.#canvas.parentElement.style.setProperty('--ground', `rgb(${ground.map((channel) => Math.round(255 * channel)).join(' ')})`);
  }

  /** Draws fewer px after several long drawings in a row, and more after several short ones. */
  #adapt(ms) {
    this.#long = ms > LONG_MS ? Math.max(this.#long, 0) + 1 : ms < SHORT_MS ? Math.min(this.#long, 0) - 1 : 0;
    const step = this.#long >= LONG_COUNT ? 1 : this.#long <= -LONG_COUNT ? -1 : 0;
    if (step === 0 || !PARTS[this.#level + step]) return;
    this.#level += step;
    this.#long = 0;
  }
}

/** @type {ImageBitmapOptions} */
const plain = { colorSpaceConversion: 'none', premultiplyAlpha: 'none' };

export class DepthWarp {
  #screen; #canvas; #warp;
  #last = null; // arguments of the last drawing
  #hasDepth = false; // the newest frame has depth, and can be drawn
  #count = 0;

  /** canvas: an element that nothing drew on; screen: the Screen; lost(): what was drawn is gone. */
  constructor(canvas, screen, lost) {
    [this.#screen, this.#canvas] = [screen, canvas];
    this.#warp = GlWarp.create(canvas, () => {
      this.#hasDepth = false; // until the next frame
      lost();
    }) ?? new CanvasWarp(canvas);
  }

  /** How many drawings were made. */
  get count() { return this.#count; }

  /** Decodes the depth image of a frame. Resolves to null if the frame has no depth image, or if the image is broken. */
  async decode({ depth }) {
    if (!depth?.payload) return null;
    return createImageBitmap(new Blob([depth.payload], { type: 'image/png' }), plain).catch(() => null);
  }

  /** Takes a frame that is being drawn: its image, and {depth, map}, what decode() gave. */
  take(image, { depth, map }) {
    this.#hasDepth = Boolean(map) && this.#warp.take(image, map, depth);
    map?.close();
  }

  /** The canvas with the last drawing, to be read in this task: a canvas of WebGL is empty after it was shown. */
  get picture() {
    if (this.isFast) this.#warp.draw(...this.#last);
    return this.#canvas;
  }

  /** Forgets the frame of a stream that ended. */
  reset() { this.#hasDepth = false; }

  /** True if a GPU draws. */
  get isFast() { return this.#warp instanceof GlWarp; }

  /** True if the newest frame can be drawn. */
  get isReady() { return this.#hasDepth; }

  /** Draws the newest frame for a camera; ground: the background [red, green, blue], each 0 to 1. False if that is not possible. */
  draw(rig, ground) {
    if (!this.#hasDepth) return false;
    const { projection, fovY } = rig;
    this.#last = [{ projection, fov_y: fovY, ...cameraFromRig(rig) }, this.#screen.size, ground];
    const isDrawn = this.#warp.draw(...this.#last);
    this.#count += Number(isDrawn);
    return isDrawn;
  }
}
