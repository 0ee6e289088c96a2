// SPDX-License-Identifier: Apache-2.0
// A camera path in the editor: {keys, isLoop}, plain data that is never changed in place.
//
//   keys    [{view, seconds, ease, picture}]: each key is a complete view of the same volume. `seconds` and `ease` describe
//           the way from the key before; those of the first key apply to loops only. picture: an address, or null
//   frames  the first key is frame 0. The last key is the last frame; in a loop the path ends one frame before the first
//           key, so that no frame is shown twice
import { blendViews } from './blend.js';
import { patchBetween } from './merge.js';
import { add, axisAngle, dot, normalize, rotate, scale, subtract } from './vector.js';

export const EMPTY = Object.freeze({ keys: Object.freeze([]), isLoop: false });
/** The daemon accepts 256 keyframes after the first one. The way back of a loop is one of them. */
export const KEYS_MAX = 256;
export const SECONDS = Object.freeze({ least: 0.1, most: 3600, usual: 2 });

const hold = (seconds) => Math.min(SECONDS.most, Math.max(SECONDS.least, seconds));

export const keyOf = ({ view, picture = null }) => ({ view, seconds: SECONDS.usual, ease: 'linear', picture });

export const append = (path, ...keys) => ({ ...path, keys: [...path.keys, ...keys].slice(0, KEYS_MAX) });
export const remove = (path, i) => ({ ...path, keys: path.keys.filter((_, n) => n !== i) });
export const replace = (path, i, change) => ({ ...path, keys: path.keys.map((key, n) => (n === i ? { ...key, ...change } : key)) });

/** Swaps the views of the keys i and i + by; the times between positions stay. */
export function move(path, i, by) {
  const [a, b] = [path.keys[i], path.keys[i + by]];
  if (!a || !b) return path;
  return replace(replace(path, i, { view: b.view, picture: b.picture }), i + by, { view: a.view, picture: a.picture });
}

/** True if the path can be rendered. */
export const isWhole = ({ keys }) => keys.length >= 2;

/** The time of each key in seconds; for a loop also the time of the return to the first key. */
function times({ keys, isLoop }) {
  let time = 0;
  const all = keys.map(({ seconds }, i) => (i === 0 ? 0 : time += seconds));
  return isLoop && keys.length ? [...all, time + keys[0].seconds] : all;
}

export const lengthOf = (path) => times(path).at(-1) ?? 0;

/** The same motion, faster or slower. */
export function stretch(path, seconds) {
  const factor = seconds / lengthOf(path);
  if (!(factor > 0) || !Number.isFinite(factor)) return path;
  return { ...path, keys: path.keys.map((key) => ({ ...key, seconds: hold(key.seconds * factor) })) };
}

/** The frame number of the last key. Times are scaled so that the last key falls exactly on a frame. */
const lastFrame = (path, fps) => Math.max(1, Math.round(lengthOf(path) * fps));
export const framesOf = (path, fps) => lastFrame(path, fps) + (path.isLoop ? 0 : 1);

/** The view at each time of times(). */
const stops = ({ keys, isLoop }) => (isLoop && keys.length ? [...keys, keys[0]] : keys);
function places(path, fps) {
  const all = times(path);
  return all.map((time) => (time / all.at(-1)) * lastFrame(path, fps));
}

const eased = { linear: (u) => u, smooth: (u) => u * u * (3 - 2 * u), step: () => 0 };

/**
 * The path with a turn behind it: `keys` are those of a whole turn, the first with the view now, which the path may end with already. A turn
 * that is the whole path becomes a loop; otherwise it returns to its start, which may be that of the loop.
 */
export function appendTurn(path, [seen, ...turned]) {
  const isSame = (key) => JSON.stringify({ ...key?.view, size: null }) === JSON.stringify({ ...seen.view, size: null });
  const from = isSame(path.keys.at(-1)) ? path : append(path, seen);
  const isLoop = from.keys.length === 1 || path.isLoop;
  return { ...append(from, ...turned, ...(isLoop && isSame(from.keys[0]) ? [] : [seen])), isLoop };
}

/** The view of a frame, as the daemon renders it. */
export function viewAt(path, fps, frame) {
  const [at, keys] = [places(path, fps), stops(path)];
  const next = at.findIndex((place) => place > frame);
  if (next < 0) return keys.at(-1).view;
  const u = (frame - at[next - 1]) / (at[next] - at[next - 1]);
  return blendViews(keys[next - 1].view, keys[next].view, eased[keys[next].ease](u));
}

/** The time of a frame in seconds, for display. */
export const secondsAt = (path, fps, frame) => frame / lastFrame(path, fps) * lengthOf(path);

/**
 * The body of POST /paths. output: {size, fps, format, quality}. The keyframes omit members of the view that are equal in
 * all keys.
 */
export function requestOf(path, output) {
  const [at, keys] = [places(path, output.fps), stops(path)];
  const { size: _, ...first } = keys[0].view;
  const same = (name) => keys.every(({ view }) => JSON.stringify(view[name]) === JSON.stringify(first[name]));
  const moving = Object.keys(first).filter((name) => name !== 'volume' && !same(name));
  const patch = (before, view) => Object.fromEntries(moving.map((name) => {
    const part = view[name];
    return [name, Array.isArray(part) ? part : patchBetween(before[name], part)];
  }));
  return {
    view: first, ...output, frames: framesOf(path, output.fps),
    keyframes: keys.slice(1).map(({ view, ease }, i) => ({ frame: at[i + 1], ease, view: patch(keys[i].view, view) })),
  };
}

/** Maps a JSON pointer into that body to one into the path: the view is the first key, and so is the last key of a loop. */
export function pointerInto(path, pointer) {
  const [, number, rest] = /^\/keyframes\/(\d+)(.*)$/.exec(pointer) ?? [];
  if (number !== undefined) return `/keyframes/${(Number(number) + 1) % path.keys.length}${rest}`;
  return pointer === '/view' || pointer.startsWith('/view/') ? `/keyframes/0${pointer}` : pointer;
}

/** The half edge of the volume's box that is the most upright on the screen, pointing up. */
export function uprightAxis(camera, half) {
  const up = normalize(camera.up);
  const axes = half.map(normalize);
  const [best] = [...axes].sort((a, b) => Math.abs(dot(b, up)) - Math.abs(dot(a, up)));
  return dot(best, up) < 0 ? scale(best, -1) : best;
}

/**
 * A full turn of the camera about its target and an axis: one view per quarter, because the daemon interpolates along the
 * shorter arc. The last view would equal the first and is omitted.
 */
export function turnOf(view, axis) {
  const { camera } = view;
  const arm = subtract(camera.position, camera.target);
  return [0, 1, 2, 3].map((quarter) => {
    const turn = axisAngle(normalize(axis), quarter * Math.PI / 2);
    const turned = { position: add(camera.target, rotate(turn, arm)), up: rotate(turn, camera.up) };
    return quarter === 0 ? view : { ...view, camera: { ...camera, ...turned } };
  });
}
