// SPDX-License-Identifier: Apache-2.0
// Clipping: a box in fractions of the volume, and a plane {normal, offset} that keeps dot(normal, p) >= offset. The depth of
// the plane is the clipped fraction of the volume's extent along the normal, in [0, 1].
import { dot, normalize, subtract } from './vector.js';

export const WHOLE = Object.freeze([[0, 0, 0], [1, 1, 1]]);

/** Moves one face of the box (corner 0 = lower, 1 = upper) to `value` in [0,1] and pushes the opposite face if needed. */
export function moveFace(box, corner, axis, value) {
  const moved = box.map((part) => [...part]);
  const other = 1 - corner;
  moved[corner][axis] = value;
  moved[other][axis] = corner === 0 ? Math.max(moved[other][axis], value) : Math.min(moved[other][axis], value);
  return moved;
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
