// SPDX-License-Identifier: Apache-2.0
// Moves the camera to another place within a quarter of a second. The user's next movement ends the motion.
// The camera jumps if the user prefers reduced motion, or if the projection changes.
import { between } from '../../core/movement.js';
import { nextFrame } from '../frames/animation.js';

const GLIDE_MS = 250;

export class Glide {
  #viewer;
  #mine = null; // the rig that the glide set last; null at rest
  #reduced = window.matchMedia('(prefers-reduced-motion: reduce)');

  constructor(viewer) {
    this.#viewer = viewer;
  }

  get isMoving() { return this.#mine !== null && this.#viewer.rig === this.#mine; }

  /** Goes to `rig` and ends exactly there. */
  to(rig, time) {
    if (!this.#viewer.mayChange()) return;
    const from = this.#viewer.rig;
    if (this.#reduced.matches || rig.projection !== from.projection) {
      this.#mine = null;
      this.#viewer.place(rig, time);
      return;
    }
    const begin = performance.now();
    const steps = { mine: from };
    const step = () => {
      if (this.#viewer.rig !== steps.mine) return;
      const u = Math.min(1, (performance.now() - begin) / GLIDE_MS);
      this.#viewer.place(between(from, rig, u), performance.now());
      steps.mine = this.#viewer.rig;
      this.#mine = u < 1 ? steps.mine : null;
      if (u < 1) nextFrame(step);
    };
    this.#mine = from;
    nextFrame(step);
  }
}
