// SPDX-License-Identifier: Apache-2.0
// Sharpness arrives gradually: when a frame replaces a coarser one of the same view, or a warped picture of that view, the old picture fades out
// above the canvas. The canvas itself has the new frame at once, so whatever reads it gets that one.

const FADE_MS = 120;
const EASING = 'cubic-bezier(0.5, 1, 0.89, 1)'; // fast at first: half of the sharpness is there after 35 ms, nine tenths after 82 ms

export class Fade {
  #screen; #canvas = null; #animation = null;
  #reduced = window.matchMedia('(prefers-reduced-motion: reduce)');

  /** screen: the Screen. */
  constructor(screen) { this.#screen = screen; }

  /** True while an old frame is visible. */
  get isOn() { return this.#animation !== null; }

  /** The canvas is about to change: fades out what it shows now, or `warped`, the canvas that covers it. */
  begin(warped = null) {
    if (this.#reduced.matches || document.hidden) return;
    const part = this.#animation && !warped ? this.#animation.effect.getComputedTiming().progress ?? 1 : 1;
    this.#canvas ??= this.#make();
    this.#screen.copyTo(this.#canvas, part, warped ?? undefined); // an older frame that has not faded out yet stays as visible as it is
    this.#animation?.cancel();
    this.#screen.element.after(this.#canvas);
    const animation = this.#canvas.animate([{ opacity: 1 }, { opacity: 0 }], { duration: FADE_MS, easing: EASING, fill: 'forwards' });
    animation.onfinish = () => this.end();
    this.#animation = animation;
  }

  #make() {
    const canvas = document.createElement('canvas');
    canvas.ariaHidden = 'true';
    Object.assign(canvas.style, { position: 'absolute', inset: '0', width: '100%', height: '100%', pointerEvents: 'none' });
    return canvas;
  }

  /** Shows the canvas as it is. */
  end() {
    if (!this.#animation) return;
    this.#animation.cancel();
    this.#animation = null;
    this.#canvas.remove();
  }
}
