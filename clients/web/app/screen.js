// SPDX-License-Identifier: Apache-2.0
// The canvas: as many px as the window has (up to a limit), on which pictures of any size are drawn.

/** Longest side that is asked for, px: beyond it a picture costs more than the eye gets. */
const SIDE_MAX = 2048;
/** Pictures whose shape differs less than this from the canvas's are stretched to fill it exactly. */
const SHAPE_TOLERANCE = 0.02;
/** Of a thumbnail, px: twice what it has on the page, for screens that are that fine. */
export const THUMBNAIL = [120, 80];

export class Screen {
  #canvas; #context; #resized;
  #css = { width: 1, height: 1 };

  /** resized() is called when the wanted size has changed. */
  constructor(canvas, resized) {
    this.#canvas = canvas;
    this.#context = canvas.getContext('2d', { alpha: false });
    this.#resized = resized;
    const observer = new ResizeObserver(([entry]) => this.#measure(entry));
    observer.observe(canvas);
    this.#measure(null);
  }

  /** The canvas in CSS px, for the geometry of the input. */
  get viewport() { return this.#css; }

  /** [width, height] px of the picture that fits. */
  get size() { return [this.#canvas.width, this.#canvas.height]; }

  #measure(entry) {
    const box = this.#canvas.getBoundingClientRect();
    this.#css = { width: Math.max(1, box.width), height: Math.max(1, box.height) };
    const ratio = window.devicePixelRatio || 1;
    let full = [box.width * ratio, box.height * ratio];
    // Where the browser says how its rounding came out, take that; emulated screens say something else altogether.
    const device = entry?.devicePixelContentBoxSize?.[0];
    const exact = [device?.inlineSize, device?.blockSize];
    if (exact.every((n, i) => Math.abs(n - full[i]) <= 1)) full = exact;
    const shrink = Math.min(1, SIDE_MAX / Math.max(...full));
    const [width, height] = full.map((n) => Math.max(1, Math.round(n * shrink)));
    if (width === this.#canvas.width && height === this.#canvas.height) return;
    const old = this.#copy();
    this.#canvas.width = width;
    this.#canvas.height = height;
    if (old) this.#paint(old);
    this.#resized();
  }

  // Resizing a canvas clears it; what it showed stays until the next picture.
  #copy() {
    const { width, height } = this.#canvas;
    if (width < 2 || height < 2) return null;
    const copy = new OffscreenCanvas(width, height);
    copy.getContext('2d', { alpha: false }).drawImage(this.#canvas, 0, 0);
    return copy;
  }

  draw(picture) {
    this.#paint(picture);
  }

  /** Address of a small picture of the middle of what is shown. */
  thumbnail() {
    const [width, height] = THUMBNAIL;
    const factor = Math.max(width / this.#canvas.width, height / this.#canvas.height);
    const small = document.createElement('canvas');
    [small.width, small.height] = THUMBNAIL;
    const context = small.getContext('2d', { alpha: false });
    const [wide, high] = [this.#canvas.width * factor, this.#canvas.height * factor];
    context.imageSmoothingQuality = 'high';
    context.drawImage(this.#canvas, (width - wide) / 2, (height - high) / 2, wide, high);
    return small.toDataURL('image/jpeg', 0.8);
  }

  #paint(picture) {
    const { width, height } = this.#canvas;
    const shape = (picture.width / picture.height) / (width / height);
    this.#context.imageSmoothingQuality = 'high';
    if (Math.abs(shape - 1) < SHAPE_TOLERANCE) {
      this.#context.drawImage(picture, 0, 0, width, height);
      return;
    }
    // A picture of before the window changed: fov_y is vertical, so its height is what stays.
    const wide = height * picture.width / picture.height;
    this.#context.fillRect(0, 0, width, height);
    this.#context.drawImage(picture, (width - wide) / 2, 0, wide, height);
  }
}

/** Decodes the payload of a frame off the main thread; Promise of an ImageBitmap. */
export function decodePicture({ payload, type }) {
  return createImageBitmap(new Blob([payload], { type }));
}
