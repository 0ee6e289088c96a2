// SPDX-License-Identifier: Apache-2.0
// Files with transfer functions: our JSON, which is the field `transfer_function` of a view in an envelope, and ParaView's JSON
// colour maps. Readers throw an Error whose text names the place and what to do.
import { MIXES } from './color_space.js';
import { simplify } from './color_maps.js';
import { t } from './text.js';
import { GRADIENT_POINTS_MAX, OPACITY_MAX, POINTS_MAX, VALUE_MAX, colorAt, opacityAt, tidy } from './transfer.js';

const FORMAT = 'splatd transfer function';
export const BYTES_MAX = 1 << 20;
const STOPS_MAX = 512; // colours of a map
const PARTS = 16; // samples between two points whose interpolation is not linear in RGB

const fail = (key, values) => { throw new Error(t(`file.${key}`, values)); };
const isNumber = (x) => typeof x === 'number' && Math.abs(x) <= VALUE_MAX;
const isPart = (x) => isNumber(x) && x >= 0 && x <= 1;
const isColor = (c) => Array.isArray(c) && c.length === 3 && c.every(isPart);
const show = (x) => String(JSON.stringify(x)).slice(0, 40);

/** The text of our file: {format, version, name, transfer_function: {points, gradient}}. */
export function writeOwn(name, points, gradient) {
  return `${JSON.stringify({ format: FORMAT, version: 1, name, transfer_function: { points: tidy(points), gradient } }, null, 1)}\n`;
}

/** The text of ParaView's file: colours as RGBPoints, opacities as Points (value, opacity, midpoint, sharpness). */
export function writeParaview(name, points) {
  const all = tidy(points);
  return `${JSON.stringify([{
    ColorSpace: 'RGB', Name: name,
    Points: all.flatMap(({ value, opacity }) => [value, opacity, 0.5, 0]),
    RGBPoints: all.flatMap(({ value, color }) => [value, ...color]),
  }], null, 1)}\n`;
}

function readPoints(points) {
  if (!Array.isArray(points) || points.length === 0) fail('points');
  if (points.length > POINTS_MAX) fail('points.many', { count: points.length, most: POINTS_MAX });
  return points.map((p, i) => {
    const number = i + 1;
    if (!isNumber(p?.value)) fail('point.value', { number, value: show(p?.value) });
    if (i > 0 && p.value <= points[i - 1].value) fail('point.order', { number, value: p.value, before: points[i - 1].value });
    if (!isPart(p.opacity)) fail('point.opacity', { number, value: show(p.opacity) });
    if (!isColor(p.color)) fail('point.color', { number, value: show(p.color) });
    return { value: p.value, opacity: Math.min(p.opacity, OPACITY_MAX), color: [...p.color] };
  });
}

function readGradient(gradient = []) {
  if (!Array.isArray(gradient)) fail('gradient');
  if (gradient.length > GRADIENT_POINTS_MAX) fail('gradient.many', { count: gradient.length, most: GRADIENT_POINTS_MAX });
  return gradient.map((p, i) => {
    if (!isNumber(p?.magnitude) || p.magnitude < 0 || (i > 0 && p.magnitude <= gradient[i - 1].magnitude)) {
      fail('gradient.magnitude', { number: i + 1, value: show(p?.magnitude) });
    }
    if (!isPart(p.scale)) fail('gradient.scale', { number: i + 1, value: show(p.scale) });
    return { magnitude: p.magnitude, scale: p.scale };
  });
}

/** Groups of `size` numbers of a flat list whose first numbers rise; equal ones, which ParaView uses for steps, move apart. */
function groups(list, size, name) {
  if (!Array.isArray(list) || list.length === 0 || list.length % size) fail('groups', { name, size });
  if (list.length > size * STOPS_MAX) fail('groups.many', { name, count: list.length / size, most: STOPS_MAX });
  const wrong = list.findIndex((x) => !isNumber(x));
  if (wrong >= 0) fail('groups.entry', { name, number: wrong + 1, value: show(list[wrong]) });
  const all = Array.from({ length: list.length / size }, (_, i) => list.slice(i * size, (i + 1) * size));
  const least = Math.max(all.at(-1)[0] - all[0][0], Math.abs(all[0][0]) * 1e-9, 1e-30) * 1e-5;
  let last = -Infinity;
  return all.map(([first, ...rest], i) => {
    if (i > 0 && first < all[i - 1][0]) fail('groups.order', { name, value: first, before: all[i - 1][0] });
    last = first > last ? first : last + least;
    return [last, ...rest];
  });
}

function readColors({ RGBPoints, IndexedColors, ColorSpace = 'RGB' }) {
  if (!RGBPoints && IndexedColors) fail('indexed');
  const mix = Object.hasOwn(MIXES, ColorSpace) ? MIXES[ColorSpace]
    : fail('space', { space: show(ColorSpace) });
  const stops = groups(RGBPoints, 4, 'RGBPoints').map(([value, ...color]) => {
    if (!isColor(color)) fail('rgb', { color: show(color), value });
    return [value, color];
  });
  const parts = ColorSpace === 'RGB' ? 1 : PARTS;
  const all = [];
  stops.slice(0, -1).forEach(([value, color], i) => {
    const [next, other] = stops[i + 1];
    for (let k = 0; k < parts; k += 1) all.push([value + (next - value) * k / parts, mix(color, other, k / parts)]);
    if (ColorSpace === 'Step') all.push([next - (next - value) * 1e-4, color]);
  });
  all.push(stops.at(-1));
  return simplify(all, 0.004);
}

/** VTK's curve between two opacity points (vtkPiecewiseFunction) at t in [0, 1]. */
function bend(from, to, t, midpoint, sharpness) {
  let s = t < midpoint ? 0.5 * t / midpoint : 0.5 + 0.5 * (t - midpoint) / (1 - midpoint);
  if (sharpness > 0.99) return s < 0.5 ? from : to;
  if (sharpness < 0.01) return from + (to - from) * s;
  const power = 1 + 10 * sharpness;
  s = s < 0.5 ? 0.5 * (2 * s) ** power : 1 - 0.5 * (2 - 2 * s) ** power;
  const slope = (1 - sharpness) * (to - from);
  const [s2, s3] = [s * s, s * s * s];
  const y = (2 * s3 - 3 * s2 + 1) * from + (3 * s2 - 2 * s3) * to + (s3 - 2 * s2 + s) * slope + (s3 - s2) * slope;
  return Math.min(Math.max(from, to), Math.max(Math.min(from, to), y));
}

function readOpacities(list) {
  const points = groups(list, 4, 'Points').map(([value, opacity, midpoint, sharpness]) => {
    if (!isPart(opacity)) fail('opacity', { opacity, value });
    return { value, opacity: Math.min(opacity, OPACITY_MAX), midpoint: Math.min(Math.max(midpoint, 1e-5), 1 - 1e-5), sharpness };
  });
  const all = [];
  points.slice(0, -1).forEach((p, i) => {
    const next = points[i + 1];
    const isLinear = p.sharpness < 0.01 && Math.abs(p.midpoint - 0.5) < 1e-6;
    const parts = isLinear || p.opacity === next.opacity ? 1 : PARTS;
    for (let k = 0; k < parts; k += 1) {
      all.push({ value: p.value + (next.value - p.value) * k / parts, opacity: bend(p.opacity, next.opacity, k / parts, p.midpoint, p.sharpness) });
    }
  });
  return [...all, { value: points.at(-1).value, opacity: points.at(-1).opacity }];
}

/** A map of ParaView alone is a table over [0, 1]; one with Points is a whole transfer function. */
function readParaview(map) {
  const stops = readColors(map);
  const [low, high] = [stops[0][0], stops.at(-1)[0]];
  const name = typeof map.Name === 'string' && map.Name ? map.Name.slice(0, 60) : 'ParaView';
  const table = stops.length > 1 ? stops.map(([value, color]) => [(value - low) / (high - low), color]) : [[0, stops[0][1]], [1, stops[0][1]]];
  if (!map.Points) return { kind: 'map', name, table };
  const opacities = readOpacities(map.Points);
  const colors = stops.map(([value, color]) => ({ value, color }));
  const values = [...new Set([...opacities.map((p) => p.value), ...stops.map(([value]) => value)])].sort((a, b) => a - b);
  if (values.length > POINTS_MAX) fail('map.many', { count: values.length, most: POINTS_MAX });
  const isNormalized = values[0] === 0 && values.at(-1) === 1;
  return { kind: 'whole', name, isNormalized, points: tidy(values.map((value) => ({ value, color: colorAt(colors, value), opacity: opacityAt(opacities, value) }))), gradient: null };
}

/**
 * Presets of ParaView have values from 0 to 1, which ParaView stretches over the data. Stretches them over the range of a volume; null: the file
 * already has values of the volume.
 */
export function stretch({ isNormalized = false, points }, [low, high]) {
  if (!isNormalized || (low >= 0 && high <= 1) || !(high > low)) return null;
  return points.map((point) => ({ ...point, value: low + (high - low) * point.value }));
}

/**
 * Reads a file of either kind. {kind: 'whole', name, points, gradient} replaces the transfer function (gradient null: it stays);
 * {kind: 'map', name, table: [[t, color], …]} only the colours.
 */
export function readTransferFile(text) {
  if (text.length > BYTES_MAX) fail('large', { count: text.length, most: BYTES_MAX });
  let json;
  try {
    json = JSON.parse(text);
  } catch (error) {
    fail('json', { reason: error.message });
  }
  const first = Array.isArray(json) ? json[0] : json;
  if (first?.RGBPoints || first?.IndexedColors) return readParaview(first);
  const whole = json?.transfer_function ?? json?.view?.transfer_function;
  if (!whole || typeof whole !== 'object') fail('unknown');
  if (json.version !== undefined && json.version !== 1) fail('version', { version: show(json.version) });
  return {
    kind: 'whole', name: typeof json.name === 'string' ? json.name.slice(0, 60) : '', points: readPoints(whole.points),
    gradient: whole.gradient === undefined ? null : readGradient(whole.gradient ?? []),
  };
}
