// SPDX-License-Identifier: Apache-2.0
// A plot with points that move by mouse, touch, pen and keyboard. Each point is a slider for screen readers.
import { setAttribute } from './dom.js';

const CLICK_PX = 4;
const KEY_STEP = 0.01; // of the visible range
const KEY_FINE = 0.1; // with Shift, of a step

const hold = (x, low, high) => Math.min(high, Math.max(low, x));

export class Plot {
  #root; #canvas; #handles; #acts;
  #shown = null;
  #size = [0, 0]; // of the canvas, in CSS px
  #drag = null;

  /**
   * acts: begin() starts a gesture, select(index), move(index, {x, y}, time), add({x, y}, time) → index or −1, remove(index, time), end() of a
   * gesture, zoom(factor, share of the width).
   */
  constructor(root, acts) {
    this.#root = root;
    this.#canvas = root.querySelector('canvas');
    this.#handles = root.querySelector('.handles');
    this.#acts = acts;
    root.addEventListener('pointerdown', (event) => this.#press(event));
    root.addEventListener('pointermove', (event) => this.#pull(event));
    root.addEventListener('pointerup', (event) => this.#release(event));
    root.addEventListener('pointercancel', (event) => this.#release(event, true));
    root.addEventListener('contextmenu', (event) => {
      event.preventDefault();
      const index = this.#indexAt(event);
      if (index >= 0 && this.#shown.isEditable && event.pointerType !== 'touch') acts.remove(index, event.timeStamp);
    });
    root.addEventListener('wheel', (event) => {
      if (!event.ctrlKey && !event.shiftKey) return;
      event.preventDefault();
      acts.zoom(Math.exp((event.deltaY || event.deltaX) * 0.003), this.#share(event.clientX));
    }, { passive: false });
    root.addEventListener('keydown', (event) => this.#key(event));
    root.addEventListener('focusin', ({ target }) => {
      const index = this.#indexOf(target);
      if (index >= 0 && index !== this.#shown.selected) acts.select(index);
    });
    new ResizeObserver(([{ contentRect: { width, height } }]) => {
      this.#size = [width, height];
      this.#paint();
    }).observe(root);
  }

  #indexOf(target) {
    const handle = target.closest?.('.handle');
    return handle ? [...this.#handles.children].indexOf(handle) : -1;
  }

  /** The nearest point of those whose areas for a finger, which overlap, are below the pointer; -1 = none. */
  #indexAt({ target, clientX, clientY }) {
    if (this.#indexOf(target) < 0) return -1;
    const away = [...this.#handles.children].map((handle) => {
      const { left, top, width, height } = handle.getBoundingClientRect();
      return handle.hidden ? Infinity : Math.hypot(left + width / 2 - clientX, top + height / 2 - clientY);
    });
    return away.indexOf(Math.min(...away));
  }

  #share(clientX) {
    const box = this.#root.getBoundingClientRect();
    return hold((clientX - box.left) / box.width, 0, 1);
  }

  /** Coordinates of a point of the screen, not limited to the plot. */
  #at(clientX, clientY) {
    const box = this.#root.getBoundingClientRect();
    const { xs: [low, high], top } = this.#shown;
    return { x: low + (high - low) * (clientX - box.left) / box.width, y: top * (1 - (clientY - box.top) / box.height) };
  }

  #press(event) {
    if (!this.#shown?.isEditable || event.button !== 0 || this.#drag) return;
    const index = this.#indexAt(event);
    const at = this.#at(event.clientX, event.clientY);
    if (index >= 0) {
      const { x, y } = this.#shown.points[index];
      this.#acts.begin();
      this.#begin(event, index, { x: x - at.x, y: Math.min(y, this.#shown.top) - at.y });
    } else if (event.pointerType === 'touch') {
      this.#drag = { id: event.pointerId, index: -1, from: [event.clientX, event.clientY] }; // a tap adds; a swipe scrolls
    } else {
      this.#acts.begin();
      const made = this.#acts.add(at, event.timeStamp);
      if (made >= 0) this.#begin(event, made, { x: 0, y: 0 });
    }
  }

  #begin(event, index, offset) {
    event.preventDefault();
    this.#root.setPointerCapture(event.pointerId);
    this.#drag = { id: event.pointerId, index, offset, from: [event.clientX, event.clientY], isMoved: false };
    this.#acts.select(index);
    this.focus(index);
  }

  #pull(event) {
    const drag = this.#drag;
    if (drag?.id !== event.pointerId || drag.index < 0) return;
    if (!drag.isMoved) {
      if (Math.hypot(event.clientX - drag.from[0], event.clientY - drag.from[1]) < CLICK_PX) return;
      drag.isMoved = true;
    }
    const at = this.#at(event.clientX, event.clientY);
    this.#acts.move(drag.index, { x: at.x + drag.offset.x, y: hold(at.y + drag.offset.y, 0, this.#shown.top) }, event.timeStamp);
  }

  #release(event, isCancelled = false) {
    const drag = this.#drag;
    if (drag?.id !== event.pointerId) return;
    this.#drag = null;
    if (drag.index < 0) {
      const isTap = Math.hypot(event.clientX - drag.from[0], event.clientY - drag.from[1]) < 2 * CLICK_PX;
      if (isCancelled || !isTap) return;
      this.#acts.begin();
      const made = this.#acts.add(this.#at(event.clientX, event.clientY), event.timeStamp);
      if (made >= 0) this.#acts.select(made);
    }
    this.#acts.end();
  }

  #key(event) {
    const index = this.#indexOf(event.target);
    if (index < 0 || !this.#shown.isEditable || event.ctrlKey || event.altKey || event.metaKey) return;
    const { xs, top, points } = this.#shown;
    const step = KEY_STEP * (event.shiftKey ? KEY_FINE : 1);
    const steps = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step], PageUp: [0, 10 * step], PageDown: [0, -10 * step] };
    if (steps[event.key]) {
      const [dx, dy] = steps[event.key];
      const { x, y } = points[index];
      if (!event.repeat) this.#acts.begin();
      this.#acts.move(index, { x: x + dx * (xs[1] - xs[0]), y: y + dy * top }, event.timeStamp);
    } else if (event.key === 'Delete' || event.key === 'Backspace') {
      this.#acts.remove(index, event.timeStamp);
    } else {
      return;
    }
    event.preventDefault();
  }

  focus(index) {
    this.#handles.children[index]?.focus({ preventScroll: true });
  }

  /**
   * points: [{x, y, color, text}]; xs: the visible [low, high]; top: the largest visible y; paint(context, width, height) draws below
   * the handles, in CSS px; name(index) is the name of a point.
   */
  show(shown) {
    this.#shown = shown;
    const { points, selected, xs: [low, high], top, isEditable, name } = shown;
    while (this.#handles.children.length > points.length) this.#handles.lastChild.remove();
    while (this.#handles.children.length < points.length) {
      const handle = document.createElement('button');
      handle.type = 'button';
      handle.className = 'handle';
      handle.setAttribute('role', 'slider');
      this.#handles.append(handle);
    }
    points.forEach(({ x, y, color, text }, i) => {
      const handle = this.#handles.children[i];
      handle.style.left = `${100 * ((x - low) / (high - low))}%`;
      handle.style.top = `${100 * (1 - Math.min(1, y / top))}%`;
      handle.style.backgroundColor = color;
      handle.hidden = x < low || x > high;
      handle.toggleAttribute('data-above', y > top * 1.0001);
      handle.toggleAttribute('data-selected', i === selected);
      setAttribute(handle, 'aria-label', name(i));
      setAttribute(handle, 'aria-valuemin', low);
      setAttribute(handle, 'aria-valuemax', high);
      setAttribute(handle, 'aria-valuenow', x);
      setAttribute(handle, 'aria-valuetext', text);
      setAttribute(handle, 'aria-disabled', String(!isEditable));
    });
    this.#root.toggleAttribute('data-locked', !isEditable);
    this.#paint();
  }

  #paint() {
    const [width, height] = this.#size;
    if (!this.#shown || width < 2) return;
    const ratio = window.devicePixelRatio || 1;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.#canvas.width !== size[0] || this.#canvas.height !== size[1]) [this.#canvas.width, this.#canvas.height] = size;
    const context = this.#canvas.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    this.#shown.paint(context, width, height);
  }
}
