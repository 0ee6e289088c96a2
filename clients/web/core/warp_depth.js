// SPDX-License-Identifier: Apache-2.0
// How the points of a frame with depth look from another camera. A point of the frame is (x, y) in [-1, 1] (right, up) and the value v of its
// depth in [0, 1]. The value is affine in 1 / depth in perspective and in depth in orthographic projection, so one 4 × 4 matrix takes
// (x, y, v, 1) to the clip space of the other camera.
import { add, cross, dot, normalize, scale, subtract } from './vector.js';

const DEGREE = Math.PI / 180;
const FIRST = 1 / 255; // v of the depth `far`; v = 1 is `near`
const NEAR_PART = 0.02; // nearest visible depth, of the distance from eye to target

/** Right, up, forward, and half the extent of the image at depth 1 (perspective) or at any depth. */
function frameOf(camera, aspect) {
  const forward = normalize(subtract(camera.target, camera.position));
  const right = normalize(cross(forward, camera.up));
  const isFlat = camera.projection === 'orthographic';
  const half = isFlat ? camera.height / 2 : Math.tan(camera.fov_y * DEGREE / 2);
  return { right, up: cross(right, forward), forward, isFlat, half: [half * aspect, half] };
}

/** The columns [x, y, z, w] of the map from (x, y, v, 1) to points relative to the eye of the frame, times w. */
function columnsOf({ right, up, forward, isFlat, half }, { near, far }) {
  const [first, last] = isFlat ? [far, near] : [1 / far, 1 / near];
  const slope = (last - first) / (1 - FIRST);
  const start = first - slope * FIRST;
  const sides = [[...scale(right, half[0]), 0], [...scale(up, half[1]), 0]];
  return isFlat ? [...sides, [...scale(forward, slope), 0], [...scale(forward, start), 1]] : [...sides, [0, 0, 0, slope], [...forward, start]];
}

/**
 * The matrix of a frame {camera, near, far, aspect} for a camera with another aspect (width / height), by columns, as WebGL takes it. Points
 * that are nearer than a fiftieth of the distance to the target are clipped.
 */
export function depthMatrix(from, camera, aspect) {
  const source = frameOf(from.camera, from.aspect);
  const { right, up, forward, isFlat, half } = frameOf(camera, aspect);
  const eye = subtract(camera.position, from.camera.position);
  const distance = dot(subtract(camera.target, camera.position), forward);
  const extent = isFlat ? 10 * (distance + camera.height + Math.abs(from.far)) : 2 * NEAR_PART * distance;
  return new Float32Array(columnsOf(source, from).flatMap((column) => {
    const w = column[3];
    const point = subtract(column, scale(eye, w));
    const [x, y, z] = [right, up, forward].map((axis) => dot(axis, point));
    return isFlat ? [x / half[0], y / half[1], (z - distance * w) / extent, w] : [x / half[0], y / half[1], z - extent * w, z];
  }));
}
