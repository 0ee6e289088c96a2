// SPDX-License-Identifier: Apache-2.0
// Movements of the camera besides turning about its target: the walk, another projection, a rectangle, and the way between two rigs.
import { pointOnPlane, worldPerPixel } from './camera.js';
import { slerp } from './blend.js';
import { turnUpright } from './orientation.js';
import { add, length, rotate, scale, subtract } from './vector.js';

const DEGREE = Math.PI / 180;
const mix = (a, b, u) => a + (b - a) * u;
const mixLog = (a, b, u) => Math.exp(mix(Math.log(a), Math.log(b), u));

const spread = (rig) => 2 * Math.tan(rig.fovY * DEGREE / 2); // height of the image per distance
const back = (rig) => rotate(rig.orientation, [0, 0, 1]);
export const eyeOf = (rig) => add(rig.target, scale(back(rig), rig.distance));

/** The rig between two others of one projection, at u in [0, 1]; slow at both ends, exactly `b` at 1. */
export function between(a, b, u) {
  if (u >= 1) return b;
  const part = u * u * (3 - 2 * u);
  const cosine = a.orientation.reduce((sum, x, i) => sum + x * b.orientation[i], 0);
  const nearer = cosine < 0 ? b.orientation.map((x) => -x) : b.orientation; // the same rotation by the shorter arc
  return {
    ...b, target: a.target.map((x, i) => mix(x, b.target[i], part)), orientation: slerp(a.orientation, nearer, part),
    distance: mixLog(a.distance, b.distance, part), height: mixLog(a.height, b.height, part), fovY: mix(a.fovY, b.fovY, part),
  };
}

/**
 * The same rig in another projection: what lies at the target keeps its size. An orthographic eye stays outside the `sphere`
 * {center, radius}, because nothing behind the eye is drawn.
 */
export function withProjection(rig, projection, sphere) {
  if (projection === rig.projection) return rig;
  if (projection === 'perspective') return { ...rig, projection, distance: rig.height / spread(rig) };
  const outside = length(subtract(rig.target, sphere.center)) + 1.1 * sphere.radius;
  return { ...rig, projection, height: rig.distance * spread(rig), distance: Math.max(rig.distance, outside) };
}

/** Another field of view; what lies at the target keeps its size. */
export const withFieldOfView = (rig, fovY) => ({ ...rig, fovY, distance: rig.distance * spread(rig) / spread({ fovY }) });

/** Turns the head: the eye stays, the camera stays upright. Angles in rad: yaw to the left, pitch upwards. */
export function look(rig, frame, yaw, pitch) {
  const eye = eyeOf(rig);
  const orientation = turnUpright(frame, rig.orientation, yaw, pitch);
  return { ...rig, orientation, target: subtract(eye, scale(rotate(orientation, [0, 0, 1]), rig.distance)) };
}

/** Moves eye and target by [right, up, ahead] world units, where `up` goes along frame.up. */
export function walk(rig, frame, [right, up, ahead]) {
  const step = add(rotate(rig.orientation, [right, 0, -ahead]), scale(frame.up, up));
  return { ...rig, target: add(rig.target, step) };
}

/** Shows the rectangle between two screen points as large as fits. `limits` as for zoom() of camera.js. */
export function zoomTo(rig, [x0, y0], [x1, y1], viewport, limits) {
  const part = Math.max(Math.abs(x1 - x0) / viewport.width, Math.abs(y1 - y0) / viewport.height);
  const key = rig.projection === 'orthographic' ? 'height' : 'distance';
  const value = Math.min(Math.max(rig[key] * part, limits.nearest), limits.farthest);
  return { ...rig, [key]: value, target: pointOnPlane(rig, [(x0 + x1) / 2, (y0 + y1) / 2], viewport) };
}

/** The height of the image at the target, in world units. */
export const heightAtTarget = (rig) => worldPerPixel(rig, { height: 1 });
