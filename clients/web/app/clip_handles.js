// SPDX-License-Identifier: Apache-2.0
// Handles of the clip box and of the clip planes in the picture. The lines are in the overlay; the handles are elements above it, so that
// the keyboard and screen readers reach them. They follow the camera of the visible picture. A drag elsewhere turns the camera as usual.
import { boxEdges, dragAlong, dragFace, faceMiddle, section, shiftPlane, tiltPlane, positionOf, reach } from '../core/clip.js';
import { worldPerPixel } from '../core/camera.js';
import { ray } from '../core/project.js';
import { eyeOf } from '../core/movement.js';
import { add, length, rotate, scale } from '../core/vector.js';
import { t } from '../core/text.js';
import { byId, icon, make, setText, svg } from './dom.js';
import { place } from './pointer.js';

const ARROW_PX = 34;
const TILT_PX = 58; // from the middle of a plane to the handle that turns it
const STEP = 0.01; // of the extent, per key
const FINE = 0.1;
const KEY_TILT_PX = 10; // 5 degrees
const KEYS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };

export class ClipHandles {
  #viewer; #state; #screen; #layer; #root;
  #faces = []; // {axis, corner, element}
  #planes = []; // {shift, tilt}, by index
  #drag = null; // {handle, from, rig, move(at, time), offset}
  #seen = null; // {rig, viewport} of the last drawing

  /** leave(): hides the handles. */
  constructor({ viewer, overlay, screen }, state, leave) {
    this.#viewer = viewer;
    this.#state = state;
    this.#screen = screen;
    this.#root = make('div', { id: 'clip-handles', role: 'group', 'aria-label': t('clip.handles'), hidden: true });
    byId('pane-3d').append(this.#root);
    for (const axis of [0, 1, 2]) for (const corner of [0, 1]) this.#faces.push(this.#face(axis, corner));
    this.#root.addEventListener('keydown', (event) => {
      if (event.key !== 'Escape') return;
      event.preventDefault();
      leave();
      screen.element.focus();
    });
    this.#layer = overlay.layer((project, context) => this.#draw(project, context));
    state.on('change', () => this.#layer.update());
  }

  /** Makes a handle. act: {begin() → move(at, time), key(step, event)}. */
  #handle({ kind, role, sign = null, ...act }) {
    const element = make('div', { class: `clip-handle ${kind}`, role, tabindex: 0 }, make('span', { class: 'grip' }, ...(sign ? [sign] : [])),
      make('output', { class: 'told', 'aria-hidden': 'true' }));
    element.addEventListener('pointerdown', (event) => {
      if (event.button !== 0 || !this.#viewer.isReady) return;
      event.preventDefault();
      event.stopPropagation();
      element.focus({ preventScroll: true });
      element.setPointerCapture(event.pointerId);
      const from = place(this.#screen.element, event);
      this.#drag = { element, from, at: from, move: act.begin(from) };
      element.toggleAttribute('data-dragged', true);
    });
    element.addEventListener('pointermove', (event) => {
      if (this.#drag?.element !== element) return;
      this.#drag.at = place(this.#screen.element, event);
      this.#drag.move(this.#drag.at, event.timeStamp);
    });
    for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      element.addEventListener(end, () => {
        if (this.#drag?.element !== element) return;
        this.#drag = null;
        element.toggleAttribute('data-dragged', false);
        this.#layer.update();
      });
    }
    element.addEventListener('keydown', (event) => {
      if (event.altKey || event.ctrlKey || event.metaKey || !act.key(event)) return;
      event.preventDefault();
    });
    this.#root.append(element);
    return element;
  }

  /** Calls then(how far a drag moved along `axis`, in its lengths). */
  #along(point, axis, from, then) {
    const { rig, viewport } = this.#seen;
    const start = ray(rig, from, viewport);
    return (at, time) => then(dragAlong(point, axis, start, ray(rig, at, viewport), from[1] - at[1], worldPerPixel(rig, viewport)), time);
  }

  #face(axis, corner) {
    const state = this.#state;
    const element = this.#handle({
      kind: 'face', role: 'slider',
      begin: (from) => {
        const { box, volumeBox } = state;
        const start = box[corner][axis];
        return this.#along(faceMiddle(volumeBox, box, corner, axis), scale(volumeBox.half[axis], 2), from,
          (moved, time) => state.setBox(dragFace(box, corner, axis, start + moved), time));
      },
      key: (event) => {
        const isRising = state.coordinate(axis, 1) > state.coordinate(axis, 0); // keys follow the coordinate
        const ends = { Home: isRising ? 0 : 1, End: isRising ? 1 : 0 };
        if (!(event.key in KEYS) && !(event.key in ends)) return false;
        const step = (KEYS[event.key] ?? 0) * STEP * (event.shiftKey ? FINE : 1) * (isRising ? 1 : -1);
        const to = ends[event.key] ?? state.box[corner][axis] + step;
        state.setBox(dragFace(state.box, corner, axis, Number(to.toFixed(6))), event.timeStamp);
        return true;
      },
    });
    return { axis, corner, element };
  }

  #plane(index) {
    const state = this.#state;
    const current = () => state.entries[index].plane;
    const shift = this.#handle({
      kind: 'shift', role: 'slider',
      begin: (from) => {
        state.select(index);
        const plane = current();
        const normal = scale(plane.normal, 1 / length(plane.normal));
        return this.#along(state.anchor(plane, index), normal, from, (moved, time) => state.setPlane(index, this.#limit(shiftPlane(plane, moved)), time));
      },
      key: (event) => {
        if (!KEYS[event.key]) return false;
        const [low, high] = this.#range(current());
        state.select(index);
        state.setPlane(index, this.#limit(shiftPlane(current(), KEYS[event.key] * (high - low) * STEP * (event.shiftKey ? FINE : 1))), event.timeStamp);
        return true;
      },
    });
    const turn = (plane, anchor, delta, time) => state.setPlane(index, tiltPlane(plane, anchor, this.#seen.rig.orientation, delta), time);
    const tilt = this.#handle({
      kind: 'tilt', role: 'button', sign: icon('rotate-3d'),
      begin: (from) => {
        const plane = current();
        const anchor = state.anchor(plane, index);
        return (at, time) => turn(plane, anchor, [at[0] - from[0], at[1] - from[1]], time);
      },
      key: (event) => {
        const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
        if (!way) return false;
        turn(current(), state.anchor(current(), index), way.map((part) => part * KEY_TILT_PX * (event.shiftKey ? FINE * 2 : 1)), event.timeStamp);
        return true;
      },
    });
    return { shift, tilt };
  }

  /** The positions [least, greatest] at which a plane touches the volume. */
  #range({ normal }) {
    return reach(this.#state.volumeBox, scale(normal, 1 / length(normal)));
  }

  #limit(plane) {
    const [low, high] = this.#range(plane);
    const size = length(plane.normal);
    return { ...plane, offset: Math.min(high, Math.max(low, plane.offset / size)) * size };
  }

  #draw(project, { group, rig, width, height }) {
    const state = this.#state;
    const isShown = state.hasHandles && Boolean(state.volumeBox) && this.#viewer.canControl;
    this.#root.hidden = !isShown;
    if (!isShown) {
      group.replaceChildren();
      return;
    }
    this.#seen = { rig, viewport: { width, height } };
    const shapes = [];
    this.#drawBox(project, rig, shapes);
    while (this.#planes.length > state.entries.length) Object.values(this.#planes.pop()).forEach((element) => element.remove());
    while (this.#planes.length < state.entries.length) this.#planes.push(this.#plane(this.#planes.length));
    state.entries.forEach((entry, i) => this.#drawPlane(project, entry, i, shapes));
    group.replaceChildren(...shapes);
  }

  #drawBox(project, rig, shapes) {
    const { box, volumeBox } = this.#state;
    const back = rotate(rig.orientation, [0, 0, 1]);
    const eye = { position: eyeOf(rig), back, isFlat: rig.projection === 'orthographic' };
    for (const { from, to, isHidden } of boxEdges(volumeBox, box, eye)) {
      const [a, b] = this.#segment(project, from, to);
      if (a) shapes.push(svg('line', { class: 'clip-edge', 'data-hidden': isHidden, x1: a.x, y1: a.y, x2: b.x, y2: b.y }));
    }
    for (const { axis, corner, element } of this.#faces) {
      const at = project(faceMiddle(volumeBox, box, corner, axis));
      this.#put(element, at, [0, 0]);
      const names = this.#state.axisNames(axis);
      const fraction = box[corner][axis];
      const told = this.#state.withUnit(this.#state.coordinate(axis, fraction));
      this.#tell(element, t('clip.face', { end: corner === 0 ? names.low : names.high }), told,
        [0, 1].map((end) => this.#state.coordinate(axis, end)), this.#state.coordinate(axis, fraction));
    }
  }

  /** Both ends of a line on the screen, cut before the eye; empty if it lies behind it. */
  #segment(project, from, to) {
    let [a, b] = [project(from), project(to)];
    const near = 1e-3 * this.#seen.rig.distance;
    if (this.#seen.rig.projection !== 'orthographic') {
      if (a.depth < near && b.depth < near) return [];
      const cut = (near - a.depth) / (b.depth - a.depth);
      const middle = () => project(add(scale(from, 1 - cut), scale(to, cut)));
      if (a.depth < near) a = middle();
      else if (b.depth < near) b = middle();
    }
    return [a, b].every(({ x, y }) => Number.isFinite(x) && Number.isFinite(y)) ? [a, b] : [];
  }

  #drawPlane(project, { plane, isOn }, index, shapes) {
    const { shift, tilt } = this.#planes[index];
    const isSelected = index === this.#state.selected;
    const anchor = this.#state.anchor(plane, index);
    const at = project(anchor);
    const isShown = isOn && Number.isFinite(at.x);
    shift.hidden = !isShown;
    tilt.hidden = !isShown || !isSelected;
    if (!isShown) return;
    const corners = section(this.#state.volumeBox, plane).map((point) => project(point));
    if (corners.length > 0 && corners.every(({ x }) => Number.isFinite(x))) {
      shapes.push(svg('polygon', { class: 'clip-plane', 'data-selected': isSelected, points: corners.map(({ x, y }) => `${x.toFixed(1)},${y.toFixed(1)}`).join(' ') }));
    }
    const way = this.#arrow(project, anchor, at, plane, isSelected, shapes);
    this.#put(shift, at, [0, 0]);
    const held = this.#drag?.element === tilt ? [this.#drag.at[0] - at.x, this.#drag.at[1] - at.y] : null;
    const aside = way[0] < 0 ? [-way[1], way[0]] : [way[1], -way[0]];
    if (isSelected) this.#put(tilt, at, held ?? [aside[0] * TILT_PX, aside[1] * TILT_PX]);
    const [low, high] = this.#range(plane).map((value) => this.#state.round(value));
    const position = this.#state.round(positionOf(plane));
    const name = t('clip.plane', { number: index + 1 });
    this.#tell(shift, t('clip.shift', { name }), this.#state.withUnit(position), [low, high], position);
    setText(shift.querySelector('.grip'), String(index + 1));
    shift.toggleAttribute('data-selected', isSelected);
    tilt.setAttribute('aria-label', t('clip.tilt', { name }));
    tilt.title = t('clip.tilt', { name });
  }

  /** Draws the arrow towards the removed side; returns the direction of the normal on the screen. */
  #arrow(project, anchor, at, plane, isSelected, shapes) {
    const unit = scale(plane.normal, -1 / length(plane.normal));
    const reachWorld = worldPerPixel(this.#seen.rig, this.#seen.viewport);
    const tip = project(add(anchor, scale(unit, reachWorld)));
    const [dx, dy] = [tip.x - at.x, tip.y - at.y];
    const size = Math.hypot(dx, dy);
    if (!(size > 0.15)) return [0, -1];
    const way = [dx / size, dy / size];
    if (isSelected) {
      const long = 16 + ARROW_PX * Math.min(1, size);
      const end = [at.x + way[0] * long, at.y + way[1] * long];
      const wing = (turn) => `${(end[0] - way[0] * 8 + turn * way[1] * 5).toFixed(1)},${(end[1] - way[1] * 8 - turn * way[0] * 5).toFixed(1)}`;
      shapes.push(svg('line', { class: 'clip-arrow', x1: at.x, y1: at.y, x2: end[0], y2: end[1] }));
      shapes.push(svg('polyline', { class: 'clip-arrow', points: `${wing(1)} ${end[0].toFixed(1)},${end[1].toFixed(1)} ${wing(-1)}` }));
    }
    return way;
  }

  #put(element, { x, y, isVisible }, [dx, dy]) {
    element.hidden = !isVisible && this.#drag?.element !== element;
    element.style.transform = `translate(${(x + dx).toFixed(1)}px, ${(y + dy).toFixed(1)}px)`;
  }

  #tell(element, label, text, ends, value) {
    element.setAttribute('aria-label', label);
    element.title = label;
    element.setAttribute('aria-valuemin', Math.min(...ends));
    element.setAttribute('aria-valuemax', Math.max(...ends));
    element.setAttribute('aria-valuenow', value);
    element.setAttribute('aria-valuetext', text);
    setText(element.querySelector('.told'), text);
  }
}
