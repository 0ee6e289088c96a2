// SPDX-License-Identifier: Apache-2.0
// What handles in the picture hold: boxes, planes and spheres, of the clip and of edits. Each draws its outline and puts its handles.
// `clip` is ClipState, which knows the volume, its names and its units.
import { boxEdges, boxMiddle, dragFace, faceMiddle, moveBox, positionOf, reach, section, shiftPlane, tiltPlane } from '../../core/clip.js';
import { worldPerPixel } from '../../core/camera.js';
import { pointAtDepth } from '../../core/project.js';
import { eyeOf } from '../../core/movement.js';
import { add, length, rotate, scale, subtract } from '../../core/vector.js';
import { t } from '../../core/text.js';
import { icon, setText, svg } from './dom.js';
import { FINE, KEYS, STEP } from './handles.js';

const ARROW_PX = 34;
const TILT_PX = 58; // from the middle of a plane to the handle that turns it
const KEY_TILT_PX = 10; // 5 degrees
const RADIUS_MIN = 0.002; // of the extent
const CIRCLE_STEPS = 64;

const pointsOf = (places) => places.map(({ x, y }) => `${x.toFixed(1)},${y.toFixed(1)}`).join(' ');

/** Handles on the faces of a box. held: {box (in fractions of the volume), setBox(box, time)}; `middle` names a handle that moves it as a whole. */
export class BoxHandles {
  #handles; #clip; #held; #middle;
  #faces = []; // {axis, corner, element}

  constructor(handles, clip, held, middle = null) {
    this.#handles = handles;
    this.#clip = clip;
    this.#held = held;
    for (const axis of [0, 1, 2]) for (const corner of [0, 1]) this.#faces.push(this.#face(axis, corner));
    this.#middle = middle && { name: middle, element: this.#center() };
  }

  get elements() { return [...this.#faces, ...(this.#middle ? [this.#middle] : [])].map(({ element }) => element); }

  #face(axis, corner) {
    const [clip, held] = [this.#clip, this.#held];
    const element = this.#handles.make({
      kind: 'face', role: 'slider',
      begin: (from) => {
        const { box } = held;
        const start = box[corner][axis];
        return this.#handles.along(faceMiddle(clip.volumeBox, box, corner, axis), scale(clip.volumeBox.half[axis], 2), from,
          (moved, time) => held.setBox(dragFace(box, corner, axis, start + moved), time));
      },
      key: (event) => {
        const isRising = clip.coordinate(axis, 1) > clip.coordinate(axis, 0); // keys follow the coordinate
        const ends = { Home: isRising ? 0 : 1, End: isRising ? 1 : 0 };
        if (!(event.key in KEYS) && !(event.key in ends)) return false;
        const step = (KEYS[event.key] ?? 0) * STEP * (event.shiftKey ? FINE : 1) * (isRising ? 1 : -1);
        const to = ends[event.key] ?? held.box[corner][axis] + step;
        held.setBox(dragFace(held.box, corner, axis, Number(to.toFixed(6))), event.timeStamp);
        return true;
      },
    });
    return { axis, corner, element };
  }

  #center() {
    const [clip, held] = [this.#clip, this.#held];
    return this.#handles.make({
      kind: 'center', role: 'button', sign: icon('move'),
      begin: (from) => {
        const { box } = held;
        const middle = boxMiddle(clip.volumeBox, box);
        return this.#handles.across(middle, from, (to, time) => held.setBox(moveBox(clip.volumeBox, box, subtract(to, middle)), time));
      },
      key: (event) => {
        const way = this.#handles.wayOf(event, clip.extent);
        if (way) held.setBox(moveBox(clip.volumeBox, held.box, way), event.timeStamp);
        return Boolean(way);
      },
    });
  }

  draw(project, shapes) {
    const { box } = this.#held;
    const [clip, { rig }] = [this.#clip, this.#handles.seen];
    const back = rotate(rig.orientation, [0, 0, 1]);
    const eye = { position: eyeOf(rig), back, isFlat: rig.projection === 'orthographic' };
    for (const { from, to, isHidden } of boxEdges(clip.volumeBox, box, eye)) {
      const [a, b] = this.#handles.segment(project, from, to);
      if (a) shapes.push(svg('line', { class: 'handle-edge', 'data-hidden': isHidden, x1: a.x, y1: a.y, x2: b.x, y2: b.y }));
    }
    for (const { axis, corner, element } of this.#faces) {
      this.#handles.put(element, project(faceMiddle(clip.volumeBox, box, corner, axis)));
      const names = clip.axisNames(axis);
      const number = clip.coordinate(axis, box[corner][axis]);
      this.#handles.name(element, t('clip.face', { end: corner === 0 ? names.low : names.high }),
        { text: clip.withUnit(number, axis), ends: [0, 1].map((end) => clip.coordinate(axis, end)), number });
    }
    if (!this.#middle) return;
    this.#handles.put(this.#middle.element, project(boxMiddle(clip.volumeBox, box)));
    this.#handles.name(this.#middle.element, this.#middle.name());
  }
}

/** Handles that shift and turn a plane. held: {plane, setPlane(plane, time), index, select()}. */
export class PlaneHandles {
  #handles; #clip; #held; #shift; #tilt;

  constructor(handles, clip, held) {
    this.#handles = handles;
    this.#clip = clip;
    this.#held = held;
    this.#shift = handles.make({
      kind: 'shift', role: 'slider',
      begin: (from) => {
        held.select();
        const { plane } = held;
        const normal = scale(plane.normal, 1 / length(plane.normal));
        return handles.along(this.#anchor, normal, from, (moved, time) => held.setPlane(this.#limit(shiftPlane(plane, moved)), time));
      },
      key: ({ key, shiftKey, timeStamp }) => {
        if (!KEYS[key]) return false;
        const [low, high] = this.#range(held.plane);
        held.select();
        held.setPlane(this.#limit(shiftPlane(held.plane, KEYS[key] * (high - low) * STEP * (shiftKey ? FINE : 1))), timeStamp);
        return true;
      },
    });
    const turn = (plane, anchor, delta, time) => held.setPlane(tiltPlane(plane, anchor, handles.seen.rig.orientation, delta), time);
    this.#tilt = handles.make({
      kind: 'tilt', role: 'button', sign: icon('rotate-3d'),
      begin: (from) => {
        const { plane } = held;
        const anchor = this.#anchor;
        return (at, time) => turn(plane, anchor, [at[0] - from[0], at[1] - from[1]], time);
      },
      key: ({ key, shiftKey, timeStamp }) => {
        const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
        if (way) turn(held.plane, this.#anchor, way.map((part) => part * KEY_TILT_PX * (shiftKey ? FINE * 2 : 1)), timeStamp);
        return Boolean(way);
      },
    });
  }

  get elements() { return [this.#shift, this.#tilt]; }
  get #anchor() { return this.#clip.anchor(this.#held.plane, this.#held.index); }

  /** The positions [least, greatest] at which a plane touches the volume. */
  #range({ normal }) {
    return reach(this.#clip.volumeBox, scale(normal, 1 / length(normal)));
  }

  #limit(plane) {
    const [low, high] = this.#range(plane);
    const size = length(plane.normal);
    return { ...plane, offset: Math.min(high, Math.max(low, plane.offset / size)) * size };
  }

  draw(project, shapes, { name, isSelected = true, isOn = true }) {
    const [handles, clip, { plane, index }] = [this.#handles, this.#clip, this.#held];
    const [shift, tilt] = this.elements;
    const anchor = this.#anchor;
    const at = project(anchor);
    const isShown = isOn && Number.isFinite(at.x);
    shift.hidden = !isShown;
    tilt.hidden = !isShown || !isSelected;
    if (!isShown) return;
    const corners = section(clip.volumeBox, plane).map((point) => project(point));
    if (corners.length > 0 && corners.every(({ x }) => Number.isFinite(x))) {
      shapes.push(svg('polygon', { class: 'handle-plane', 'data-selected': isSelected, points: pointsOf(corners) }));
    }
    const way = this.#arrow(project, anchor, at, isSelected, shapes);
    handles.put(shift, at);
    const held = handles.heldAt(tilt);
    const aside = way[0] < 0 ? [-way[1], way[0]] : [way[1], -way[0]];
    if (isSelected) handles.put(tilt, at, held ? [held[0] - at.x, held[1] - at.y] : [aside[0] * TILT_PX, aside[1] * TILT_PX]);
    const along = (distance) => clip.positionAlong(plane.normal, distance).value;
    handles.name(shift, t('clip.shift', { name }), { text: clip.positionText(plane.normal, positionOf(plane)), ends: this.#range(plane).map(along), number: along(positionOf(plane)) });
    setText(shift.querySelector('.grip'), String(index + 1));
    shift.toggleAttribute('data-selected', isSelected);
    handles.name(tilt, t('clip.tilt', { name }));
  }

  /** Draws the arrow towards the removed side; returns the direction of the normal on the screen. */
  #arrow(project, anchor, at, isSelected, shapes) {
    const { normal } = this.#held.plane;
    const { rig, viewport } = this.#handles.seen;
    const tip = project(add(anchor, scale(normal, -worldPerPixel(rig, viewport) / length(normal))));
    const [dx, dy] = [tip.x - at.x, tip.y - at.y];
    const size = Math.hypot(dx, dy);
    if (!(size > 0.15)) return [0, -1];
    const way = [dx / size, dy / size];
    if (isSelected) {
      const long = 16 + ARROW_PX * Math.min(1, size);
      const end = [at.x + way[0] * long, at.y + way[1] * long];
      const wing = (turn) => `${(end[0] - way[0] * 8 + turn * way[1] * 5).toFixed(1)},${(end[1] - way[1] * 8 - turn * way[0] * 5).toFixed(1)}`;
      shapes.push(svg('line', { class: 'handle-arrow', x1: at.x, y1: at.y, x2: end[0], y2: end[1] }));
      shapes.push(svg('polyline', { class: 'handle-arrow', points: `${wing(1)} ${end[0].toFixed(1)},${end[1].toFixed(1)} ${wing(-1)}` }));
    }
    return way;
  }
}

/** Handles of a sphere: its centre, and its radius at the right. held: {center, radius, set({center} or {radius}, time)}. */
export class SphereHandles {
  #handles; #clip; #held; #center; #edge;

  constructor(handles, clip, held) {
    this.#handles = handles;
    this.#clip = clip;
    this.#held = held;
    this.#center = handles.make({
      kind: 'center', role: 'button', sign: icon('move'),
      begin: (from) => handles.across(held.center, from, (center, time) => held.set({ center }, time)),
      key: (event) => {
        const way = handles.wayOf(event, clip.extent);
        if (way) held.set({ center: add(held.center, way) }, event.timeStamp);
        return Boolean(way);
      },
    });
    const set = (radius, time) => held.set({ radius: Math.max(RADIUS_MIN * clip.extent, radius) }, time);
    this.#edge = handles.make({
      kind: 'face', role: 'slider',
      begin: (from) => {
        const { rig, viewport } = handles.seen;
        const away = (at) => {
          const point = pointAtDepth(rig, at, viewport, held.center);
          return point && length(subtract(point, held.center));
        };
        const [start, radius] = [away(from), held.radius];
        return (at, time) => {
          const end = away(at);
          if (start !== null && end !== null) set(radius + end - start, time);
        };
      },
      key: ({ key, shiftKey, timeStamp }) => {
        if (KEYS[key]) set(held.radius + KEYS[key] * clip.extent * STEP * (shiftKey ? FINE : 1), timeStamp);
        return key in KEYS;
      },
    });
  }

  get elements() { return [this.#center, this.#edge]; }

  draw(project, shapes, { name }) {
    const [handles, clip, { center, radius }] = [this.#handles, this.#clip, this.#held];
    const [right, up] = [[1, 0, 0], [0, 1, 0]].map((axis) => scale(rotate(handles.seen.rig.orientation, axis), radius));
    const circle = Array.from({ length: CIRCLE_STEPS }, (_, i) => {
      const angle = 2 * Math.PI * i / CIRCLE_STEPS;
      return project(add(center, add(scale(right, Math.cos(angle)), scale(up, Math.sin(angle)))));
    });
    if (circle.every(({ x }) => Number.isFinite(x))) shapes.push(svg('polygon', { class: 'handle-edge', points: pointsOf(circle) }));
    handles.put(this.#center, project(center));
    handles.name(this.#center, t('edits.move', { name }));
    handles.put(this.#edge, project(add(center, right)));
    const number = clip.round(radius);
    handles.name(this.#edge, t('edits.resize', { name }), { text: clip.withUnit(number), ends: [0, clip.round(clip.extent)], number });
  }
}
