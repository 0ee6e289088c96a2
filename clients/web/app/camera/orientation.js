// SPDX-License-Identifier: Apache-2.0
// The orientation cube in the corner of the picture, and app.orientation for all who need directions: {frame, anatomy, glide, name(axis,
// sign), turnTo(direction, time), on('change')}. The names are anatomical where the file tells them, else x, y, z.
import { INNER, PARTS, faceMatrix, neighbour, outlines, placeOf } from '../../core/cube.js';
import { Emitter } from '../../core/emitter.js';
import { anatomyOf, frameOf, letterOf, orientationFrom } from '../../core/orientation.js';
import { t } from '../../core/text.js';
import { byId, svg } from '../controls/dom.js';
import { Glide } from './glide.js';

const SIZE = 100; // of the drawing
const HALF = 26; // half an edge of the cube in it
const AXES = ['x', 'y', 'z'];
const AXIS_LENGTH = 1.4; // half edges beyond the corner
const LABEL_MAX = SIZE / 2 - 4; // the letters stay inside of the drawing
const CLICK_PX = 4;
const DRAG_GAIN = 3; // px of a drag in the picture per px on the cube
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

const isFace = (part) => part.filter(Boolean).length === 1;

/** {letter(axis, sign): the letter of a direction along a world axis, L or +x; name(axis, sign): the same as a word}. anatomy: null = unknown. */
export function namesOf(anatomy) {
  const letter = (axis, sign) => (anatomy ? letterOf(anatomy, axis, sign) : `${sign > 0 ? '+' : '−'}${AXES[axis]}`);
  return { letter, name: (axis, sign) => (anatomy ? t(`anatomy.${letterOf(anatomy, axis, sign)}`) : letter(axis, sign)) };
}

/** Events: change (frame or names changed). */
class Orientation extends Emitter {
  #viewer;
  #key = '';

  constructor(viewer) {
    super();
    this.#viewer = viewer;
    this.glide = new Glide(viewer);
    this.anatomy = null;
    this.frame = frameOf(null);
  }

  /** Follows the volume of the view. */
  async follow() {
    const { volume, view } = this.#viewer;
    const anatomy = anatomyOf(volume);
    const key = JSON.stringify([view?.volume, anatomy]);
    if (key === this.#key || !this.#viewer.isSettled) return;
    this.#key = key;
    this.#set(anatomy, null);
    const camera = anatomy ? null : await this.#viewer.home();
    if (camera && key === this.#key) this.#set(anatomy, camera);
  }

  #set(anatomy, camera) {
    this.anatomy = anatomy;
    this.frame = frameOf(anatomy, camera);
    this.emit('change', this.frame);
  }

  /** The letter of a direction along a world axis: L, or +x. */
  letter(axis, sign) { return namesOf(this.anatomy).letter(axis, sign); }

  /** The same as a word. */
  name(axis, sign) { return namesOf(this.anatomy).name(axis, sign); }

  /** Turns the camera about its target until it looks from this direction. */
  turnTo(direction, time) {
    const { rig } = this.#viewer;
    if (rig) this.glide.to({ ...rig, orientation: orientationFrom(this.frame, direction) }, time);
  }
}

export function install(app) {
  const { viewer, overlay } = app;
  app.orientation = new Orientation(viewer);
  const cube = new Cube(app);
  viewer.on('view', () => app.orientation.follow());
  app.orientation.on('change', () => cube.name());
  overlay.layer((project, { rig }) => cube.draw(rig.orientation));
}

export class Cube {
  #viewer; #orientation; #root; #isQuiet;
  #parts = []; // {part, path}
  #texts = []; // {face, text}
  #axes = []; // {axis, line, text}
  #focused = PARTS.find(isFace);
  #drawn = null; // the orientation on the screen
  #finger = window.matchMedia('(pointer: coarse)');

  /** orientation: {anatomy, frame, letter(), name()}; isQuiet: it only shows the directions, and does not turn the camera. */
  constructor({ viewer, orientation }, { id = 'cube', pane = byId('pane-3d'), isQuiet = false } = {}) {
    this.#viewer = viewer;
    this.#orientation = orientation;
    this.#isQuiet = isQuiet;
    const use = isQuiet ? { 'aria-hidden': 'true', 'data-quiet': '' } : { role: 'group', 'aria-label': t('orientation.label') };
    this.#root = svg('svg', { id, class: 'cube', viewBox: `${-SIZE / 2} ${-SIZE / 2} ${SIZE} ${SIZE}`, hidden: '', ...use });
    const axes = svg('g', { 'aria-hidden': 'true' });
    for (const [axis, name] of AXES.entries()) {
      const line = svg('line', { class: 'axis', 'data-axis': name });
      const text = svg('text', { class: 'axis', 'data-axis': name });
      text.textContent = name;
      axes.append(line, text);
      this.#axes.push({ axis, line, text });
    }
    this.#root.append(axes);
    for (const part of PARTS) {
      const path = svg('path', isQuiet ? {} : { role: 'button', tabindex: -1 }, svg('title'));
      path.addEventListener('focus', () => this.#rove(part)); // a listener of the <svg> would make it a stop of the Tab key
      this.#parts.push({ part, path });
      this.#root.append(path);
    }
    for (const face of PARTS.filter(isFace)) {
      const text = svg('text', { class: 'face', 'aria-hidden': 'true' });
      this.#texts.push({ face, text });
      this.#root.append(text);
    }
    if (!isQuiet) {
      this.#root.addEventListener('keydown', (event) => this.#key(event));
      this.#attachPointer();
    }
    this.#finger.addEventListener('change', () => this.#redraw());
    this.name();
    pane.append(this.#root);
  }

  get root() { return this.#root; }

  #partOf(element) {
    const path = element.closest?.('path');
    return this.#parts.find((entry) => entry.path === path)?.part ?? null;
  }

  /** Writes the names of all parts. */
  name() {
    const { anatomy } = this.#orientation;
    for (const { part, path } of this.#parts) {
      const names = [2, 1, 0].filter((axis) => part[axis]).map((axis) => this.#orientation.name(axis, part[axis]));
      const label = t('orientation.part', { names: names.join(', ') });
      path.setAttribute('aria-label', label);
      path.firstChild.textContent = label;
    }
    for (const { face, text } of this.#texts) {
      const axis = face.findIndex(Boolean);
      text.textContent = this.#orientation.letter(axis, face[axis]);
      text.toggleAttribute('data-small', !anatomy);
    }
    this.#redraw();
  }

  /** For a finger, edges and corners are too small. */
  get #inner() { return this.#finger.matches ? 1 : INNER; }

  #redraw() {
    const { orientation } = this.#viewer;
    this.#drawn = null;
    if (orientation) this.draw(orientation);
  }

  draw(orientation) {
    if (this.#drawn === orientation) return;
    this.#drawn = orientation;
    this.#root.removeAttribute('hidden'); // there is a picture
    const at = ([x, y]) => `${(x * HALF).toFixed(2)} ${(y * HALF).toFixed(2)}`;
    for (const { part, path } of this.#parts) {
      const shapes = outlines(part, orientation, this.#inner);
      path.toggleAttribute('hidden', shapes.length === 0);
      path.setAttribute('d', shapes.map((points) => `M${points.map(at).join('L')}Z`).join(''));
    }
    for (const { face, text } of this.#texts) {
      const matrix = faceMatrix(face, orientation, this.#orientation.frame);
      text.toggleAttribute('hidden', !matrix);
      if (matrix) text.setAttribute('transform', `matrix(${matrix.map((n, i) => (i < 4 ? n : n * HALF).toFixed(3)).join(' ')})`);
    }
    for (const { axis, line, text } of this.#axes) this.#drawAxis(axis, line, text, orientation);
    this.#rove(outlines(this.#focused, orientation, this.#inner).length ? this.#focused
      : this.#parts.find(({ part, path }) => isFace(part) && !path.hasAttribute('hidden')).part);
  }

  /** From the corner of the three negative faces, so that the axes lie along edges of the cube. */
  #drawAxis(axis, line, text, orientation) {
    const end = [-1, -1, -1];
    end[axis] = AXIS_LENGTH;
    const [from, to] = [[-1, -1, -1], end].map((point) => placeOf(point, orientation).map((n) => n * HALF));
    for (const [name, value] of Object.entries({ x1: from[0], y1: from[1], x2: to[0], y2: to[1] })) line.setAttribute(name, value.toFixed(2));
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const beyond = length > 6 ? 8 / length : 0;
    for (const [i, name] of ['x', 'y'].entries()) {
      const place = to[i] + (to[i] - from[i]) * beyond;
      text.setAttribute(name, Math.min(Math.max(place, -LABEL_MAX), LABEL_MAX).toFixed(2));
    }
    text.toggleAttribute('hidden', length <= 6);
  }

  #rove(part) {
    if (!part || this.#isQuiet) return;
    this.#focused = part;
    const hadFocus = this.#root.contains(document.activeElement);
    for (const entry of this.#parts) {
      entry.path.setAttribute('tabindex', entry.part === part ? 0 : -1);
      if (hadFocus && entry.part === part && document.activeElement !== entry.path) entry.path.focus({ preventScroll: true });
    }
  }

  #key(event) {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    const way = WAYS[event.key];
    if (way) {
      const next = neighbour(this.#focused, way, this.#drawn, this.#inner);
      this.#rove(this.#parts.find(({ part }) => String(part) === String(next)).part);
    } else if (event.key === 'Enter' || event.key === ' ') {
      this.#orientation.turnTo(this.#focused, event.timeStamp);
    } else {
      return;
    }
    event.preventDefault();
  }

  /** A click turns to the part; a drag turns freely. */
  #attachPointer() {
    let start = null;
    this.#root.addEventListener('pointerdown', (event) => {
      const part = this.#partOf(event.target);
      if (!part || event.button !== 0) return;
      this.#root.setPointerCapture(event.pointerId);
      start = { part, x: event.clientX, y: event.clientY, orientation: this.#viewer.orientation, isDrag: false };
      event.preventDefault();
    });
    this.#root.addEventListener('pointermove', (event) => {
      if (!start?.orientation) return;
      const [dx, dy] = [event.clientX - start.x, event.clientY - start.y];
      start.isDrag ||= Math.hypot(dx, dy) > CLICK_PX;
      if (!start.isDrag) return;
      const { width, height } = this.#viewer.viewport;
      const middle = [width / 2, height / 2];
      this.#viewer.turn(start.orientation, middle, [middle[0] + dx * DRAG_GAIN, middle[1] + dy * DRAG_GAIN], event.timeStamp);
    });
    this.#root.addEventListener('pointerup', (event) => {
      if (start && !start.isDrag) this.#orientation.turnTo(start.part, event.timeStamp);
      start = null;
    });
    for (const name of ['pointercancel', 'lostpointercapture']) this.#root.addEventListener(name, () => { start = null; });
  }
}
