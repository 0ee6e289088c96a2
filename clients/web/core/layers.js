// SPDX-License-Identifier: Apache-2.0
// The layers of a view: the volume, surfaces of one value each, a shell at the borders of opacity, streaks along vectors, and the elements
// of this volume or of other ones. Nothing here changes its arguments.
import { threshold } from './histogram.js';
import { IDENTITY } from './placement.js';

const LAYERS_MAX = 8;
/** Opacity of a surface around another one. */
export const VEIL = 0.35;
/** From this flatness on, the slider says that kernels are discs. */
export const FLATNESS_MAX = 32;

const VOLUME = Object.freeze({ type: 'volume', visible: true });
const SHELL = Object.freeze({ type: 'shell', visible: true, low: 0.05, high: 0.95, detail: 'high' });
const OPAQUE_SHARE = 0.9; // of the largest opacity
const OPAQUE_LEAST = 0.4; // of a transfer function that shows opaque matter
/** color_by of a layer: the lengths of the vectors give the colours. */
export const MAGNITUDE = 'magnitude';
const OWN_COLORS = Object.freeze({ color_by: '', color_low: null, color_high: null });
const VECTORS = Object.freeze({ type: 'vectors', visible: true, style: 'modulate', color: [0.9, 0.85, 0.75], phase: 0, stretch: 4, ...OWN_COLORS });
const DENSITY_MAX = 0.2;
const SAMPLES_DEEP = 20; // along the longest axis of the grid
/** Colours of surfaces, told apart by people with any colour vision; the first one is the daemon's default. */
const COLORS = Object.freeze([[0.9, 0.85, 0.75], [0.9, 0.4, 0.3], [0.4, 0.65, 0.9], [0.95, 0.75, 0.3], [0.45, 0.75, 0.55], [0.75, 0.5, 0.75], [0.55, 0.6, 0.65]]);

/** The fields of layers of elements, beside their volume and its place. */
const ELEMENTS = Object.freeze({
  points: { size: 1, ...OWN_COLORS },
  gaussians: { opacity: 1, convention: 'inria' },
  geometry: { color: COLORS[0], opacity: 1, colors: 'own' },
});

/** True for a layer of points, Gaussians or triangles. */
export const isOfElements = ({ type }) => Object.hasOwn(ELEMENTS, type);

/** The layers of a view. The view of an old daemon has none and shows the volume alone. */
export const layersOf = (view) => view?.layers ?? [VOLUME];

/** The ids of the volumes that a view names: the volume of the view, and the volumes of its layers. */
export const volumesOf = (view) => [view.volume, ...layersOf(view).flatMap(({ id, color_by: colors }) => [id, colors === MAGNITUDE ? '' : colors])].filter(Boolean);

/** True if the image shows the volume itself. */
export const showsVolume = (layers) => layers.some(({ type, visible = true }) => type === 'volume' && visible);

const near = (a, b) => a === b || (typeof a === 'number' && typeof b === 'number' && Math.abs(a - b) <= 1e-6 * Math.max(1e-6, Math.abs(a), Math.abs(b)));
const isNearAll = (a, b) => [...new Set([...Object.keys(a), ...Object.keys(b)])].every((name) => isNear(a[name], b[name]));
const isNear = (a, b) => (a && b && typeof a === 'object' && typeof b === 'object' ? isNearAll(a, b) : near(a, b));

/** True if two lists are the same but for rounding. */
export const isSameLayers = (a, b) => a.length === b.length && a.every((layer, i) => isNearAll(layer, b[i]));

/** The layers without the phase of their streaks, which moves by itself. */
export const withoutPhase = (layers) => layers.map(({ phase, ...layer }) => layer);

/** True if a volume of the list has a vector per sample. */
export const hasVectors = (volume) => Boolean(volume?.fields?.some(({ components }) => components === 3));

/** Shows or hides the volume; a view without one gets it. */
export function showVolume(layers, visible) {
  if (layers.some(({ type }) => type === 'volume')) return layers.map((layer) => (layer.type === 'volume' ? { ...layer, visible } : layer));
  return visible ? [VOLUME, ...layers] : layers;
}

/** True for a layer that is mixed with the volume. */
export const isChannel = ({ type }) => type === 'channel';

/** True if the image shows a channel. */
export const hasChannels = (layers) => layers.some((layer) => isChannel(layer) && layer.visible !== false);

const isVolume = (layer) => layer.type === 'volume' || isChannel(layer);

/** True if the image shows a layer that is neither the volume nor a channel. */
export const showsOthers = (layers) => layers.some((layer) => !isVolume(layer) && layer.visible !== false);

/** Shows the volume and its channels, and hides all other layers. Without channels, a hidden volume becomes visible. */
export const showVolumeAlone = (layers) => (hasChannels(layers) ? layers : showVolume(layers, true)).map((layer) => (isVolume(layer) ? layer : { ...layer, visible: false }));

/** Changes fields of a layer. */
export const changeLayer = (layers, index, change) => layers.map((layer, i) => (i === index ? { ...layer, ...change } : layer));

const showsAny = (layers) => layers.some(({ visible = true }) => visible);

/** Shows or hides the elements of the view's volume. */
export const showOwn = (layers, visible) => layers.map((layer) => (isOfElements(layer) && !layer.id ? { ...layer, visible } : layer));

/** Removes a layer. A view has at least one; without any other the volume becomes visible. own: the type of the layer that shows it. */
export function removeLayer(layers, index, own = VOLUME.type) {
  const left = layers.filter((_, i) => i !== index);
  if (own !== VOLUME.type) return left.length === 0 ? addElements([], own) : showsAny(left) ? left : showOwn(left, true);
  return left.some(({ type }) => type !== 'volume') ? left : [VOLUME];
}

/** The largest value at and below which the points give no opacity; -Infinity if there is none. */
function lastHidden(points) {
  const first = points.findIndex(({ opacity }) => opacity > 0);
  return first > 0 ? points[first - 1].value : -Infinity;
}

/**
 * The value of a new surface. The first one encloses what is visible: halfway from where the transfer function of these points begins to the
 * threshold between background and object. Further ones are the threshold among what lies above the others.
 */
export function surfaceValue(layers, points, histogram, [low, high]) {
  const taken = layers.filter(({ type }) => type === 'surface').map(({ value }) => value);
  const most = Math.max(low, ...taken.filter((value) => value < high));
  if (!histogram) return (most + high) / 2;
  const width = (histogram.range[1] - histogram.range[0]) / histogram.counts.length;
  const skipped = taken.length ? Math.min(histogram.counts.length, Math.max(0, Math.ceil((most - histogram.range[0]) / width))) : 0;
  const rest = { range: [histogram.range[0] + width * skipped, histogram.range[1]], counts: histogram.counts.slice(skipped) };
  if (rest.counts.filter((count) => count > 0).length < 3) return (low + Math.min(high, ...taken.filter((value) => value > low))) / 2; // below the others
  const cut = threshold(rest);
  const hidden = Math.max(low, lastHidden(points));
  return taken.length || hidden >= cut ? cut : (hidden + cut) / 2;
}

const nextColor = (layers) => {
  const used = layers.filter(({ type }) => type === 'surface').map(({ color }) => color);
  return COLORS.find((color) => !used.some((other) => other?.every((part, i) => near(part, color[i])))) ?? COLORS[used.length % COLORS.length];
};

/** A place in the list: the first layer of the same samples replaces the picture of the volume, because it would be hidden in it. A mixture of
    channels stays. */
const makeRoom = (layers) => (showsOthers(layers.filter((layer) => !isOfElements(layer))) || hasChannels(layers) ? layers : showVolume(layers, false));

/** Adds a surface. Opaque surfaces around it become a veil, because they would hide it. */
export function addSurface(layers, value) {
  const isVeil = (layer) => layer.type === 'surface' && layer.value < value && layer.opacity === 1;
  const isAround = layers.some((layer) => layer.type === 'surface' && layer.value > value);
  const surface = { type: 'surface', visible: true, value, color: nextColor(layers), opacity: isAround ? VEIL : 1, flatness: 'inf' };
  return [...makeRoom(layers).map((layer) => (isVeil(layer) ? { ...layer, opacity: VEIL } : layer)), surface];
}

/**
 * Adds the shell of a transfer function with these points: of all that is visible, and hollow where it is nearly as opaque as it gets. A
 * translucent transfer function gets no opaque voxels, which would show the noise of its largest opacities.
 */
export function addShell(layers, points) {
  const most = Math.max(0, ...points.map(({ opacity }) => opacity));
  const round = (value) => Number(value.toPrecision(2));
  return [...makeRoom(layers), { ...SHELL, low: round(Math.min(SHELL.low, most / 4)), high: most < OPAQUE_LEAST ? SHELL.high : round(Math.min(SHELL.high, most * OPAQUE_SHARE)) }];
}

/** Adds streaks along the vectors of a volume: as many that single ones can be told apart, whatever the size of the grid or the number of points. */
export function addVectors(layers, { dims, elements }) {
  const deep = elements?.count ? Math.cbrt(elements.count) : Math.max(...dims);
  const density = Number(Math.min(DENSITY_MAX, SAMPLES_DEEP / deep).toPrecision(2));
  return [...makeRoom(showOwn(layers, false)), { ...VECTORS, density }];
}

/** Adds a layer of elements: of the volume with this id, or of the view's volume. What the picture shows stays. */
export const addElements = (layers, type, id = '', transform = IDENTITY) => [...layers, { type, visible: true, id, transform: [...transform], ...ELEMENTS[type] }];

export const isBelowLimit = (layers) => layers.length < LAYERS_MAX;

/** There may be several surfaces and layers of elements, and one layer of each other type. */
export const canAdd = (layers, type) => isBelowLimit(layers) && (type === 'surface' || isOfElements({ type }) || !layers.some((layer) => layer.type === type));

/** Moves a threshold of a shell; it pushes the other one. name: low or high. */
export function moveThreshold(layer, name, value) {
  const held = Math.min(1, Math.max(0, value));
  const other = name === 'low' ? { high: Math.max(layer.high, held) } : { low: Math.min(layer.low, held) };
  return { [name]: held, ...other };
}

/** The number of a surface in its name, from 1. */
export const numberOf = (layers, index) => layers.slice(0, index + 1).filter(({ type }) => type === 'surface').length;
