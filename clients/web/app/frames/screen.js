// SPDX-License-Identifier: Apache-2.0
// The canvas: it has as many px as the window, up to a limit, and draws frames of any size.

/** The longest side of a requested frame in px. Larger frames cost more than the eye can see. */
const SIDE_MAX = 2048;
/** Frames whose aspect ratio differs less than this from the canvas are stretched to fill it. */
const SHAPE_TOLERANCE = 0.02;
/** Size of a thumbnail in px: twice its size on the page, for screens with high resolution. */
export const THUMBNAIL = [120, 80];

export class Screen {
  #canvas; #context; #observer;
  #resized = new Set();
  #css = { width: 1, height: 1 };
  #pixels = [1, 1];

  constructor(canvas) {
    this.#canvas = canvas;
    this.#context = canvas.getContext('2d', { alpha: false });
    this.#observer = new ResizeObserver(([entry]) => this.#measure(entry));
    this.#observer.observe(canvas);
    this.#measure(null);
  }

  /** Ends the measuring; the canvas does not change. */
  destroy() {
    this.#observer.disconnect();
  }

  /** The canvas; it gets the pointer and the focus. */
  get element() { return this.#canvas; }

  /** Calls told() when the wanted size changes. */
  onResize(told) { this.#resized.add(told); }

  /** The size of the canvas in CSS px, for input geometry. */
  get viewport() { return this.#css; }

  /** [width, height] of the canvas in px of the screen. */
  get pixels() { return this.#pixels; }

  /** [width, height] in px of the frame that fits. */
  get size() { return [this.#canvas.width, this.#canvas.height]; }

  /** What `pick` asks at a place of the canvas in CSS px; for places beside the canvas the nearest one. It names its size, because the daemon
      learns a new one later. */
  pickAt(place) {
    const { size } = this;
    const { width, height } = this.#css;
    return { at: [width, height].map((side, i) => Math.min(Math.max(place[i] / side, 0), 1) * size[i]), size };
  }

  #measure(entry) {
    const box = this.#canvas.getBoundingClientRect();
    if (entry && (box.width < 1 || box.height < 1)) return; // the layout hides the picture; it keeps its size
    this.#css = { width: Math.max(1, box.width), height: Math.max(1, box.height) };
    const ratio = window.devicePixelRatio || 1;
    let full = [box.width * ratio, box.height * ratio];
    // Uses the browser's exact device pixels if they are plausible; emulated screens report wrong values.
    const device = entry?.devicePixelContentBoxSize?.[0];
    const exact = [device?.inlineSize, device?.blockSize];
    if (exact.every((n, i) => Math.abs(n - full[i]) <= 1)) full = exact;
    this.#pixels = full.map((n) => Math.max(1, Math.round(n)));
    const shrink = Math.min(1, SIDE_MAX / Math.max(...full));
    const [width, height] = full.map((n) => Math.max(1, Math.round(n * shrink)));
    if (width === this.#canvas.width && height === this.#canvas.height) return;
    const old = this.#copy();
    this.#canvas.width = width;
    this.#canvas.height = height;
    if (old) this.#paint(old);
    for (const told of this.#resized) told();
  }

  // Resizing a canvas clears it, so the old content is drawn again until the next frame.
  #copy() {
    const { width, height } = this.#canvas;
    if (width < 2 || height < 2) return null;
    const copy = new OffscreenCanvas(width, height);
    copy.getContext('2d', { alpha: false }).drawImage(this.#canvas, 0, 0);
    return copy;
  }

  /** isMoving: the next picture follows soon. Enlarging with the best filter takes the page 10 ms where no GPU draws. */
  draw(image, { isMoving = false } = {}) {
    this.#paint(image, isMoving ? 'low' : 'high');
  }

  /** Copies the content, or what another canvas shows in its place, into a canvas, which gets the same size; `part` of 1 over what is there. */
  copyTo(canvas, part = 1, source = this.#canvas) {
    const { width, height } = this.#canvas;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const context = canvas.getContext('2d', { alpha: false });
    context.globalAlpha = part;
    context.drawImage(source, 0, 0, width, height);
  }

  /** The address of a thumbnail of the centre of the canvas. */
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

  #paint(image, quality = 'high') {
    const { width, height } = this.#canvas;
    const shape = (image.width / image.height) / (width / height);
    this.#context.imageSmoothingQuality = quality;
    if (Math.abs(shape - 1) < SHAPE_TOLERANCE) {
      this.#context.drawImage(image, 0, 0, width, height);
      return;
    }
    // A frame from before a resize keeps its height, because fov_y is vertical.
    const wide = height * image.width / image.height;
    this.#context.fillRect(0, 0, width, height);
    this.#context.drawImage(image, (width - wide) / 2, 0, wide, height);
  }
}
