// SPDX-License-Identifier: Apache-2.0
// Channels: other volumes on the grid of the view's volume, such as the other fields of a microscope's file, each with points of its own
// (core/transfer.js). Nothing here changes its arguments.
import { backgroundEnd, percentile } from './histogram.js';
import { kindOf } from './kinds.js';
import { hasChannels, isChannel, isBelowLimit } from './layers.js';
import { EXTENT_MIN, OPACITY_MAX, tidy } from './transfer.js';

/** Channels beside the volume. */
export const CHANNELS_MAX = 7;
/** Points that the protocol allows for each. */
export const CHANNEL_POINTS_MAX = 32;
/** The colours of microscopists, from the first channel on. */
export const COLORS = Object.freeze([[0, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 0], [1, 0, 0], [0, 0.35, 1], [1, 1, 1], [1, 0.5, 0]]);
/** The opacity at the upper end of a new window: full brightness, because the window leaves the background out. */
export const OPACITY = 0.95;

const gridOf = ({ dims, spacing, coordinates, origin, direction, whole }) => JSON.stringify([whole?.dims ?? dims, whole?.spacing ?? spacing, coordinates, origin, direction]);

/** True if two volumes of the list have the same grid, which channels need. */
export const isSameGrid = (a, b) => gridOf(a) === gridOf(b);

const isColor = (a, b) => a.every((part, i) => Math.abs(part - b[i]) < 0.02);

/** The next colour that none of `used` is. */
export const nextColor = (used) => COLORS.find((color) => !used.some((other) => isColor(color, other))) ?? COLORS.at(-1);

const NAMED = { red: [1, 0, 0], green: [0, 1, 0], blue: [0, 0, 1], cyan: [0, 1, 1], magenta: [1, 0, 1], yellow: [1, 1, 0], white: [1, 1, 1] };
const PRIMARIES = ['red', 'green', 'blue'];
const lastWord = (name) => name.toLowerCase().split(/[^a-z]+/).at(-1);

/** The colours of new channels: a name that ends in a colour, such as "rgb red", gets it, and the others the next that none of `used` is. */
export function colorsFor(names, used) {
  const named = names.map((name) => NAMED[lastWord(name)] ?? null);
  const taken = [...used, ...named.filter(Boolean)];
  return named.map((color) => {
    if (color) return color;
    taken.push(nextColor(taken));
    return taken.at(-1);
  });
}

/** True if red, green and blue are among the names. */
export const isRgb = (names) => PRIMARIES.every((color) => names.some((name) => lastWord(name) === color));

/** Fields that are shown together: all but the opacity of a picture in colours, which would veil it. own: the name of the volume's field. */
export const shownTogether = (own, fields) => (isRgb([own, ...fields]) ? fields.filter((name) => lastWord(name) !== 'alpha') : fields);

/** The windows of new channels, null = unknown. Red, green and blue of one picture share a window, or else its hues would change. */
export function windowsFor(names, windows) {
  if (!isRgb(names)) return windows;
  const isPart = (i) => PRIMARIES.includes(lastWord(names[i]));
  const known = windows.filter((window, i) => window && isPart(i));
  const all = known.length ? [Math.min(...known.map(([low]) => low)), Math.max(...known.map(([, high]) => high))] : null;
  return windows.map((window, i) => (isPart(i) ? all : window));
}

/** Points of one colour from transparent at `low` to an opacity at `high`. */
export const rampOf = ([low, high], color, /** @type {number} */ opacity = OPACITY) => tidy([
  { value: low, color, opacity: 0 }, { value: Math.max(high, low + EXTENT_MIN, low + Math.abs(low) * 1e-8), color, opacity },
]);

const BRIGHTEST = 0.999; // of the signal lies below the upper end of a new window

/** The window [low, high] of a new channel: the signal above the peak of the background. Without a histogram, or without a background: `usual`. */
export function signalWindow(histogram, usual) {
  const low = histogram ? backgroundEnd(histogram) : null;
  const high = low === null ? null : percentile(histogram, BRIGHTEST, low);
  return high > low && low < histogram.range[1] ? [low, high] : usual;
}

/** The window of points: the values of the first and of the last one. */
export const windowOf = (points) => [points[0].value, points.at(-1).value];

/** The points with another window. Its width stays above 0; a single point becomes a ramp. */
export function moveWindow(points, [low, high], gap) {
  const [from, to] = windowOf(points);
  const width = Math.max(high - low, gap);
  if (!(to > from)) return rampOf([low, low + width], points[0].color, points[0].opacity);
  return tidy(points.map((p) => ({ ...p, value: low + ((p.value - from) / (to - from)) * width })));
}

/** Moves one end of the window, which pushes the other one. end: 0 (low) or 1 (high). */
export function moveEnd(points, end, value, gap) {
  const [low, high] = windowOf(points);
  return moveWindow(points, end === 0 ? [value, Math.max(high, value + gap)] : [Math.min(low, value - gap), value], gap);
}

/** The colour of points is the colour of the last point. */
export const colorOf = (points) => points.at(-1).color;
export const paint = (points, color) => points.map((p) => ({ ...p, color }));

/** The largest opacity of points. */
export const opacityOf = (points) => Math.max(...points.map(({ opacity }) => opacity));

/** The points with another largest opacity. */
export function fade(points, opacity) {
  const most = opacityOf(points);
  const held = Math.min(OPACITY_MAX, Math.max(0.001, opacity)); // 0 would lose the shape
  return tidy(most > 0 ? points.map((p) => ({ ...p, opacity: p.opacity * (held / most) }))
    : points.map((p, i) => ({ ...p, opacity: i === points.length - 1 ? held : 0 })));
}

/** Adds channels, pairs {id, points}, to the layers. Leaves out channels beyond the limit of a view. */
export const addChannels = (layers, channels) => channels.reduce((list, { id, points }) => (
  isBelowLimit(list) ? [...list, { type: 'channel', visible: true, id, color: colorOf(points), points }] : list), layers);

/** How many more channels the layers may have. */
export const channelsLeft = (layers) => {
  const others = layers.filter((layer) => !isChannel(layer)).length;
  return Math.max(0, CHANNELS_MAX + 1 - Math.max(1, others) - layers.filter(isChannel).length);
};

/**
 * The other fields that the file of a volume has, and volumes of the list on its grid, none of which is a channel: [{field}, …, {volume}, …].
 * fieldOf(volume): the name of its values. A field that is a volume of the list is not named twice.
 */
export function channelSources(volume, volumes, layers) {
  const used = layers.filter(isChannel).map(({ id }) => id);
  const find = (id) => volumes.find((other) => other.id === id);
  const fileOf = ({ source = '' }) => source.replace(/\?.*$/, '');
  const fieldOf = (other) => other?.fields?.[0]?.name ?? '';
  const isFree = (other) => other.id !== volume.id && other.state === 'ready' && kindOf(other) === 'grid' && !used.includes(other.id);
  const ofFile = (other) => fileOf(other) === fileOf(volume) && (volume.other_fields ?? []).includes(fieldOf(other));
  const taken = used.map(find).filter((other) => other && ofFile(other)).map(fieldOf);
  const fields = (volume.other_fields ?? []).filter((name) => !taken.includes(name));
  return [
    ...fields.map((field) => ({ field })),
    ...volumes.filter((other) => isFree(other) && !ofFile(other) && isSameGrid(other, volume)).map((other) => ({ volume: other })),
  ];
}

/** What must change with layers that begin to have channels: {order}, {colors}, both, or nothing, as a patch; null = nothing. */
export function patchForChannels(view, before, after) {
  if (hasChannels(before) || !hasChannels(after)) return null;
  const { mode = 'sheet', colors = 'grey' } = view.compositing ?? {};
  const patch = {};
  if (['maximum', 'minimum', 'mean'].includes(mode) && colors === 'grey') patch.compositing = { colors: 'transfer_function' };
  if (view.transfer_function?.order === 'pre') patch.transfer_function = { order: 'auto' };
  return Object.keys(patch).length ? patch : null;
}

/** Why the view cannot have channels: 'parts' (edits by values), or null. */
export const whyNoChannels = (view) => ((view.edits ?? []).some(({ type }) => type === 'part') ? 'parts' : null);
