// SPDX-License-Identifier: Apache-2.0
// The camera of the second picture of a comparison.
import { add, cross, dot, length, normalize, scale, subtract } from './vector.js';

const same = (v) => v;

/** The camera without fields of the daemon that have no meaning in the other view. */
const ofCamera = ({ position, target, up, projection, fov_y, height, near }) => Object.fromEntries(
  Object.entries({ position, target, up, projection, fov_y, height, near }).filter(([, value]) => value !== undefined));

/**
 * The camera of the other picture. `turn` leads from one world to the other (orientation.js, turnBetween). Without spheres the camera
 * is the same in world units. With `from` and `to`, the spheres {center, radius} around the two volumes, it shows the other volume
 * from the same direction and as large.
 */
export function linkedCamera(camera, turn = same, from = null, to = null) {
  const isFitted = from?.radius > 0 && to?.radius > 0;
  const factor = isFitted ? to.radius / from.radius : 1;
  const move = isFitted ? (point) => add(to.center, scale(turn(subtract(point, from.center)), factor)) : turn;
  const made = ofCamera(camera);
  made.position = move(camera.position);
  made.target = move(camera.target);
  made.up = turn(camera.up);
  if (Number.isFinite(camera.height)) made.height = camera.height * factor;
  if (Number.isFinite(camera.near)) made.near = camera.near * factor;
  return made;
}

/** True if both volumes lie at the same place, so that world units are the natural link. `turn` leads from the world of a to the world of b. */
export function isSamePlace(a, b, turn = same) {
  if (!a || !b) return true;
  const distance = length(subtract(turn(a.center), b.center));
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
