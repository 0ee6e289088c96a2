// SPDX-License-Identifier: Apache-2.0
// The camera of the second picture of a comparison.
import { cross, dot, length, normalize, subtract } from './vector.js';

const scaleFrom = (from, to, factor) => (point) => point.map((x, i) => to[i] + (x - from[i]) * factor);

/** The camera without fields of the daemon that have no meaning in the other view. */
const ofCamera = ({ position, target, up, projection, fov_y, height, near }) => Object.fromEntries(
  Object.entries({ position, target, up, projection, fov_y, height, near }).filter(([, value]) => value !== undefined));

/**
 * The camera of the other picture. Without spheres it is the same in world units. With `from` and `to`, the spheres {center, radius}
 * around the two volumes, it shows the other volume from the same direction and as large.
 */
export function linkedCamera(camera, from = null, to = null) {
  const made = ofCamera(camera);
  if (!from || !to || !(from.radius > 0) || !(to.radius > 0)) return made;
  const factor = to.radius / from.radius;
  const move = scaleFrom(from.center, to.center, factor);
  made.position = move(camera.position);
  made.target = move(camera.target);
  if (Number.isFinite(camera.height)) made.height = camera.height * factor;
  if (Number.isFinite(camera.near)) made.near = camera.near * factor;
  return made;
}

/** True if both volumes lie at the same place, so that world units are the natural link. */
export function isSamePlace(a, b) {
  if (!a || !b) return true;
  const distance = Math.hypot(...a.center.map((x, i) => x - b.center[i]));
  const radius = Math.max(a.radius, b.radius);
  return distance < 0.5 * radius && Math.min(a.radius, b.radius) > 0.5 * radius;
}

const SEEN_PX = 4; // a smaller volume counts as not seen

/** True if a picture of `viewport` px has a part of the sphere {center, radius} in it, large enough to be seen. */
export function isInSight({ position, target, up, projection, fov_y: fov = 30, height = 1 }, { center, radius }, viewport) {
  const forward = normalize(subtract(target, position));
  const right = normalize(cross(forward, up));
  const from = subtract(center, position);
  const depth = dot(from, forward);
  const away = [Math.abs(dot(from, right)), Math.abs(dot(from, cross(right, forward)))];
  if (depth < -radius) return false;
  const isFlat = projection === 'orthographic';
  const half = isFlat ? height / 2 : Math.tan(fov * Math.PI / 360); // perspective: at a depth of 1
  const reach = isFlat ? 1 : Math.max(length(from), radius);
  if (2 * radius / reach / half * viewport.height / 2 < SEEN_PX) return false;
  return [half * viewport.width / viewport.height, half].every((side, i) => (isFlat
    ? away[i] < side + radius : away[i] < side * depth + radius * Math.hypot(1, side)));
}

/** The settings of a view, for a picture under another camera and size. */
export function settingsOf({ camera, size, ...settings }) {
  return settings;
}
