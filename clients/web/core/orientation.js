// SPDX-License-Identifier: Apache-2.0
// Named directions of a volume: anatomical letters, standard views, and the camera in angles.
//
// A frame is {front, side, up, left, topUp, bottomUp}, unit vectors in the world. The front view shows `side` to the right and
// `up` upwards. `left` is the patient's left where the file tells it, else the left of the front view. topUp and bottomUp
// point up in the views from the top and from the bottom. A direction of a view points from the target to the eye.
import { IDENTITY, add, axisAngle, conjugate, cross, dot, fromAxes, multiply, normalize, rotate, scale, subtract } from './vector.js';

const DEGREE = Math.PI / 180;
const OPPOSITE = { L: 'R', R: 'L', P: 'A', A: 'P', S: 'I', I: 'S' };
/** Within this cosine of the elevation, the up vector tells the azimuth. */
const POLE = 1e-4;

const negate = (v) => v.map((part) => (part === 0 ? 0 : -part));
const across = (a, b) => cross(a, b).map((part) => part + 0); // no -0
const unit = (axis, sign = 1) => [0, 1, 2].map((i) => (i === axis ? sign : 0));

/** The letters that world +x, +y and +z point to, or null if the volume does not tell all three. */
export function anatomyOf(volume) {
  const letters = volume?.anatomy;
  const kinds = letters?.map?.((letter) => ['LR', 'PA', 'SI'].findIndex((pair) => pair.includes(letter)));
  return kinds?.length === 3 && new Set(kinds).size === 3 && !kinds.includes(-1) ? letters : null;
}

/** The letter of the direction `sign` along a world axis. */
export const letterOf = (anatomy, axis, sign) => (sign > 0 ? anatomy[axis] : OPPOSITE[anatomy[axis]]);

/** The world direction that a letter means. */
function towards(anatomy, letter) {
  const axis = anatomy.findIndex((other) => other === letter || OPPOSITE[other] === letter);
  return unit(axis, anatomy[axis] === letter ? 1 : -1);
}

/** Turns a vector in the world of a volume into the same anatomical one in another's world. Without the letters of both, it stays. */
export function turnBetween(from, to) {
  if (!from || !to) return (v) => v;
  const axes = to.map((letter) => towards(from, letter));
  return (v) => axes.map((axis) => dot(axis, v) + 0); // no -0
}

/** The world axis with the largest part of v, with its sign. */
function nearestAxis(v) {
  const axis = v.reduce((best, part, i) => (Math.abs(part) > Math.abs(v[best]) ? i : best), 0);
  return unit(axis, Math.sign(v[axis]) || 1);
}

/** The frame of a volume. Without anatomy, `camera`, its default one, tells top and front; without that, z is up and -y the front. */
export function frameOf(anatomy, camera = null) {
  if (anatomy) {
    const [front, up, left] = ['A', 'S', 'L'].map((letter) => towards(anatomy, letter));
    return { front, up, left, side: across(up, front), topUp: front, bottomUp: front };
  }
  const up = camera ? nearestAxis(camera.up) : unit(2);
  const away = camera ? subtract(camera.position, camera.target) : unit(1, -1);
  const level = subtract(away, scale(up, dot(away, up)));
  const front = nearestAxis(Math.hypot(...level) > 0 ? level : unit(up[1] === 0 ? 1 : 2, -1));
  const side = across(up, front);
  return { front, up, side, left: negate(side), topUp: negate(front), bottomUp: front };
}

export const VIEWS = Object.freeze(['front', 'back', 'left', 'right', 'top', 'bottom', 'isometric']);

/** The direction of a standard view. */
export function viewDirection({ front, up, left, side }, name) {
  switch (name) {
    case 'front': return front;
    case 'back': return negate(front);
    case 'left': return left;
    case 'right': return negate(left);
    case 'top': return up;
    case 'bottom': return negate(up);
    default: return normalize(add(add(front, side), up));
  }
}

/** The orientation of an upright camera (camera.js) that looks from this direction. */
export function orientationFrom(frame, direction) {
  const back = normalize(direction);
  const rise = dot(back, frame.up);
  const above = Math.abs(rise) > 1 - POLE ? (rise > 0 ? frame.topUp : frame.bottomUp) : frame.up;
  const right = normalize(cross(above, back));
  return fromAxes(right, cross(back, right), back);
}

/** The orientation for angles [degrees]: azimuth from the front towards `side`, elevation towards `up`, roll to the left. */
export function orientationOf({ front, side, up }, { azimuth, elevation, roll = 0 }) {
  const [a, e] = [azimuth * DEGREE, elevation * DEGREE];
  const level = add(scale(front, Math.cos(a)), scale(side, Math.sin(a)));
  const back = add(scale(level, Math.cos(e)), scale(up, Math.sin(e)));
  const above = subtract(scale(up, Math.cos(e)), scale(level, Math.sin(e)));
  return multiply(fromAxes(cross(above, back), above, back), axisAngle([0, 0, 1], roll * DEGREE));
}

/** The angles [degrees] of an orientation: azimuth and roll in (-180, 180], elevation in [-90, 90]. Straight up or down, roll is 0. */
export function anglesOf(frame, orientation) {
  const back = rotate(orientation, [0, 0, 1]);
  const rise = dot(back, frame.up);
  const elevation = Math.asin(Math.min(1, Math.max(-1, rise))) / DEGREE;
  const isPole = Math.sqrt(Math.max(0, 1 - rise * rise)) < POLE;
  const level = isPole ? scale(rotate(orientation, [0, 1, 0]), -Math.sign(rise)) : back;
  const azimuth = Math.atan2(dot(level, frame.side), dot(level, frame.front)) / DEGREE;
  if (isPole) return { azimuth, elevation: Math.sign(rise) * 90, roll: 0 };
  const rest = multiply(conjugate(orientationOf(frame, { azimuth, elevation })), orientation);
  const turn = 2 * Math.atan2(rest[2], rest[3]) / DEGREE;
  return { azimuth, elevation, roll: turn > 180 ? turn - 360 : turn <= -180 ? turn + 360 : turn };
}

/** Turns an upright camera by angles [rad] and keeps it upright; it stops at the top and at the bottom. */
export function turnUpright(frame, orientation, yaw, pitch) {
  const { azimuth, elevation } = anglesOf(frame, orientation ?? IDENTITY);
  const limited = Math.min(90, Math.max(-90, elevation - pitch / DEGREE));
  return orientationOf(frame, { azimuth: azimuth + yaw / DEGREE, elevation: limited });
}
