// SPDX-License-Identifier: Apache-2.0
// Handles in the 3-D picture: elements above it, so that the keyboard and screen readers reach them, and lines in the overlay. They follow
// the camera of the visible picture. A drag elsewhere turns the camera as usual. What they hold is in handle_shapes.js.
import { dragAlong } from '../../core/clip.js';
import { worldPerPixel } from '../../core/camera.js';
import { pointAtDepth, ray } from '../../core/project.js';
import { add, rotate, scale, subtract } from '../../core/vector.js';
import { byId, make, setText } from './dom.js';
import { place } from '../camera/pointer.js';

export const STEP = 0.01; // of an extent, per key
export const FINE = 0.1; // of a step, with Shift
export const KEYS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };

export class Handles {
  #viewer; #screen; #layer; #root; #begin; #end;
  #drag = null; // {element, at, move(at, time)}
  /** {rig, viewport} of the last drawing. */
  seen = null;

  /**
   * id, label: of their group. draw(project, shapes) puts the handles and adds lines to the list `shapes`; isShown(); leave(): what Escape
   * does; begin(), end(): of a drag or a pressed key.
   */
  constructor({ viewer, overlay, screen }, { id, label, draw, isShown, leave, begin = () => {}, end = () => {} }) {
    this.#viewer = viewer;
    this.#screen = screen;
    this.#begin = begin;
    this.#end = end;
    this.#root = make('div', { id, class: 'knobs', role: 'group', 'aria-label': label, hidden: true });
    byId('pane-3d').append(this.#root);
    this.#root.addEventListener('keydown', (event) => {
      if (event.key !== 'Escape') return;
      event.preventDefault();
      leave();
      screen.element.focus();
    });
    this.#layer = overlay.layer((project, { group, rig, width, height }) => {
      const shapes = [];
      this.#root.hidden = !isShown() || !viewer.canControl;
      this.seen = { rig, viewport: { width, height } };
      if (!this.#root.hidden) draw(project, shapes);
      group.replaceChildren(...shapes);
    });
  }

  update() { this.#layer.update(); }

  /** Makes a handle. act: {begin(from) → move(at, time), key(event) → whether it is one of its keys}. */
  make({ kind, role, sign = null, ...act }) {
    const element = make('div', { class: `knob ${kind}`, role, tabindex: 0 }, make('span', { class: 'grip' }, ...(sign ? [sign] : [])),
      make('output', { class: 'told', 'aria-hidden': 'true' }));
    element.addEventListener('pointerdown', (event) => {
      if (event.button !== 0 || !this.#viewer.isReady) return;
      event.preventDefault();
      event.stopPropagation();
      element.focus({ preventScroll: true });
      element.setPointerCapture(event.pointerId);
      const from = place(this.#screen.element, event);
      this.#begin();
      this.#drag = { element, at: from, move: act.begin(from) };
      element.toggleAttribute('data-dragged', true);
    });
    element.addEventListener('pointermove', (event) => {
      if (this.#drag?.element !== element) return;
      this.#drag.at = place(this.#screen.element, event);
      this.#drag.move(this.#drag.at, event.timeStamp);
    });
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      element.addEventListener(name, () => {
        if (this.#drag?.element !== element) return;
        this.#drag = null;
        element.toggleAttribute('data-dragged', false);
        this.#end();
        this.update();
      });
    }
    element.addEventListener('keydown', (event) => {
      if (event.altKey || event.ctrlKey || event.metaKey) return;
      if (!event.repeat) this.#begin();
      if (act.key(event)) event.preventDefault();
    });
    element.addEventListener('keyup', () => this.#end());
    this.#root.append(element);
    return element;
  }

  /** Where the pointer is that drags this handle; null if none does. */
  heldAt(element) { return this.#drag?.element === element ? this.#drag.at : null; }

  /** The move() of a drag along a line: calls then(how far, in lengths of `axis`; time). */
  along(point, axis, from, then) {
    const { rig, viewport } = this.seen;
    const start = ray(rig, from, viewport);
    return (at, time) => then(dragAlong(point, axis, start, ray(rig, at, viewport), from[1] - at[1], worldPerPixel(rig, viewport)), time);
  }

  /** The move() of a drag across the line of sight: calls then(the point moved; time). */
  across(point, from, then) {
    const { rig, viewport } = this.seen;
    const start = pointAtDepth(rig, from, viewport, point);
    return (at, time) => {
      const end = start && pointAtDepth(rig, at, viewport, point);
      if (end) then(add(point, subtract(end, start)), time);
    };
  }

  /** The world vector of a key: the arrows across the line of sight, Page up and down along it; null for other keys. `extent`: 100 steps. */
  wayOf({ key, shiftKey }, extent) {
    const way = { ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, 1, 0], ArrowDown: [0, -1, 0], PageUp: [0, 0, -1], PageDown: [0, 0, 1] }[key];
    return way ? scale(rotate(this.seen.rig.orientation, way), extent * STEP * (shiftKey ? FINE : 1)) : null;
  }

  /** Both ends of a line on the screen, cut before the eye; empty if it lies behind it. */
  segment(project, from, to) {
    let [a, b] = [project(from), project(to)];
    const near = 1e-3 * this.seen.rig.distance;
    if (this.seen.rig.projection !== 'orthographic') {
      if (a.depth < near && b.depth < near) return [];
      const cut = (near - a.depth) / (b.depth - a.depth);
      const middle = () => project(add(scale(from, 1 - cut), scale(to, cut)));
      if (a.depth < near) a = middle();
      else if (b.depth < near) b = middle();
    }
    return [a, b].every(({ x, y }) => Number.isFinite(x) && Number.isFinite(y)) ? [a, b] : [];
  }

  /** Puts a handle at a place of project(), px aside. */
  put(element, { x, y, isVisible }, [dx, dy] = [0, 0]) {
    element.hidden = !isVisible && !this.heldAt(element);
    element.style.transform = `translate(${(x + dx).toFixed(1)}px, ${(y + dy).toFixed(1)}px)`;
  }

  /** Names a handle. value: {text, ends, number} of a slider; null for others. */
  name(element, label, value = null) {
    element.setAttribute('aria-label', label);
    element.title = label;
    if (!value) return;
    element.setAttribute('aria-valuemin', Math.min(...value.ends));
    element.setAttribute('aria-valuemax', Math.max(...value.ends));
    element.setAttribute('aria-valuenow', value.number);
    element.setAttribute('aria-valuetext', value.text);
    setText(element.querySelector('.told'), value.text);
  }
}
