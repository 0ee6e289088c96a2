// SPDX-License-Identifier: Apache-2.0
// Measurements: the list of a session, undo, and where lines, handles and labels lie. A measurement is the answer to measure.put
// (protocol/stream.md); points are world positions. A plane is {origin, right, down, normal} (slices.js).
import { unitName, valueUnit } from './lengths.js';
import { add, cross, dot, length, normalize, scale, subtract } from './vector.js';

/** Points of each kind; hasPlane: it lies in a slice; hasRange: it needs a range of values, and the daemon takes time to measure it. */
export const KINDS = Object.freeze({
  distance: { points: 2 }, angle: { points: 3 }, profile: { points: 2 }, rectangle: { points: 3, hasPlane: true },
  ellipse: { points: 3, hasPlane: true }, marker: { points: 1 },
  part: { points: 1, hasRange: true }, path: { points: 2, hasRange: true },
});
const ELLIPSE_STEPS = 64;
const ARC_STEPS = 16;
const UNDO_MAX = 100;

/** The measurements of a session in the order in which they were made, of all volumes. */
export class MeasureList {
  #items = new Map();

  clear() { this.#items.clear(); }
  get(id) { return this.#items.get(id) ?? null; }
  put(item) { this.#items.set(item.id, item); }
  remove(id) { this.#items.delete(id); }
  get all() { return [...this.#items.values()]; }
  of(volume) { return this.all.filter((item) => item.volume === volume); }

  /** Takes a notification session.measures. isBusy(id): this client changes the item now, so its own state is newer. */
  take({ ids, changed }, isBusy = (/** @type {number} */ _id) => false) {
    const next = new Map(changed.map((item) => [item.id, item]));
    const kept = new Map([...ids, ...this.#items.keys()].map((id) => {
      const known = this.#items.get(id);
      const isOurs = known && isBusy(id);
      if (!ids.includes(id) && !isOurs) return [id, null];
      return [id, isOurs ? known : next.get(id) ?? known ?? null];
    }));
    this.#items = new Map([...kept].filter(([, item]) => item));
  }
}

/** Undo and redo of changes: each is {id, before, after}, where null is "does not exist". */
export class Changes {
  #done = [];
  #undone = [];
  get canUndo() { return this.#done.length > 0; }
  get canRedo() { return this.#undone.length > 0; }

  clear() {
    this.#done = [];
    this.#undone = [];
  }

  put(change) {
    this.#done = [...this.#done, change].slice(-UNDO_MAX);
    this.#undone = [];
  }

  /** The state to return to, {id, item}; null = there is nothing to undo. */
  undo() {
    const change = this.#done.pop();
    if (!change) return null;
    this.#undone.push(change);
    return { id: change.id, item: change.before };
  }

  redo() {
    const change = this.#undone.pop();
    if (!change) return null;
    this.#done.push(change);
    return { id: change.id, item: change.after };
  }
}

/** The members of a measurement that measure.put takes. */
export const putParams = ({ id, kind, points, range, text, color, hidden }) => ({ id, kind, points, ...(range ? { range } : {}), text, color, hidden });

/** The points of a rectangle or an ellipse from two opposite corners of it in a plane; null if it has no area. */
export function pointsFromCorners(kind, from, to, { right, down }) {
  const across = subtract(to, from);
  const [u, v] = [scale(right, dot(across, right)), scale(down, dot(across, down))];
  if (!(length(u) > 0) || !(length(v) > 0)) return null;
  if (kind === 'rectangle') return [from, add(from, u), add(from, v)];
  const center = add(from, scale(add(u, v), 0.5));
  return [center, add(center, scale(u, 0.5)), add(center, scale(v, 0.5))];
}

/** The places of the handles: the points, the corners of a rectangle, the centre and the four ends of the axes of an ellipse. */
export function handlesOf({ kind, points }) {
  if (kind === 'rectangle') return [points[0], points[1], add(points[1], subtract(points[2], points[0])), points[2]];
  if (kind === 'ellipse') {
    const ends = [points[1], points[2]].map((end) => subtract(end, points[0]));
    return [points[0], points[1], points[2], ...ends.map((end) => subtract(points[0], end))];
  }
  return points;
}

/** The points after a handle moved to a place. A region keeps its plane and its directions; null if it would have no area. */
export function moveHandle({ kind, points }, handle, to) {
  if (kind === 'rectangle') {
    const corners = handlesOf({ kind, points });
    const opposite = corners[(handle + 2) % 4];
    const [right, down] = [1, 2].map((i) => normalize(subtract(points[i], points[0])));
    const across = subtract(to, opposite);
    const [u, v] = [scale(right, dot(across, right)), scale(down, dot(across, down))];
    if (!(length(u) > 0) || !(length(v) > 0)) return null;
    // The first point and its neighbours keep their places in the order of the corners.
    const at = [add(opposite, add(u, v)), add(opposite, v), opposite, add(opposite, u)];
    const moved = handle % 2 === 0 ? at : [add(opposite, add(u, v)), add(opposite, u), opposite, add(opposite, v)];
    const order = [0, 1, 2, 3].map((i) => moved[(i - handle + 4) % 4]);
    return [order[0], order[1], order[3]];
  }
  if (kind === 'ellipse') {
    if (handle === 0) return points.map((point) => add(point, subtract(to, points[0])));
    const axis = handle % 2 === 1 ? 1 : 2;
    const direction = normalize(subtract(points[axis], points[0]));
    const reach = Math.abs(dot(subtract(to, points[0]), direction));
    if (!(reach > 0)) return null;
    return points.map((point, i) => (i === axis ? add(points[0], scale(direction, reach)) : point));
  }
  return points.map((point, i) => (i === handle ? to : point));
}

/** The lines of a measurement in the world: a list of lists of points. path: the points of a path, once they are known. */
export function linesOf({ kind, points }, path = null) {
  if (kind === 'marker' || kind === 'part') return [];
  if (kind === 'path' && path) return [path];
  if (kind === 'rectangle') {
    const corners = handlesOf({ kind, points });
    return [[...corners, corners[0]]];
  }
  if (kind === 'ellipse') {
    const [u, v] = [subtract(points[1], points[0]), subtract(points[2], points[0])];
    return [Array.from({ length: ELLIPSE_STEPS + 1 }, (_, i) => {
      const angle = 2 * Math.PI * i / ELLIPSE_STEPS;
      return add(points[0], add(scale(u, Math.cos(angle)), scale(v, Math.sin(angle))));
    })];
  }
  return kind === 'angle' && points.length === 3 ? [points, arcOf(points)] : [points];
}

/** The arc of an angle, at a third of the shorter arm. */
function arcOf([a, vertex, c]) {
  const arms = [a, c].map((end) => subtract(end, vertex));
  const radius = Math.min(...arms.map(length)) / 3;
  const [from, to] = arms.map(normalize);
  const across = subtract(to, scale(from, dot(from, to)));
  if (!(radius > 0) || !(length(across) > 1e-9)) return [];
  const side = normalize(across);
  const angle = Math.atan2(length(cross(from, to)), dot(from, to));
  return Array.from({ length: ARC_STEPS + 1 }, (_, i) => {
    const part = angle * i / ARC_STEPS;
    return add(vertex, scale(add(scale(from, Math.cos(part)), scale(side, Math.sin(part))), radius));
  });
}

/** The middle of a measurement. */
export function centerOf({ kind, points }) {
  const all = kind === 'rectangle' ? handlesOf({ kind, points }) : kind === 'ellipse' ? [points[0]] : points;
  return scale(all.reduce(add, [0, 0, 0]), 1 / all.length);
}

/** How a measurement lies to a plane: 'in' it (within `near`), 'across' it, or 'apart'. */
export function placeIn(item, plane, near) {
  const depths = handlesOf(item).map((point) => dot(subtract(point, plane.origin), plane.normal));
  if (depths.every((depth) => Math.abs(depth) <= near)) return 'in';
  return Math.min(...depths) <= near && Math.max(...depths) >= -near ? 'across' : 'apart';
}

/** The value of a distance or an angle, which the page knows before the daemon answers; null for other kinds. */
export function quickValue({ kind, points }) {
  if (kind === 'distance' || kind === 'profile') return points.length === 2 ? length(subtract(points[1], points[0])) : null;
  if (kind !== 'angle' || points.length < 3) return null;
  const [a, c] = [points[0], points[2]].map((end) => subtract(end, points[1]));
  return Math.atan2(length(cross(a, c)), dot(a, c)) * 180 / Math.PI;
}

/** A number with `digits` significant digits, without an exponent where that is short. */
export function shortNumber(value, digits = 4) {
  const rounded = Number(value.toPrecision(digits));
  const size = Math.abs(rounded);
  return size !== 0 && (size >= 1e7 || size < 1e-4) ? rounded.toExponential(digits - 1) : String(rounded);
}

/** Round numbers from low to high, about `count` of them: multiples of 1, 2 or 5 times a power of ten. */
export function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0) || !Number.isFinite(span)) return [low];
  const power = 10 ** Math.floor(Math.log10(span / count));
  const step = power * [1, 2, 5, 10].find((factor) => span / (factor * power) <= count + 1e-9);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, i) => Number(((first + i) * step).toPrecision(12)));
}

/** The unit as people write it. */
export const unitText = (unit) => (unit === 'deg' ? '°' : unit.replace(/^[^^]*/, unitName).replace(/\^2$/, '²').replace(/\^3$/, '³'));

/** A value with its unit, such as "12.5 mm" and "90°"; `none` without a value. */
export function valueText({ value, unit }, none, digits = 4) {
  if (value === null || value === undefined) return none;
  const name = unitText(unit ?? '');
  return name === '°' ? `${shortNumber(value, digits)}°` : `${shortNumber(value, digits)} ${name}`.trim();
}

/** The unit of the value of this kind of measurement in a volume. The daemon answers with the same unit. */
export function unitOf(kind, volume) {
  const unit = volume?.unit;
  if (kind === 'marker') return valueUnit(volume);
  if (kind === 'angle' || !unit) return kind === 'angle' ? 'deg' : '';
  return kind === 'part' ? `${unit}^3` : KINDS[kind].hasPlane ? `${unit}^2` : unit;
}

/**
 * The place {x, y} of the middle of a label of `width` × `height` px beside the line from a to b (px), on its upper side or, for a steep
 * line, at its right, so that the label does not touch the line.
 */
export function labelBeside(a, b, width, height, gap = 6) {
  const middle = { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
  const size = Math.hypot(b.x - a.x, b.y - a.y);
  let normal = size > 0 ? { x: (b.y - a.y) / size, y: -(b.x - a.x) / size } : { x: 0, y: -1 };
  if (normal.y > 1e-9 || (Math.abs(normal.y) <= 1e-9 && normal.x < 0)) normal = { x: -normal.x, y: -normal.y };
  const reach = Math.abs(normal.x) * width / 2 + Math.abs(normal.y) * height / 2 + gap;
  return { x: middle.x + normal.x * reach, y: middle.y + normal.y * reach };
}
