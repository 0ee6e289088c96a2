// SPDX-License-Identifier: Apache-2.0
// How the last picture would look from a newer camera, as if it were painted on the plane through its target that is parallel
// to it. The map of screen points is a homography, a 3×3 matrix by rows: (x, y, 1) ↦ (X·W, Y·W, W).
import { cameraFromRig, pointOnPlane } from './camera.js';
import { dot, rotate, subtract } from './vector.js';

const DEGREE = Math.PI / 180;
/** A point of the picture may come this much nearer to the eye or move this much farther away than its centre; beyond that the
 * warp would distort it beyond use. */
const DEPTH_RATIO_MAX = 3;

/** Returns the homography from the picture of rig `from` to that of rig `to`, or null if no useful one exists. */
export function homography(from, to, viewport) {
  if (from.projection !== to.projection) return null;
  const { position } = cameraFromRig(to);
  const [right, up, back] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => rotate(to.orientation, axis));
  const isFlat = to.projection === 'orthographic';
  const unit = (depth) => (isFlat ? to.height : 2 * depth * Math.tan(to.fovY * DEGREE / 2)) / viewport.height;
  // The products below are affine in the screen point, so three points give the matrix.
  const column = (x, y) => {
    const point = subtract(pointOnPlane(from, [x, y], viewport), position);
    const w = unit(-dot(point, back));
    return [viewport.width / 2 * w + dot(point, right), viewport.height / 2 * w - dot(point, up), w];
  };
  const origin = column(0, 0);
  const [stepX, stepY] = [column(1, 0), column(0, 1)].map((end) => subtract(end, origin));
  const scale = (x, y) => stepX[2] * x + stepY[2] * y + origin[2];
  const { width, height } = viewport;
  const centre = scale(width / 2, height / 2);
  const ratios = [[0, 0], [width, 0], [0, height], [width, height]].map(([x, y]) => scale(x, y) / centre);
  const faces = dot(rotate(from.orientation, [0, 0, 1]), back) > 1 / DEPTH_RATIO_MAX; // the plane is not seen edge-on
  const isUsable = centre > 0 && faces && ratios.every((ratio) => ratio > 1 / DEPTH_RATIO_MAX && ratio < DEPTH_RATIO_MAX);
  return isUsable ? [0, 1, 2].map((row) => [stepX[row], stepY[row], origin[row]]) : null;
}

/** The CSS transform of a homography, for the transform origin 0 0. */
export function cssTransform([[a, b, c], [d, e, f], [g, h, i]]) {
  return `matrix3d(${[a, d, 0, g, b, e, 0, h, 0, 0, i, 0, c, f, 0, i].map((n) => n / i).join(', ')})`;
}
