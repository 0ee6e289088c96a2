// SPDX-License-Identifier: Apache-2.0
// Transfer functions by kind of data. CT presets are in Hounsfield units if scaleOf() finds these in the file; the
// others follow percentiles of the histogram. Opacities refer to the smallest spacing.
import { peak, percentile, shareBetween, threshold } from './histogram.js';
import { t } from './text.js';
import { OPACITY_MAX } from './transfer.js';

export const KINDS = Object.freeze(['ct-bone', 'ct-soft', 'ct-lung', 'ct-vessels', 'mr', 'microscopy', 'simulation']);

const HOUNSFIELD = /^\[?(hu|hounsfield( units?)?)\]?$/i;
const AIR = -1000;
const BACKGROUND = 0.2; // share of the samples
const DENSE = 1600; // HU of the densest bone in most scans
const SKIN = [0.85, 0.55, 0.42];
const FAT = [0.93, 0.74, 0.5];
const MUSCLE = [0.78, 0.32, 0.26];
const BLOOD = [0.82, 0.12, 0.1];
const BONE = [0.96, 0.91, 0.8];
const WHITE = [1, 1, 1];

/** By kind: [HU, opacity, color]. */
const CT = {
  'ct-bone': [[150, 0, SKIN], [250, 0.06, FAT], [400, 0.35, BONE], [900, 0.6, BONE], [1600, 0.85, WHITE]],
  'ct-soft': [[-180, 0, SKIN], [-110, 0.02, FAT], [-30, 0.03, FAT], [20, 0.12, MUSCLE], [80, 0.2, MUSCLE], [160, 0.3, BLOOD], [350, 0.5, BONE], [1600, 0.8, WHITE]],
  'ct-lung': [[-980, 0, [0.25, 0.35, 0.5]], [-900, 0.012, [0.45, 0.62, 0.8]], [-750, 0.035, [0.75, 0.85, 0.95]], [-600, 0.02, [0.9, 0.75, 0.7]],
    [-450, 0.09, SKIN], [-300, 0.01, SKIN], [-150, 0, SKIN]],
  'ct-vessels': [[130, 0, MUSCLE], [180, 0.12, BLOOD], [320, 0.45, [0.92, 0.25, 0.15]], [480, 0.35, [0.95, 0.6, 0.35]], [700, 0.3, BONE], [1600, 0.5, WHITE]],
};

/** The Hounsfield units of the tissue that each kind shows. */
const TISSUE = { 'ct-bone': [250, 3000], 'ct-soft': [-150, 200], 'ct-lung': [-950, -500], 'ct-vessels': [130, 700] };
const LEAST_SHARE = 0.001; // of the samples

/** True if the values look like a CT: among low values, the fullest bin holds air. */
function hasAir(histogram) {
  const { range: [low, high], counts } = histogram;
  const air = low <= -200 && high >= 200 ? peak(histogram, -1500, -300) : null;
  return air !== null && Math.abs(air - AIR) <= 150 && counts[Math.floor((air - low) / (high - low) * counts.length)] > 0;
}

/**
 * How Hounsfield units lie in the values of a volume: {at(HU) → value, note, isCt}; isCt: the values are such units. unit: of the values,
 * '' if the file does not state it; only then the histogram decides. meaning: what the file says that the samples are; '' = nothing.
 */
export function scaleOf(histogram, unit = '', meaning = '') {
  const [low, high] = histogram.range;
  if (HOUNSFIELD.test(unit)) return { at: (hu) => hu, note: t('kind.note.hu'), isCt: true };
  const isOpen = !unit && !meaning;
  if (isOpen && hasAir(histogram)) return { at: (hu) => hu, note: t('kind.note.alike'), isCt: true };
  // Scanners without negative numbers store HU + 1024 or HU + 1000. Soft tissue, the peak between −150 and 150 HU, decides.
  const tissue = isOpen && low > -200 && low < 400 && high > 1400 && high < 6000 ? peak(histogram, 850, 1180) : null;
  if (tissue !== null) {
    const offset = Math.abs(tissue - 1040) <= Math.abs(tissue - 1016) ? 1024 : 1000;
    return { at: (hu) => hu + offset, note: t('kind.note.offset', { offset }), isCt: true };
  }
  const air = peak(histogram, low, low + (high - low) / 3);
  const dense = percentile(histogram, 0.995, threshold(histogram));
  const span = Math.max(dense - air, (high - low) / 100);
  return { at: (hu) => air + (hu - AIR) / (DENSE - AIR) * span, note: unit ? t('kind.note.other', { unit }) : t('kind.note.none'), isCt: false };
}

const point = (value, opacity, color) => ({ value, opacity: Math.min(opacity, OPACITY_MAX), color });

/** Points whose values rise. Percentiles of a histogram with few values coincide; then the points are spread over the range. */
function rising(points, [low, high]) {
  if (points.every((p, i) => i === 0 || p.value > points[i - 1].value)) return points;
  const first = points[0].value < high ? points[0].value : low;
  return points.map((p, i) => ({ ...p, value: first + (high - first) * (i / (points.length - 1)) }));
}

function mr(histogram) {
  const base = threshold(histogram);
  const at = (part) => percentile(histogram, part, base);
  return [point(base, 0, [0.15, 0.1, 0.12]), point(at(0.25), 0.02, [0.55, 0.38, 0.34]), point(at(0.6), 0.1, [0.82, 0.66, 0.58]),
    point(at(0.9), 0.3, [0.95, 0.88, 0.8]), point(at(0.995), 0.6, WHITE)];
}

// The background of fluorescence is the fullest bin, and what lights up is rare.
function microscopy(histogram) {
  const dark = peak(histogram);
  const at = (part) => percentile(histogram, part, dark);
  return [point(at(0.5), 0, [0, 0.1, 0.15]), point(at(0.9), 0.02, [0, 0.45, 0.4]), point(at(0.98), 0.2, [0.25, 0.85, 0.45]),
    point(at(0.999), 0.7, [0.9, 1, 0.75])];
}

// A value that most of the volume has is background; the colours span the rest.
function simulation(histogram) {
  const { range: [low, high], counts } = histogram;
  const most = Math.max(...counts);
  const isBackground = most > BACKGROUND * counts.reduce((a, b) => a + b, 0) && counts.indexOf(most) < counts.length / 2;
  const base = isBackground ? peak(histogram) + (high - low) / counts.length : low;
  const at = (part) => percentile(histogram, part, base);
  return [point(base, 0, WHITE), point(at(0.5), 0.012, WHITE), point(at(0.9), 0.06, WHITE), point(at(0.99), 0.3, WHITE), point(high, 0.6, WHITE)];
}

/** {points, map, note} of a kind for a volume with this histogram {range, counts}, unit and meaning of values. `map` names a colour map, or is null. */
export function presetOf(kind, histogram, unit = '', meaning = '') {
  const { range } = histogram;
  if (!(range[1] > range[0])) return { points: [point(range[0], 0.1, WHITE)], map: null, note: t('kind.note.equal') };
  if (CT[kind]) {
    const { at, note, isCt } = scaleOf(histogram, unit, meaning);
    const [from, to] = TISSUE[kind];
    const lacks = isCt && shareBetween(histogram, at(from), at(to)) < LEAST_SHARE;
    return { points: rising(CT[kind].map(([hu, opacity, color]) => point(at(hu), opacity, color)), range), map: null, note: lacks ? t('kind.note.lacks', { from, to }) : note };
  }
  const note = HOUNSFIELD.test(unit) ? t('kind.note.ct') : t('kind.note.histogram');
  const place = { mr, microscopy, simulation }[kind];
  return { points: rising(place(histogram), range), map: kind === 'simulation' ? 'viridis' : null, note };
}
