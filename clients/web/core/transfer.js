// SPDX-License-Identifier: Apache-2.0
// The transfer function as the page edits it. A point is {value, opacity, color: [r, g, b]}; values rise strictly. With a colour
// map, the points carry the opacity alone, and the colours come from the map over `range`; merge() makes the points that the
// daemon gets. Nothing here changes its arguments.

export const POINTS_MAX = 256;
export const GRADIENT_POINTS_MAX = 16;
/** The protocol wants opacities below 1. */
export const OPACITY_MAX = 0.999;

/** The largest magnitude of a value here, so that differences of values are numbers. */
export const VALUE_MAX = 1e300;
/** The least extent of an axis, so that shares of it are numbers. */
export const EXTENT_MIN = 1e-290;

const GAP = 1e-5; // least distance between two points, as a share of the range of the volume
const hold = (x, low, high) => Math.min(high, Math.max(low, x));
const mix = (a, b, t) => a + (b - a) * t;
const round = (x, digits) => Number(x.toPrecision(digits));

/** The least distance between two values of points on an axis of this extent. */
export const leastGap = ([low, high]) => Math.max((high - low) * GAP, Math.max(Math.abs(low), Math.abs(high)) * 1e-12, 1e-30);

/** Where `value` lies in a sorted list: the index before it and the share of the way to the next, held at both ends. */
function place(values, value) {
  if (value <= values[0]) return [0, 0];
  for (let i = 1; i < values.length; i += 1) {
    if (value < values[i]) return [i - 1, (value - values[i - 1]) / (values[i] - values[i - 1])];
  }
  return [values.length - 1, 0];
}

/** Opacity at a value: linear between points, constant outside. */
export function opacityAt(points, value) {
  const [i, t] = place(points.map((p) => p.value), value);
  return t ? mix(points[i].opacity, points[i + 1].opacity, t) : points[i].opacity;
}

/** Colour at a value: linear between points, constant outside. `points` need value and color only. */
export function colorAt(points, value) {
  const [i, t] = place(points.map((p) => p.value), value);
  return t ? points[i].color.map((part, k) => mix(part, points[i + 1].color[k], t)) : points[i].color;
}

/** Adds a point. {points, index of the new point}; index −1: there are POINTS_MAX points, or two of them are too close together. */
export function addPoint(points, { value, opacity, color }, gap) {
  const full = { points, index: -1 };
  if (points.length >= POINTS_MAX) return full;
  let index = points.findIndex((p) => p.value > value);
  if (index < 0) index = points.length;
  const low = index > 0 ? points[index - 1].value + gap : -Infinity;
  const high = index < points.length ? points[index].value - gap : Infinity;
  if (low > high) return full;
  const point = { value: hold(value, low, high), opacity: hold(opacity, 0, OPACITY_MAX), color: color ?? colorAt(points, value) };
  return { points: [...points.slice(0, index), point, ...points.slice(index)], index };
}

/** Moves a point; it stops beside its neighbours and at the limits of the opacity. Fields that are missing stay. */
export function movePoint(points, index, { value = points[index].value, opacity = points[index].opacity }, gap) {
  const low = index > 0 ? points[index - 1].value + gap : -Infinity;
  const high = index + 1 < points.length ? points[index + 1].value - gap : Infinity;
  const moved = { ...points[index], value: low > high ? points[index].value : hold(value, low, high), opacity: hold(opacity, 0, OPACITY_MAX) };
  return points.map((p, i) => (i === index ? moved : p));
}

/** Puts a point at a typed value, which may lie beyond its neighbours. {points, index}. */
export function placePoint(points, index, value, gap) {
  const before = points[index - 1]?.value ?? -Infinity;
  const after = points[index + 1]?.value ?? Infinity;
  if (value > before + gap && value < after - gap) return { points: movePoint(points, index, { value }, gap), index };
  const added = addPoint(points.filter((_, i) => i !== index), { ...points[index], value }, gap);
  return added.index < 0 ? { points, index } : added;
}

/** True if some value between low and high has an opacity. */
export const showsValues = (points, [low, high]) => [low, high, ...points.map((p) => p.value).filter((value) => value > low && value < high)]
  .some((value) => opacityAt(points, value) > 0);

/** Removes a point; the last one stays. */
export const removePoint = (points, index) => (points.length > 1 ? points.filter((_, i) => i !== index) : points);

export const paintPoint = (points, index, color) => points.map((p, i) => (i === index ? { ...p, color } : p));

/** The middle of the widest gap beside point `index`, for a point that is added without a pointer. */
export function middleBeside(points, index, [low, high]) {
  const value = points[index]?.value ?? low;
  const next = points[index + 1]?.value ?? Math.max(high, value);
  if (next > value) return (value + next) / 2;
  return (value + (points[index - 1]?.value ?? Math.min(low, value))) / 2;
}

/** The window of a transfer function: the middle and the width of the interval that its points span. */
export function windowOf(points, [low, high]) {
  const [first, last] = [points[0].value, points.at(-1).value];
  return { level: (first + last) / 2, width: last > first ? last - first : (high - low) / 2 };
}

/** Maps values so that the window `from` becomes the window `to`. */
export const stretch = (value, from, to) => to.level + (value - from.level) * (to.width / from.width);

/** The state with all values mapped from one window to another. */
export function stretchAll(state, from, to) {
  const map = (value) => stretch(value, from, to);
  return {
    ...state,
    points: state.points.map((p) => ({ ...p, value: map(p.value) })),
    map: state.map && { ...state.map, range: state.map.range.map(map) },
  };
}

/** The points for the daemon: the points of the user with the colours of `stops` [[t, [r, g, b]], …] over `range`. */
export function merge(points, stops, range, gap) {
  const span = Math.max(range[1] - range[0], gap);
  const colors = stops.map(([t, color]) => ({ value: range[0] + t * span, color }));
  const own = points.map((p) => p.value);
  const free = colors.filter(({ value }) => own.every((v) => Math.abs(v - value) > gap));
  const left = POINTS_MAX - points.length;
  const kept = free.length <= left ? free : free.filter((_, i) => Math.floor(i * left / free.length) !== Math.floor((i - 1) * left / free.length));
  const all = [
    ...points.map((p) => ({ ...p, color: colorAt(colors, p.value) })),
    ...kept.map(({ value, color }) => ({ value, color, opacity: opacityAt(points, value) })),
  ];
  return all.sort((a, b) => a.value - b.value);
}

/** Without points that do not lie above the one before, which rounding or a limit made equal. */
const rising = (points, key) => points.filter((p, i) => i === 0 || p[key] > points[i - 1][key]);

/** Points with values that can be edited. Values beyond the limit become the limit, and only the first of these points stays. */
export const within = (points) => rising(points.map((p) => ({ ...p, value: hold(p.value, -VALUE_MAX, VALUE_MAX) })), 'value');

/** Points with as many digits as the daemon keeps. */
export function tidy(points) {
  return rising(within(points).map(({ value, color, opacity }) => ({
    value: round(value, 9), color: color.map((part) => round(hold(part, 0, 1), 4)), opacity: round(hold(opacity, 0, OPACITY_MAX), 5),
  })), 'value');
}

const near = (a, b) => Math.abs(a - b) <= 1e-6 * Math.max(1e-6, Math.abs(a), Math.abs(b));

/** True if two lists of points are the same but for rounding. */
export const isSame = (a, b) => a.length === b.length && a.every((p, i) => near(p.value, b[i].value) && near(p.opacity, b[i].opacity)
  && p.color.every((part, k) => near(part, b[i].color[k])));

// The gradient axis: {magnitude, scale}.

export const isSameGradient = (a, b) => a.length === b.length
  && a.every((p, i) => near(p.magnitude, b[i].magnitude) && near(p.scale, b[i].scale));

/** Points of the gradient axis as points of a curve, and back. */
export const curveOf = (gradient) => gradient.map(({ magnitude, scale }) => ({ value: magnitude, opacity: scale, color: [1, 1, 1] }));
export const gradientOf = (points) => rising(points.map(({ value, opacity }) => ({
  magnitude: round(Math.max(0, value), 9), scale: round(opacity >= OPACITY_MAX ? 1 : hold(opacity, 0, 1), 5),
})), 'magnitude');
