// SPDX-License-Identifier: Apache-2.0
// What the colour bar of a view says: which colour stands for which value in the picture.
import { MAGNITUDE, layersOf, showsVolume } from './layers.js';
import { numberText, roundLength, roundValue, valueUnit } from './lengths.js';
import { isGrey, isProjection, projectionWindow } from './projection.js';
import { colorAt, opacityAt } from './transfer.js';

/** Types of layers that show values in the colours of the transfer function. */
const COLORED = ['volume', 'shell', 'vectors', 'points'];
const EDGE = 0.14; // share of the bar beside its ends without ticks
const STEPS = 3; // least number of steps between its ends

/** The least and the largest value in `range` that the points show; null if they show none. */
function visibleRange(points, [low, high]) {
  const values = [low, ...points.map(({ value }) => value).filter((value) => value > low && value < high), high];
  const seen = values.map((value) => opacityAt(points, value) > 0);
  const first = seen.indexOf(true);
  const last = seen.lastIndexOf(true);
  return first < 0 ? null : [values[Math.max(0, first - 1)], values[Math.min(values.length - 1, last + 1)]];
}

/** The colours [{at, color, isHidden}] from at 0 to at 1; isHidden: the values up to the next one are not drawn. */
function colorsOf(points, [low, high]) {
  const values = [low, ...points.map(({ value }) => value).filter((value) => value > low && value < high), high];
  const opacities = values.map((value) => opacityAt(points, value));
  return values.map((value, i) => ({
    at: (value - low) / (high - low), color: colorAt(points, value), isHidden: i + 1 < values.length && opacities[i] === 0 && opacities[i + 1] === 0,
  }));
}

/** Round values between two others, as {at, text}. */
function ticksBetween([low, high]) {
  const step = roundLength((high - low) / STEPS);
  const ticks = [];
  for (let i = Math.ceil(low / step); i * step <= high && ticks.length < 16; i += 1) {
    const at = (i * step - low) / (high - low);
    if (at > EDGE && at < 1 - EDGE) ticks.push({ at, text: numberText(Number((i * step).toPrecision(6))) });
  }
  return ticks;
}

/** The layer whose values the picture shows in colours. */
const coloredLayer = (view) => layersOf(view).find(({ type, visible = true }) => visible && COLORED.includes(type));

/** The numbers that give the colours of a layer with color_by: {volume, field}, or null if they are not known. find(id): a volume. */
export function coloringField({ id, color_by: chosen }, find) {
  const isLength = chosen === MAGNITUDE;
  const volume = find(isLength ? id : chosen);
  const field = isLength ? volume?.fields?.find(({ components }) => components === 3) : volume?.fields?.[0];
  return field ? { volume, field } : null;
}

/** The bar of a layer whose colours come from other numbers: all colours, from the first point to the last one. */
function otherBar(layer, view, volumes) {
  const { color_low: low, color_high: high } = layer;
  const isLength = layer.color_by === MAGNITUDE;
  const numbers = coloringField(layer, (id) => volumes.find((volume) => volume.id === (id || view.volume)));
  const points = view.transfer_function?.points;
  if (!numbers || !points?.length) return null;
  const { field } = numbers;
  const range = [low ?? field.range[0], high ?? field.range[1]];
  if (!(range[1] > range[0])) return null;
  const ends = [points[0].value, points.at(-1).value];
  const colors = ends[1] > ends[0] ? colorsOf(points, ends) : [{ at: 0, color: points[0].color }, { at: 1, color: points[0].color }];
  const volume = { ...numbers.volume, fields: [field] };
  return { ...bar(colors.map((stop) => ({ ...stop, isHidden: false })), range, volume), name: isLength ? `${field.name} ${MAGNITUDE}`.trim() : field.name };
}

/** The description of the volume whose values the picture shows in colours; undefined without one, null if it is not known. */
function shownVolume(view, volumes) {
  const layer = coloredLayer(view);
  return layer && (volumes.find(({ id }) => id === (layer.id || view.volume)) ?? null);
}

function bar(colors, range, volume, projection = null) {
  const [low, high] = range;
  const ends = range.map((value, at) => ({ at, text: numberText(roundValue(value, range)) }));
  return {
    colors, low: ends[0].text, high: ends[1].text, ticks: [ends[0], ...(high > low ? ticksBetween(range) : []), ends[1]],
    name: volume?.fields?.[0]?.name ?? '', unit: volume ? valueUnit(volume) : '', projection,
  };
}

/**
 * {colors: [{at, color, isHidden}], ticks: [{at, text}], low, high, name, unit, projection}, or null if no colour of the picture stands for
 * a value. The first and the last tick are the ends; projection: its mode, or null. volumes: the list of the daemon; histogram: of the
 * view's volume (core/histogram.js), or null.
 */
export function colorBarOf(view, { volumes = [], histogram = null } = {}) {
  const volume = shownVolume(view, volumes);
  if (volume === undefined) return null;
  if (coloredLayer(view).color_by) return otherBar(coloredLayer(view), view, volumes);
  const mode = isProjection(view) && showsVolume(layersOf(view)) ? view.compositing.mode : null;
  if (mode && isGrey(view)) {
    const window = projectionWindow(view, histogram);
    const grey = [{ at: 0, color: [0, 0, 0], isHidden: false }, { at: 1, color: [1, 1, 1], isHidden: false }];
    return window && window.width > 0 ? bar(grey, [window.level - window.width / 2, window.level + window.width / 2], volume, mode) : null;
  }
  const points = view.transfer_function?.points;
  const ends = points?.length && [points[0].value, points.at(-1).value];
  const known = volume?.range ?? histogram?.range ?? ends;
  const range = points?.length && known[1] > known[0] ? visibleRange(points, known) : null;
  if (range && !Number.isFinite(range[1] - range[0])) return null; // a range that no number spans
  return range && bar(colorsOf(points, range), range, volume, mode);
}
