// SPDX-License-Identifier: Apache-2.0
// The choices of how a picture is made, by their JSON pointers in the view: what they default to, which of them matter beside
// the others, and what else a change has to change so that the daemon takes it.

const DEFAULTS = Object.freeze({
  '/filter/mode': 'adaptive',
  '/filter/kernel': 'gaussian',
  '/filter/sigma': 0.7,
  '/filter/cutoff': 3,
  '/filter/lowpass': 1,
  '/compositing/mode': 'sheet',
  '/compositing/attenuation': 'exponential',
  '/compositing/slab': 1,
  '/transfer_function/order': 'pre',
});

export const isChoice = (pointer) => Object.hasOwn(DEFAULTS, pointer);

const names = (pointer) => pointer.slice(1).split('/');

/** What the view says at a choice's pointer; the protocol's default where it says nothing. */
export function valueAt(view, pointer) {
  return names(pointer).reduce((part, name) => part?.[name], view) ?? DEFAULTS[pointer];
}

const patchAt = (pointer, value) => names(pointer).reduceRight((inner, name) => ({ [name]: inner }), value);

/** Does the choice change the picture, given the others? Where it does not, the daemon keeps and ignores it. */
export function matters(view, pointer) {
  const mode = valueAt(view, '/filter/mode');
  switch (pointer) {
    case '/filter/kernel': return mode !== 'none';
    case '/filter/sigma':
    case '/filter/cutoff': return mode !== 'none' && valueAt(view, '/filter/kernel') === 'gaussian';
    case '/filter/lowpass': return mode !== 'none' && mode !== 'reconstruction';
    case '/compositing/slab': return valueAt(view, '/compositing/mode') === 'slab';
    default: return true;
  }
}

/** The merge patch that makes a choice, with what it needs: classification after interpolation and slabs come and go together. */
export function choose(view, pointer, value) {
  const patch = patchAt(pointer, value);
  if (pointer === '/transfer_function/order' && value === 'post') {
    return { ...patch, ...patchAt('/compositing/mode', 'slab') };
  }
  if (pointer === '/compositing/mode' && value !== 'slab' && valueAt(view, '/transfer_function/order') === 'post') {
    return { ...patch, ...patchAt('/transfer_function/order', 'pre') };
  }
  return patch;
}

/** The gradient axis that hides what changes by less than `magnitude` a world unit, the less the more; 0 hides nothing. */
export const hideFlat = (magnitude) => (magnitude > 0
  ? [{ magnitude: 0, scale: 0 }, { magnitude, scale: 1 }] : []);

/** The magnitude that gives this gradient axis, 0 without one, or null when hideFlat() does not make it. */
export function flatLimit(gradient = []) {
  if (gradient.length === 0) return 0;
  const [first, second] = gradient;
  const isOurs = gradient.length === 2 && first.magnitude === 0 && first.scale === 0 && second.scale === 1;
  return isOurs ? second.magnitude : null;
}

/** The largest magnitude along one axis that central differences of the volume's samples can have. */
export const steepest = ({ range: [low, high], spacing }) => (high - low) / (2 * Math.min(...spacing));
