// SPDX-License-Identifier: Apache-2.0
// Lengths with units, and the scale bar.

/** Metric units in metres, and their usual spellings.
    @type {[string, number][]} */
const METRIC = [['nm', 1e-9], ['µm', 1e-6], ['mm', 1e-3], ['m', 1], ['km', 1e3]];
const SPELLINGS = {
  nm: 1e-9, um: 1e-6, µm: 1e-6, μm: 1e-6, micron: 1e-6, microns: 1e-6, mm: 1e-3, millimeter: 1e-3, millimeters: 1e-3, cm: 1e-2, m: 1,
  meter: 1, meters: 1, km: 1e3,
};

/** A number as text, with the minus sign in place of the hyphen. Not for inputs, which take a hyphen only. */
export const numberText = (value) => String(value).replace(/^-/, '−');

/** The largest of 1, 2 and 5 times a power of ten that is not above `limit` (> 0). */
export function roundLength(limit) {
  const power = 10 ** Math.floor(Math.log10(limit));
  const factor = [10, 5, 2, 1].find((f) => f * power <= limit * (1 + 1e-12)) ?? 0.5;
  return Number((factor * power).toPrecision(1));
}

/** A length in the metric unit that needs the fewest digits; other units stay. */
export function lengthText(value, unit = '') {
  const metres = SPELLINGS[unit];
  if (!metres) return `${Number(value.toPrecision(4))} ${unit}`.trim();
  const length = Math.abs(value) * metres;
  const [name, size] = METRIC.findLast(([, least]) => length >= least * (1 - 1e-9)) ?? METRIC[0];
  return `${Number((value * metres / size).toPrecision(4))} ${name}`;
}

/** The bar {length, px, text} of a round length that is at most `widest` px wide. worldPerPx: world units per px. */
export function scaleBar(worldPerPx, widest, unit) {
  const length = roundLength(worldPerPx * widest);
  return { length, px: length / worldPerPx, text: lengthText(length, unit) };
}

/** A unit of length as people write it: µm for um. */
export const unitName = (unit = '') => (SPELLINGS[unit] === 1e-6 ? 'µm' : unit);

/** The unit of the values of a volume, such as HU; '' = unknown. */
export const valueUnit = (volume) => volume?.fields?.[0]?.unit ?? '';

/** A value of a volume as text, with its unit. range: of all values. */
export const dataText = (value, range, unit) => `${numberText(roundValue(value, range))} ${unit}`.trim();

/** Rounds a coordinate to a thousandth of the extent of a volume, for a field. */
export function roundCoordinate(value, extent) {
  const digits = extent > 0 && Number.isFinite(extent) ? Math.min(100, Math.max(0, 3 - Math.floor(Math.log10(extent)))) : 3;
  return Number(value.toFixed(digits)) + 0;
}

/** Rounds a value of the data to about a ten-thousandth of its range, and to six digits; whole numbers stay. */
export function roundValue(value, [low, high]) {
  return Number.isSafeInteger(value) ? value : Number(roundCoordinate(value, (high - low) / 10).toPrecision(6));
}
