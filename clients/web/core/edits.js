// SPDX-License-Identifier: Apache-2.0
// Edits of a view: cuts by planes, boxes and spheres, and connected parts that are kept or removed. An edit is an entry of `edits`
// in the view (protocol/view.schema.json). No function changes its arguments.
import { layersOf } from './layers.js';
import { opacityAt } from './transfer.js';
import { dot, length, scale } from './vector.js';

const EDITS_MAX = 32;
/** Opacity from which matter counts as visible if the view has no shell. */
const VISIBLE = 0.05;
const BOX = Object.freeze([[0.25, 0.25, 0.25], [0.75, 0.75, 0.75]]);

export const editsOf = (view) => view?.edits ?? [];
export const canAddEdits = (edits, count = 1) => edits.length + count <= EDITS_MAX;

/** A value of a number or of a list, without the last digits that the daemon may write in another way. */
const plain = (_, value) => (typeof value === 'number' ? Number(value.toPrecision(12)) : value);
const textOf = (edits) => JSON.stringify(edits.map((edit) => Object.entries({ keep: edit.type === 'plane' ? undefined : 'outside', ...edit }).sort(([a], [b]) => (a < b ? -1 : 1))), plain);

/** True if two lists are the same but for rounding. */
export const isSameEdits = (a, b) => a === b || (a.length === b.length && textOf(a) === textOf(b));

/** Changes fields of an edit. */
export const changeEdit = (edits, index, change) => edits.map((edit, i) => (i === index ? { ...edit, ...change } : edit));
export const removeEdit = (edits, index) => edits.filter((_, i) => i !== index);

export const boxEdit = () => ({ type: 'box', keep: 'outside', box: BOX.map((corner) => [...corner]) });
export const sphereEdit = (center, radius) => ({ type: 'sphere', keep: 'outside', center, radius });
export const partEdit = (point, range, keep) => ({ type: 'part', keep, point, range });

/** The plane through a point that removes the side of the viewer, who looks along `direction`. */
export const planeEdit = (point, direction) => {
  const normal = scale(direction, 1 / length(direction));
  return { type: 'plane', normal, offset: dot(normal, point) };
};

/** The cuts that remove what the clip hides: its planes, and its box if it is not whole. */
export function editsOfClip(clip) {
  const { box, planes = [] } = clip ?? {};
  const isWhole = !box || (box[0].every((part) => part <= 0) && box[1].every((part) => part >= 1));
  return [...planes.map(({ normal, offset }) => ({ type: 'plane', normal, offset })), ...(isWhole ? [] : [{ type: 'box', keep: 'inside', box }])];
}

/**
 * The range of values around `value` in which the opacity of these points is at least `least`, within [low, high]. Where the value itself is
 * less opaque, matter half as opaque counts; where it has no opacity, all that is above it.
 */
export function rangeAround(points, value, least, [low, high]) {
  const own = opacityAt(points, value);
  const wanted = Math.min(least, own / 2);
  if (!(own > 0)) return [value, Math.max(value, high)];
  const end = (way) => {
    const ahead = points.filter((point) => (point.value - value) * way > 0).sort((a, b) => (a.value - b.value) * way);
    let last = { value, opacity: own };
    for (const point of ahead) {
      if (point.opacity < wanted) return last.value + (point.value - last.value) * (last.opacity - wanted) / (last.opacity - point.opacity);
      last = point;
    }
    return way < 0 ? Math.min(low, value) : Math.max(high, value);
  };
  return [Math.max(end(-1), Math.min(low, value)), Math.min(end(1), Math.max(high, value))];
}

/**
 * The range of the values of the part at a place with this value, as the view shows it: on a surface, its value and all above; else what is
 * as visible as the shell's faintest voxels. `range`: of the values of the volume.
 */
export function rangeOfPart(view, value, range) {
  const shown = layersOf(view).filter(({ visible = true }) => visible);
  const isOn = (layer) => layer.type === 'surface' && Math.abs(layer.value - value) <= 1e-3 * (range[1] - range[0]);
  const surface = shown.find(isOn);
  const others = shown.filter(({ type }) => type !== 'surface');
  // Below all surfaces, or without the volume, a surface is what was picked.
  if (surface || others.length === 0) return [surface?.value ?? value, Math.max(range[1], value)];
  const least = others.find(({ type }) => type === 'shell')?.low ?? VISIBLE;
  return rangeAround(view.transfer_function.points, value, least, range);
}
