// SPDX-License-Identifier: Apache-2.0
// The rendering choices of the page, by their JSON pointers in the view: their defaults, which of them have an effect beside
// the others, and which fields must change together so that the daemon accepts a change.

import { hasChannels, layersOf, showVolumeAlone, showsOthers } from './layers.js';
import { isProjection, isGrey } from './projection.js';

const DEFAULTS = Object.freeze({
  '/filter/mode': 'adaptive',
  '/filter/kernel': 'gaussian',
  '/filter/sigma': 0.7,
  '/filter/cutoff': 3,
  '/filter/lowpass': 1,
  '/compositing/mode': 'sheet',
  '/compositing/attenuation': 'exponential',
  '/compositing/slab': 1,
  '/compositing/colors': 'grey',
  '/compositing/zero': null, // the smallest value
  '/compositing/absorption': null, // the sum itself
  '/transfer_function/order': 'auto',
  '/shading/smoothing': null, // as the noise of the volume needs
  '/shading/occlusion': 0,
  '/shading/shadow': 0,
});

export const isChoice = (pointer) => Object.hasOwn(DEFAULTS, pointer);

const names = (pointer) => pointer.slice(1).split('/');

/** The value of a choice in the view, or the protocol's default. */
export function valueAt(view, pointer) {
  return names(pointer).reduce((part, name) => part?.[name], view) ?? DEFAULTS[pointer];
}

const patchAt = (pointer, value) => names(pointer).reduceRight((inner, name) => ({ [name]: inner }), value);

const SUMS = ['/compositing/zero', '/compositing/absorption'];

/** False for a value that the daemon refuses beside the channels of the view. */
export const allows = (view, pointer, value) => !hasChannels(layersOf(view))
  || !((pointer === '/compositing/mode' && value === 'splat') || (pointer === '/transfer_function/order' && value === 'pre'));

/** True if the choice affects the image beside the others. The daemon stores and ignores a choice without effect. */
export function matters(view, pointer) {
  if (isProjection(view)) {
    const isSum = view.compositing.mode === 'sum';
    return pointer === '/compositing/mode' || (pointer === '/compositing/colors' && !isSum) || (SUMS.includes(pointer) && isSum);
  }
  const mode = valueAt(view, '/filter/mode');
  const isLit = view.shading?.mode !== 'none';
  const compositing = valueAt(view, '/compositing/mode');
  const order = valueAt(view, '/transfer_function/order');
  const isInterpolated = compositing === 'sheet' && order === 'post';
  if (isInterpolated && pointer.startsWith('/filter/')) return false;
  const isFiltered = Object.keys(DEFAULTS).some((name) => name.startsWith('/filter/') && valueAt(view, name) !== DEFAULTS[name]);
  switch (pointer) {
    case '/shading/smoothing': return isLit && order !== 'pre' && compositing !== 'splat' && !(isFiltered && (order === 'auto' || compositing === 'slab'));
    case '/shading/occlusion':
    case '/shading/shadow': return isLit && !hasChannels(layersOf(view));
    case '/filter/kernel': return mode !== 'none';
    case '/filter/sigma':
    case '/filter/cutoff': return mode !== 'none' && valueAt(view, '/filter/kernel') === 'gaussian';
    case '/filter/lowpass': return mode !== 'none' && mode !== 'reconstruction';
    case '/compositing/colors':
    case '/compositing/zero':
    case '/compositing/absorption': return false;
    case '/compositing/slab': return compositing === 'slab';
    default: return true;
  }
}

const OCCLUSIONS = ['/shading/occlusion', '/shading/shadow'];

/** The merge patch for a choice. Single splats and post-classification exclude each other, ambient occlusion and shadows need sheets
    that are classified by pixel, and a projection shows the volume alone: the newer choice wins. */
export function choose(view, pointer, value) {
  const patch = patchAt(pointer, value);
  if (OCCLUSIONS.includes(pointer) && value > 0) {
    return { ...patch, ...patchAt('/compositing/mode', 'sheet'), ...patchAt('/transfer_function/order', 'auto') };
  }
  // Every projection has a window of its own, and a sum is not in the unit of the transfer function.
  if (pointer === '/compositing/mode' && isProjection({ compositing: { mode: value } })) {
    const layers = layersOf(view);
    const before = valueAt(view, '/compositing/colors');
    const isMixed = hasChannels(layers) && (!isProjection(view) || view.compositing.mode === 'sum'); // in grey, channels cannot be told apart
    const colors = value === 'sum' ? 'grey' : isMixed ? 'transfer_function' : before;
    return {
      compositing: { mode: value, window: null, ...(colors === before ? {} : { colors }) }, ...(showsOthers(layers) ? { layers: showVolumeAlone(layers) } : {}),
    };
  }
  // The window of a sum is in the unit of the sum, or a share.
  if (pointer === '/compositing/absorption' && (value === null) !== (valueAt(view, pointer) === null)) {
    return { compositing: { absorption: value, window: null } };
  }
  const isOccluded = OCCLUSIONS.some((other) => valueAt(view, other) > 0);
  if (isOccluded && ((pointer === '/compositing/mode' && value !== 'sheet') || (pointer === '/transfer_function/order' && value === 'pre'))) {
    const plain = choose({ ...view, shading: { ...view.shading, occlusion: 0, shadow: 0 } }, pointer, value);
    return { ...plain, shading: { occlusion: 0, shadow: 0 } };
  }
  if (pointer === '/transfer_function/order' && value === 'post' && valueAt(view, '/compositing/mode') === 'splat') {
    return { ...patch, ...patchAt('/compositing/mode', 'sheet') };
  }
  if (pointer === '/compositing/mode' && value === 'splat' && valueAt(view, '/transfer_function/order') === 'post') {
    return { ...patch, ...patchAt('/transfer_function/order', 'auto') };
  }
  return patch;
}

/** The merge patch for a way to show the picture (core/projection.js). */
export function chooseShown(view, { mode, center, width }) {
  const patch = mode === valueAt(view, '/compositing/mode') ? {} : choose(view, '/compositing/mode', mode);
  return { ...patch, compositing: { ...patch.compositing, window: { center, width } } };
}

/** The gradient axis that fades regions in which the value changes by less than `magnitude` per world unit; 0 hides nothing. */
export const hideFlat = (magnitude) => (magnitude > 0
  ? [{ magnitude: 0, scale: 0 }, { magnitude, scale: 1 }] : []);

/** The inverse of hideFlat(): the magnitude, 0 without a gradient axis, or null for another gradient axis. */
export function flatLimit(gradient = []) {
  if (gradient.length === 0) return 0;
  const [first, second] = gradient;
  const isOurs = gradient.length === 2 && first.magnitude === 0 && first.scale === 0 && second.scale === 1;
  return isOurs ? second.magnitude : null;
}

/** The largest gradient magnitude that central differences of the volume's samples can have along one axis. */
export const steepest = ({ range: [low, high], spacing }) => (high - low) / (2 * Math.min(...spacing));

/** Types of layers with colours of their own. */
const OWN_COLORS = ['surface', 'gaussians', 'geometry', 'channel'];

/** Why the transfer function has no effect on the picture: 'grey' (a projection), 'surfaces' (nothing else is shown), or null. */
export function whyIdle(view) {
  if (isGrey(view)) return 'grey';
  return layersOf(view).every(({ type, visible = true }) => OWN_COLORS.includes(type) || !visible) ? 'surfaces' : null;
}
