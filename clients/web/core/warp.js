// SPDX-License-Identifier: Apache-2.0
// How the last picture would look from a newer camera, as if it were painted on the plane through its target that is parallel
// to it. The map of screen points is a homography, a 3×3 matrix by rows: (x, y, 1) ↦ (X·W, Y·W, W).
import { cameraFromRig, pointOnPlane, rigFromCamera } from './camera.js';
import { dot, rotate, subtract } from './vector.js';

const DEGREE = Math.PI / 180;
/** A point of the picture may come this much nearer to the eye or move this much farther away than its centre; beyond that the
 * warp would distort it beyond use. */
const DEPTH_RATIO_MAX = 3;

/** How far a side of the warped picture fades out, at the most and per px of background that shows beyond it. */
const FADE_MAX = 0.15; // of the shorter side
const FADE_PER_PX = 2;

/** Returns the homography from the picture of rig `from` to the picture of rig `to`, or null if no useful one exists. */
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

/**
 * How far each side of the warped picture fades into the background [px of the picture]: {left, right, top, bottom}. A side fades where the
 * viewport shows what lies beyond it, or the picture would end in a cut through the volume; 0 = its border is outside.
 */
export function fadesOf(map, { width, height }) {
  const at = (x, y) => {
    const [u, v, w] = map.map(([a, b, c]) => a * x + b * y + c);
    return [u / w, v / w];
  };
  const [topLeft, topRight, bottomLeft, bottomRight] = [at(0, 0), at(width, 0), at(0, height), at(width, height)];
  const fade = (...bare) => Math.min(Math.max(0, ...bare) * FADE_PER_PX, FADE_MAX * Math.min(width, height));
  return {
    left: fade(topLeft[0], bottomLeft[0]), right: fade(width - topRight[0], width - bottomRight[0]),
    top: fade(topLeft[1], topRight[1]), bottom: fade(height - bottomLeft[1], height - bottomRight[1]),
  };
}

const SAME = 1e-6; // of the distance of the target

/**
 * Gives the camera of a frame: {rig, isAhead}. `rig`: the camera of the update that the frame shows; null if it is unknown. isAhead: the daemon has
 * predicted the camera of the frame (protocol/stream.md); then this camera is returned.
 */
export function cameraOf({ depth, isFinal }, rig) {
  if (!rig || !depth || isFinal) return { rig, isAhead: false };
  const own = rigFromCamera(depth.camera);
  const [asked, drawn] = [rig, own].map(cameraFromRig); // the up of a view may be tilted
  const isSame = (key, unit) => drawn[key].every((x, i) => Math.abs(x - asked[key][i]) <= SAME * unit);
  const isAhead = !isSame('position', rig.distance) || !isSame('target', rig.distance) || !isSame('up', 1)
    || (rig.projection === 'orthographic' && Math.abs(own.height - rig.height) > SAME * rig.height);
  return { rig: isAhead ? own : rig, isAhead };
}

const wayBetween = (a, b) => {
  const [from, to] = [a, b].map(cameraFromRig);
  const higher = a.projection === 'orthographic' ? a.height - b.height : 0; // a perspective camera has none
  return Math.hypot(...subtract(from.position, to.position), ...subtract(from.target, to.target), higher);
};

/** True if `first` is further from `rig` than `second` is. */
export const isFurther = (first, second, rig) => wayBetween(first, rig) > wayBetween(second, rig);
