// SPDX-License-Identifier: Apache-2.0
// Interpolates between two views a (u = 0) and b (u = 1), exactly as the daemon does for camera paths
// (server/paths/blend.h). Numbers are linear, the camera moves on an arc about its target, directions turn, and transfer
// functions are blended at every value. Names, and lists of different lengths, come from a until u = 1.
import { blendTransform } from './blend_transform.js';
import { cameraFromRig, rigFromCamera } from './camera.js';
import { dot, length, normalize, scale } from './vector.js';

/** Stays within [a, b] despite rounding. */
const within = (x, a, b) => Math.min(Math.max(x, Math.min(a, b)), Math.max(a, b));
const mix = (a, b, u) => within(a * (1 - u) + b * u, a, b);
/** Equal steps of u give equal ratios. Both numbers are above 0. */
const mixLog = (a, b, u) => within(Math.exp(mix(Math.log(a), Math.log(b), u)), a, b);

const isObject = (value) => typeof value === 'object' && value !== null;

/** The rule for all fields without a rule of their own. */
function blendAny(a, b, u) {
  if (typeof a === 'number' && typeof b === 'number') return mix(a, b, u);
  if (!isObject(a) || !isObject(b) || Array.isArray(a) !== Array.isArray(b)) return a;
  if (Array.isArray(a)) return a.length === b.length ? a.map((part, i) => blendAny(part, b[i], u)) : a;
  return Object.fromEntries(Object.entries(a).map(([key, part]) => [key, blendAny(part, b[key], u)]));
}

/** Interpolates between two unit vectors in 3 or 4 dimensions at constant angular speed. */
export function slerp(a, b, u) {
  const cosine = a.reduce((sum, part, i) => sum + part * b[i], 0);
  const angle = Math.acos(within(cosine, -1, 1));
  const sine = Math.sin(angle);
  const [from, to] = sine < 1e-9 ? [1 - u, u] : [Math.sin((1 - u) * angle) / sine, Math.sin(u * angle) / sine];
  const sum = a.map((part, i) => part * from + b[i] * to);
  const norm = Math.hypot(...sum);
  return sum.map((part) => part / norm);
}

/** Null for opposite directions, which have no unique arc. */
function blendDirection(a, b, u) {
  const [from, to] = [normalize(a), normalize(b)];
  return dot(from, to) < -1 + 1e-9 ? null : scale(slerp(from, to, u), mix(length(a), length(b), u));
}

function blendCamera(a, b, u) {
  const [from, to] = [rigFromCamera(a), rigFromCamera(b)];
  const cosine = from.orientation.reduce((sum, part, i) => sum + part * to.orientation[i], 0);
  const nearer = cosine < 0 ? to.orientation.map((part) => -part) : to.orientation; // the same rotation by the shorter arc
  const moved = cameraFromRig({
    target: blendAny(a.target, b.target, u), distance: mixLog(from.distance, to.distance, u),
    orientation: slerp(from.orientation, nearer, u),
  });
  return { ...a, ...moved, fov_y: mix(a.fov_y, b.fov_y, u), height: mixLog(a.height, b.height, u), near: mixLog(a.near, b.near, u) };
}

/** Evaluates a list of points with rising `key` at x: linear between points, constant outside. */
function sample(points, key, x) {
  const next = points.findIndex((point) => point[key] >= x);
  if (next < 0) return points.at(-1);
  if (next === 0 || points[next][key] === x) return points[next];
  const [left, right] = [points[next - 1], points[next]];
  return blendAny(left, right, (x - left[key]) / (right[key] - left[key]));
}

/** Blends two such lists; `none` replaces an empty one. */
function blendCurves(a, b, key, u, none) {
  const at = (points, x) => (points.length ? sample(points, key, x) : none);
  const places = [...new Set([...a, ...b].map((point) => point[key]))].sort((x, y) => x - y);
  return places.map((x) => ({ ...blendAny(at(a, x), at(b, x), u), [key]: x }));
}

const RULES = {
  camera: blendCamera,
  transfer_function: (a, b, u) => ({
    ...blendAny(a, b, u), points: blendCurves(a.points, b.points, 'value', u),
    gradient: blendCurves(a.gradient ?? [], b.gradient ?? [], 'magnitude', u, { scale: 1 }),
  }),
  filter: (a, b, u) => {
    const isAutomatic = ({ c_max: limit }) => typeof limit !== 'number';
    const blended = blendAny(a, b, u);
    return isAutomatic(a) === isAutomatic(b) ? blended : { ...blended, c_min: a.c_min };
  },
  compositing: (a, b, u) => {
    const blended = blendAny(a, b, u);
    if (a.mode !== b.mode) return { ...a, slab: blended.slab };
    const isSameUnit = (typeof a.absorption === 'number') === (typeof b.absorption === 'number');
    return isSameUnit || !('window' in a) ? blended : { ...blended, window: a.window };
  },
  shading: (a, b, u) => {
    const blended = blendAny(a, b, u);
    for (const name of ['occlusion', 'shadow']) { // not from or to 0: the frames between may be of a mode that draws neither
      if (name in a && !(a[name] > 0 && b[name] > 0)) blended[name] = a[name];
    }
    if (a.lights?.length !== b.lights?.length) return blended;
    return { ...blended, lights: a.lights?.map((light, i) => ({
      ...blended.lights[i],
      direction: (light.space === b.lights[i].space && blendDirection(light.direction, b.lights[i].direction, u)) || light.direction,
    })) };
  },
  clip: (a, b, u) => {
    const blended = blendAny(a, b, u);
    if (a.planes.length !== b.planes.length) return blended;
    return { ...blended, planes: a.planes.map((plane, i) => {
      const normal = blendDirection(plane.normal, b.planes[i].normal, u);
      return normal ? { normal, offset: mix(plane.offset, b.planes[i].offset, u) } : plane;
    }) };
  },
  slices: (a, b, u) => ({ ...blendAny(a, b, u), normal: blendDirection(a.normal, b.normal, u) || a.normal }),
  layers: (a, b, u) => {
    const isAlike = a.length === b.length && a.every((layer, i) => layer.type === b[i].type);
    return isAlike ? a.map((layer, i) => ({
      ...blendAny(layer, b[i], u), visible: layer.visible, ...(layer.transform ? { transform: blendTransform(layer.transform, b[i].transform, u) } : {}),
    })) : a;
  },
  edits: (a) => a,
  quality: (a) => a,
};

/** Blends two views of one volume; the size comes from the first. */
export function blendViews(a, b, u) {
  if (u <= 0) return a;
  if (u >= 1) return { ...b, size: a.size };
  return Object.fromEntries(Object.entries(a).map(([name, part]) => {
    const isConstant = name === 'size' || JSON.stringify(part) === JSON.stringify(b[name]);
    return [name, isConstant ? part : (RULES[name] ?? blendAny)(part, b[name], u)];
  }));
}
