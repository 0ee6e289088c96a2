// SPDX-License-Identifier: Apache-2.0
// The camera as the client moves it, and its fields in the view (protocol: "camera").
//
// A rig is {projection, target, distance, orientation, fovY, height}. The orientation is one unit quaternion, whose
// columns are right, up and back in world space. Position and up are always computed from it, so errors do not
// accumulate and up stays perpendicular to the line of sight.
// A viewport is {width, height} in CSS px; screen points are px from its upper left corner, y down.
import {
  add, subtract, scale, dot, cross, length, normalize, rotate, multiply, axisAngle, fromAxes,
  normalizeQuaternion,
} from './vector.js';

const DEGREE = Math.PI / 180;

/** The rig of a view's camera {projection, position, target, up, fov_y, height}. Throws RangeError if it is degenerate. */
export function rigFromCamera(camera) {
  const sight = subtract(camera.target, camera.position);
  const forward = normalize(sight);
  const right = normalize(cross(forward, camera.up));
  const up = cross(right, forward);
  return {
    projection: camera.projection ?? 'perspective',
    target: [...camera.target],
    distance: length(sight),
    orientation: fromAxes(right, up, scale(forward, -1)),
    fovY: camera.fov_y ?? 30,
    height: camera.height ?? 1,
  };
}

/** The fields of the view's camera that a movement changes. */
export function cameraFromRig(rig) {
  const camera = {
    position: add(rig.target, rotate(rig.orientation, [0, 0, rig.distance])),
    target: [...rig.target],
    up: rotate(rig.orientation, [0, 1, 0]),
  };
  if (rig.projection === 'orthographic') camera.height = rig.height;
  return camera;
}

/** World units per px in the plane through the target that is parallel to the image. */
export function worldPerPixel(rig, viewport) {
  const seen = rig.projection === 'orthographic'
    ? rig.height : 2 * rig.distance * Math.tan(rig.fovY * DEGREE / 2);
  return seen / viewport.height;
}

/** The point of the target's plane under the screen point (x, y). */
export function pointOnPlane(rig, [x, y], viewport) {
  const unit = worldPerPixel(rig, viewport);
  const offset = [(x - viewport.width / 2) * unit, (viewport.height / 2 - y) * unit, 0];
  return add(rig.target, rotate(rig.orientation, offset));
}

/** Moves the camera in the image plane, so that points at the target's depth follow (dx, dy) px. */
export function pan(rig, [dx, dy], viewport) {
  const unit = worldPerPixel(rig, viewport);
  return { ...rig, target: subtract(rig.target, rotate(rig.orientation, [dx * unit, -dy * unit, 0])) };
}

/**
 * Moves towards the target (factor < 1) or away from it and keeps the point under `at` in place. `limits` is
 * {nearest, farthest} of the distance (perspective) or of the height (orthographic), in world units.
 */
export function zoom(rig, factor, at, viewport, limits) {
  const key = rig.projection === 'orthographic' ? 'height' : 'distance';
  const value = Math.min(Math.max(rig[key] * factor, limits.nearest), limits.farthest);
  const anchor = pointOnPlane(rig, at, viewport);
  const real = value / rig[key];
  return { ...rig, [key]: value, target: add(anchor, scale(subtract(rig.target, anchor), real)) };
}

/** Turns the camera about the target by angles [rad] about its own up (yaw), right (pitch) and view (roll) axes. */
export function orbit(rig, yaw, pitch, roll = 0) {
  let q = rig.orientation;
  if (yaw) q = multiply(q, axisAngle([0, 1, 0], yaw));
  if (pitch) q = multiply(q, axisAngle([1, 0, 0], pitch));
  if (roll) q = multiply(q, axisAngle([0, 0, 1], roll));
  return { ...rig, orientation: normalizeQuaternion(q) };
}

/** Start and end of a volume along an axis: half a gap beyond its samples, measured from the first sample. */
export function extent({ dims, spacing, coordinates }, axis) {
  const at = coordinates?.[axis];
  if (!at || at.length < 2) return [-spacing[axis] / 2, (dims[axis] - 0.5) * spacing[axis]];
  return [(at[0] - at[1]) / 2, at.at(-1) + (at.at(-1) - at.at(-2)) / 2];
}

/** The box {center, half: three half edges as vectors} of a volume as the protocol describes it (dims, spacing, …). */
export function volumeBox(volume) {
  const { origin = [0, 0, 0], direction: rows = [[1, 0, 0], [0, 1, 0], [0, 0, 1]] } = volume;
  const world = (axes) => rows.map((row) => dot(row, axes));
  const extents = [0, 1, 2].map((axis) => extent(volume, axis));
  const edge = (axis) => world(extents.map(([low, high], i) => (i === axis ? (high - low) / 2 : 0)));
  return {
    center: add(origin, world(extents.map(([low, high]) => (low + high) / 2))), half: [edge(0), edge(1), edge(2)],
  };
}

/** The sphere {center, radius} around a box. */
export function sphereAround({ center, half: [a, b, c] }) {
  const corners = [add(b, c), subtract(b, c), subtract(c, b), scale(add(b, c), -1)];
  return { center, radius: Math.max(...corners.map((corner) => length(add(a, corner)))) };
}

/** The limits of zooming around a sphere. */
export const zoomLimits = ({ radius }) => ({ nearest: radius * 0.02, farthest: radius * 40 });

/** The visible matter of a default view and a small border need this share of its square. */
const FRAMED = 0.9;
/** No margin makes the volume smaller than this. */
const SHRINK_MAX = 1.5;
const NO_MARGINS = Object.freeze({ left: 0, right: 0, top: 0, bottom: 0 });

/** The side in px of the square that a default view is fitted into: in the middle, clear of the margins as far as SHRINK_MAX allows. */
function squareOf({ width, height }, { left, right, top, bottom }) {
  const side = Math.min(width, height);
  const clear = Math.min(width - 2 * Math.max(left, right), height - 2 * Math.max(top, bottom)) / FRAMED;
  return Math.min(side, Math.max(clear, side / SHRINK_MAX));
}

/**
 * Moves a camera that frames its volume in a square back, so that a narrower viewport shows the same width, and so that the volume stays
 * clear of the margins {left, right, top, bottom} in px, which the panel and the status bar cover. The target stays in the centre, because
 * the camera orbits around it.
 */
export function widen(rig, viewport, margins = NO_MARGINS) {
  const factor = viewport.height / squareOf(viewport, margins);
  return factor > 1 ? { ...rig, distance: rig.distance * factor, height: rig.height * factor } : rig;
}

/** The visible part touches this share of the free space. */
const FILLED = 0.95;

/**
 * Keeps the orientation and fits a part {center, half, radius} of the volume, a box and a sphere that both hold it, into the space that the
 * margins leave on both sides of the centre. The target becomes the part's centre. Without `half`, the sphere alone counts.
 */
export function fit(rig, { center, half = null, radius }, viewport, margins = NO_MARGINS) {
  const { width, height } = viewport;
  const least = Math.min(width, height) / SHRINK_MAX;
  // Halves of the space over half the height of the picture.
  const x = Math.max(width - 2 * Math.max(margins.left, margins.right), least) / height * FILLED;
  const y = Math.max(height - 2 * Math.max(margins.top, margins.bottom), least) / height * FILLED;
  const slope = Math.tan(rig.fovY * DEGREE / 2);
  let distance = radius / Math.sin(Math.atan(slope * Math.min(x, y)));
  let seen = 2 * radius / Math.min(x, y);
  if (half) {
    const inverse = [-rig.orientation[0], -rig.orientation[1], -rig.orientation[2], rig.orientation[3]];
    const [a, b, c] = half.map((edge) => rotate(inverse, edge));
    const corners = [add(b, c), subtract(b, c), subtract(c, b), scale(add(b, c), -1)].map((corner) => add(a, corner));
    const all = [...corners, ...corners.map((corner) => scale(corner, -1))];
    distance = Math.min(distance, Math.max(...all.map((at) => at[2] + Math.max(Math.abs(at[0]) / x, Math.abs(at[1]) / y) / slope)));
    seen = Math.min(seen, 2 * Math.max(...all.map((at) => Math.max(Math.abs(at[0]) / x, Math.abs(at[1]) / y))));
  }
  return { ...rig, target: [...center], distance, height: seen };
}
