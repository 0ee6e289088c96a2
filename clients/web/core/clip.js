// SPDX-License-Identifier: Apache-2.0
// What is cut away: the box, in fractions of the volume, and a plane {normal, offset} that keeps dot(normal, p) >= offset.
// The plane's depth is the part of the volume's length along the normal that it cuts away: 0 nothing, 1 everything.
import { dot, normalize, subtract } from './vector.js';

export const WHOLE = Object.freeze([[0, 0, 0], [1, 1, 1]]);

/** Moves one face of the box (corner 0 the lower, 1 the upper) to `value` in [0,1]; the face opposite gives way. */
export function moveFace(box, corner, axis, value) {
  const moved = box.map((part) => [...part]);
  const other = 1 - corner;
  moved[corner][axis] = value;
  moved[other][axis] = corner === 0 ? Math.max(moved[other][axis], value) : Math.min(moved[other][axis], value);
  return moved;
}

/** How far a box {center, half: three half edges} reaches along a normal: [least, greatest] dot(normal, p). */
export function reach({ center, half }, normal) {
  const middle = dot(normal, center);
  const radius = half.reduce((sum, edge) => sum + Math.abs(dot(normal, edge)), 0);
  return [middle - radius, middle + radius];
}

/** The plane with this normal that cuts `depth` of the box away. */
export function planeAt(box, normal, depth) {
  const [low, high] = reach(box, normal);
  return { normal, offset: low + depth * (high - low) };
}

export function depthOf(box, { normal, offset }) {
  const [low, high] = reach(box, normal);
  return high > low ? Math.min(1, Math.max(0, (offset - low) / (high - low))) : 0;
}

/** The normal of a plane that cuts what is nearest to the viewer: where the camera looks. */
export const sight = (camera) => normalize(subtract(camera.target, camera.position));
