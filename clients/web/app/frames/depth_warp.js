// SPDX-License-Identifier: Apache-2.0
// Draws the newest frame with depth as another camera sees it, on a separate canvas: with the GPU (warp_gl.js) where there is one, else pixel
// by pixel (core/warp_pixels.js), which takes a third of the time of WebGL on a processor. Both draw on the thread of the page, in the animation
// frame that shows the picture. A worker would show it one animation frame later; at 30 degrees per second that is half a degree.
import { cameraFromRig } from '../../core/camera.js';
import { PixelWarp } from '../../core/warp_pixels.js';
import { GlWarp } from './warp_gl.js';

const LONG_MS = 12;
const SHORT_MS = 4; // the next larger size takes less than LONG_MS then
const LONG_COUNT = 8; // drawings in a row
const PARTS = [1, 0.75, 0.5]; // of the size, where drawing takes long

/** Has the same methods as GlWarp. Its canvas has the size of the frame: more px would show no more of it. */
class CanvasWarp {
  #canvas; #context;
  #warp = new PixelWarp();
  #reader = new OffscreenCanvas(1, 1).getContext('2d', { alpha: false, willReadFrequently: true });
  #image = null; // ImageData of the canvas
  #frameHeight = 0;
  #level = 0; // of PARTS
  #long = 0; // drawings in a row that took long; negative: that were short

  constructor(canvas) {
    this.#canvas = canvas;
    this.#context = canvas.getContext('2d', { alpha: false });
  }

  #read(image) {
    const { canvas } = this.#reader;
    if (canvas.width !== image.width || canvas.height !== image.height) [canvas.width, canvas.height] = [image.width, image.height];
    this.#reader.drawImage(image, 0, 0);
    return new Int32Array(this.#reader.getImageData(0, 0, image.width, image.height).data.buffer);
  }

  take(image, map, { camera, cells, near, far }) {
    const values = new Uint8Array(this.#read(map)).subarray(0, cells[0] * cells[1]); // the lowest byte of each px; the lower half is the spread
    const { width, height } = image;
    this.#warp.take({ pixels: this.#read(image), width, height, values, cells, camera, near, far, aspect: width / height });
    this.#frameHeight = height;
    return true;
  }

  draw(camera, size, ground) {
    const start = performance.now();
    const part = Math.min(1, this.#frameHeight / size[1]) * PARTS[this.#level];
    const [width, height] = size.map((side) => Math.max(1, Math.round(side * part)));
    if (this.#image?.width !== width || this.#image.height !== height) {
      this.#image = this.#context.createImageData(width, height);
      [this.#canvas.width, this.#canvas.height] = [width, height];
    }
    const [red, green, blue] = ground.map((channel) => Math.round(255 * channel));
    const px = red | (green << 8) | (blue << 16) | (255 << 24);
    if (!this.#warp.draw(camera, new Int32Array(this.#image.data.buffer), [width, height], px)) return false;
    this.#context.putImageData(this.#image, 0, 0);
    this.#adapt(performance.now() - start);
    return true;
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
  #screen; #warp;
  #hasDepth = false; // the newest frame has depth, and can be drawn
  #count = 0;

  /** canvas: an element that nothing drew on; screen: the Screen; lost(): what was drawn is gone. */
  constructor(canvas, screen, lost) {
    this.#screen = screen;
    this.#warp = GlWarp.create(canvas, () => {
      this.#hasDepth = false; // until the next frame
      lost();
    }) ?? new CanvasWarp(canvas);
  }

  /** How many drawings were made. */
  get count() { return this.#count; }

  /** Resolves to the image of the depth of a frame. Resolves to null if the frame has no depth, or if its depth cannot be decoded. */
  async decode({ depth }) {
    if (!depth?.payload) return null;
    return createImageBitmap(new Blob([depth.payload], { type: 'image/png' }), plain).catch(() => null);
  }

  /** Takes a frame that is being drawn: its image, and {depth, map}, what decode() gave. */
  take(image, { depth, map }) {
    this.#hasDepth = Boolean(map) && this.#warp.take(image, map, depth);
    map?.close();
  }

  /** Forgets the frame of a stream that ended. */
  reset() { this.#hasDepth = false; }

  /** True if the newest frame can be drawn. */
  get isReady() { return this.#hasDepth; }

  /** Draws the newest frame for a camera; ground: the background [red, green, blue], each 0 to 1. False if that is not possible. */
  draw(rig, ground) {
    if (!this.#hasDepth) return false;
    const { projection, fovY } = rig;
    const isDrawn = this.#warp.draw({ projection, fov_y: fovY, ...cameraFromRig(rig) }, this.#screen.size, ground);
    this.#count += Number(isDrawn);
    return isDrawn;
  }
}
