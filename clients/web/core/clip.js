// SPDX-License-Identifier: Apache-2.0
// Clipping: a box in fractions of the volume, and planes {normal, offset} that keep dot(normal, p) >= offset. The depth of
// a plane is the clipped fraction of the volume's extent along the normal, in [0, 1]. A volume's box is {center, half: three half edges}.
import { add, axisAngle, conjugate, cross, dot, length, multiply, normalize, rotate, scale, subtract } from './vector.js';

export const WHOLE = Object.freeze([[0, 0, 0], [1, 1, 1]]);
/** The protocol allows this many planes. */
export const PLANES_MAX = 8;
/** A drag along an axis that points this straight at the viewer follows the pointer's height instead. Square of the sine. */
const STRAIGHT = 0.02;
/** Turn of a plane per px of a drag. */
const TILT = Math.PI / 360;

/** Moves one face of the box (corner 0 = lower, 1 = upper) to `value` in [0,1] and pushes the opposite face if needed. */
export function moveFace(box, corner, axis, value) {
  const moved = box.map((part) => [...part]);
  const other = 1 - corner;
  moved[corner][axis] = value;
  moved[other][axis] = corner === 0 ? Math.max(moved[other][axis], value) : Math.min(moved[other][axis], value);
  return moved;
}

/** Moves one face as far as the opposite face or the end of the volume. */
export function dragFace(box, corner, axis, value) {
  const [low, high] = corner === 0 ? [0, box[1][axis]] : [box[0][axis], 1];
  return moveFace(box, corner, axis, Math.min(high, Math.max(low, value)));
}

/** The extent [least, greatest] of dot(normal, p) over a box {center, half: three half edges}. */
export function reach({ center, half }, normal) {
  const middle = dot(normal, center);
  const radius = half.reduce((sum, edge) => sum + Math.abs(dot(normal, edge)), 0);
  return [middle - radius, middle + radius];
}

/** The plane with this normal that clips the fraction `depth` of the box. */
export function planeAt(box, normal, depth) {
  const [low, high] = reach(box, normal);
  return { normal, offset: low + depth * (high - low) };
}

export function depthOf(box, { normal, offset }) {
  const [low, high] = reach(box, normal);
  return high > low ? Math.min(1, Math.max(0, (offset - low) / (high - low))) : 0;
}

/** The normal of a plane that clips the part nearest to the viewer: the view direction. */
export const sight = (camera) => normalize(subtract(camera.target, camera.position));

/** The point of the world at fractions of the volume. */
export const pointAt = ({ center, half }, fractions) => half.reduce((p, edge, i) => add(p, scale(edge, 2 * fractions[i] - 1)), center);

/** The middle of a face of the clip box. */
export function faceMiddle(volumeBox, box, corner, axis) {
  return pointAt(volumeBox, [0, 1, 2].map((i) => (i === axis ? box[corner][i] : (box[0][i] + box[1][i]) / 2)));
}

/** The middle of the clip box. */
export const boxMiddle = (volumeBox, box) => pointAt(volumeBox, box[0].map((low, i) => (low + box[1][i]) / 2));

/** Moves a box by a world vector, as far as the volume reaches; its size stays. */
export function moveBox({ half: [x, y, z] }, box, way) {
  const volume = dot(x, cross(y, z));
  const parts = [cross(y, z), cross(z, x), cross(x, y)].map((row) => dot(row, way) / volume / 2);
  const moved = parts.map((part, i) => Math.max(-box[0][i], Math.min(1 - box[1][i], part)));
  return box.map((corner) => corner.map((at, i) => Math.min(1, Math.max(0, at + moved[i]))));
}

const EDGES = [0, 1, 2].flatMap((axis) => [0, 1].flatMap((b) => [0, 1].map((c) => ({ axis, b, c }))));

/** Whether a face with this outward normal through this point is turned to the eye {position, back, isFlat}. */
const isTurned = (eye, point, normal) => dot(normal, eye.isFlat ? eye.back : subtract(eye.position, point)) > 0;

/** The 12 edges {from, to, isHidden} of the clip box. An edge is hidden if both faces beside it are turned away. */
export function boxEdges(volumeBox, box, eye) {
  const turned = [0, 1].map((corner) => [0, 1, 2].map((axis) => isTurned(eye, faceMiddle(volumeBox, box, corner, axis),
    scale(volumeBox.half[axis], corner === 0 ? -1 : 1))));
  return EDGES.map(({ axis, b, c }) => {
    const [second, third] = [(axis + 1) % 3, (axis + 2) % 3];
    const [from, to] = [0, 1].map((end) => pointAt(volumeBox, [0, 1, 2].map((i) => box[i === axis ? end : i === second ? b : c][i])));
    return { from, to, isHidden: !turned[b][second] && !turned[c][third] };
  });
}

/** The polygon in which a plane cuts the volume, in order around its middle; empty if it misses the volume. */
export function section(volumeBox, { normal, offset }) {
  const points = [];
  for (const { from, to } of boxEdges(volumeBox, WHOLE, { isFlat: true, back: normal })) {
    const [a, b] = [dot(normal, from) - offset, dot(normal, to) - offset];
    if ((a < 0) !== (b < 0)) points.push(add(from, scale(subtract(to, from), a / (a - b))));
  }
  if (points.length < 3) return [];
  const middle = scale(points.reduce(add), 1 / points.length);
  const n = normalize(normal);
  const u = normalize(subtract(points[0], middle));
  const v = [n[1] * u[2] - n[2] * u[1], n[2] * u[0] - n[0] * u[2], n[0] * u[1] - n[1] * u[0]];
  const angle = (p) => Math.atan2(dot(subtract(p, middle), v), dot(subtract(p, middle), u));
  return points.map((at) => ({ at, turn: angle(at) })).sort((p, q) => p.turn - q.turn).map(({ at }) => at);
}

/** How far the handles of planes lie from the centre, as a part of the half edges. */
const ASIDE = 0.36;
const CORNERS = [[1, 1, 1], [-1, 1, 1], [1, -1, 1], [-1, -1, 1], [1, 1, -1], [-1, 1, -1], [1, -1, -1], [-1, -1, -1]];

/** The point at which plane `index` is held: next to a point of its own near the centre, so that handles rarely meet. */
export function anchorOf({ center, half }, { normal, offset }, index) {
  const own = half.reduce((p, edge, i) => add(p, scale(edge, ASIDE * CORNERS[index % CORNERS.length][i])), center);
  return add(own, scale(normal, (offset - dot(normal, own)) / dot(normal, normal)));
}

/**
 * How far along `axis` (in its lengths, from `point`) the line is nearest to the ray {origin, direction}. Null if the axis points
 * so straight at the viewer that no answer is good.
 */
export function alongAxis(point, axis, { origin, direction }) {
  const from = subtract(point, origin);
  const [aa, ad, dd] = [dot(axis, axis), dot(axis, direction), dot(direction, direction)];
  const area = aa * dd - ad * ad;
  return area < STRAIGHT * aa * dd ? null : (ad * dot(direction, from) - dd * dot(axis, from)) / area;
}

/** How far a drag between two rays moves a handle along its axis. `rise`: px upwards; `worldPerPx`: world units per px. */
export function dragAlong(point, axis, fromRay, toRay, rise, worldPerPx) {
  const [a, b] = [fromRay, toRay].map((ray) => alongAxis(point, axis, ray));
  if (a !== null && b !== null) return b - a;
  const isAway = dot(axis, toRay.direction) > 0; // upwards is away from the viewer
  return (isAway ? 1 : -1) * rise * worldPerPx / length(axis);
}

/** Moves a plane along its normal by world units. */
export const shiftPlane = (plane, distance) => ({ ...plane, offset: plane.offset + distance * length(plane.normal) });

/** Turns a plane about `anchor` as a drag of (dx, dy) px turns a ball before the camera of this orientation. */
export function tiltPlane(plane, anchor, orientation, [dx, dy]) {
  const px = Math.hypot(dx, dy);
  if (px === 0) return plane;
  const turn = axisAngle([dy / px, dx / px, 0], px * TILT);
  const normal = rotate(multiply(multiply(orientation, turn), conjugate(orientation)), plane.normal);
  return { ...plane, normal, offset: dot(normal, anchor) };
}

const negate = (x) => (x === 0 ? 0 : -x);
export const flipPlane = (plane) => ({ ...plane, normal: plane.normal.map(negate), offset: negate(plane.offset) });

/** The distance of a plane from the origin along its normal, in world units. */
export const positionOf = ({ normal, offset }) => offset / length(normal);

/** A plane with this normal at this distance from the origin; null without a direction. */
export function planeFrom(normal, position) {
  const size = length(normal);
  return size > 0 && Number.isFinite(size) && Number.isFinite(position) ? { normal: scale(normal, 1 / size), offset: position } : null;
}

/** The plane through the centre of the volume across one of its own axes. */
export function axisPlane(volumeBox, axis) {
  const normal = normalize(volumeBox.half[axis]).map((part) => (Math.abs(part) < 1e-12 ? 0 : part));
  return { normal, offset: dot(normal, volumeBox.center) };
}

/** The planes of a list {plane, isOn} that the view holds. */
export const planesOn = (entries) => entries.filter(({ isOn }) => isOn).map(({ plane }) => plane);

/** A list of {plane, isOn} after the view changed: planes that are off stay in their places. */
export function reconcile(entries, planes) {
  const rest = [...planes];
  const kept = entries.flatMap((entry) => {
    if (!entry.isOn) return [entry];
    return rest.length > 0 ? [{ ...entry, plane: rest.shift() }] : [];
  });
  return [...kept, ...rest.map((plane) => ({ plane, isOn: true }))].slice(0, Math.max(PLANES_MAX, planes.length));
}

/** One of the volume's own axes: the world axis that it follows, whether it points along its negative direction, and whether exactly. */
export function axisOf({ half }, axis) {
  const direction = normalize(half[axis]);
  const world = direction.reduce((best, part, i) => (Math.abs(part) > Math.abs(direction[best]) ? i : best), 0);
  return { world, sign: Math.sign(direction[world]), isExact: Math.abs(direction[world]) > 1 - 1e-6 };
}

/** The coordinate [world units] of a face: of the world if the axis follows one of its axes, else from the start of the volume. */
export function faceCoordinate(volumeBox, axis, fraction) {
  const { world, isExact } = axisOf(volumeBox, axis);
  const extent = 2 * length(volumeBox.half[axis]);
  return isExact ? volumeBox.center[world] + (2 * fraction - 1) * volumeBox.half[axis][world] : fraction * extent;
}

/** The inverse of faceCoordinate, within [0, 1]. */
export function fractionAt(volumeBox, axis, coordinate) {
  const [low, high] = [0, 1].map((fraction) => faceCoordinate(volumeBox, axis, fraction));
  return Math.min(1, Math.max(0, (coordinate - low) / (high - low)));
}
