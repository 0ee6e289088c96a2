// SPDX-License-Identifier: Apache-2.0
// How a file is read where it leaves that open: what its further axis or its components mean, and the unit of its spacing.

/** What the daemon knows besides what the file says. */
export const READINGS = ['time', 'vectors', 'rgb', 'channels', 'labels', 'slice'];

const MAX = 100; // files that are remembered

/** A unit as it may stand in a source; '' if the text is none. */
export function cleanUnit(text) {
  const unit = text.trim();
  return /^[^&?\s\u0000-\u001f]{1,31}$/.test(unit) && new TextEncoder().encode(unit).length < 32 ? unit : '';
}

/** The source of a file that is read in this way: PATH?as=KIND&unit=UNIT. */
export function withReading(source, { as = '', unit = '' } = {}) {
  const query = [as && `as=${as}`, unit && `unit=${unit}`].filter(Boolean).join('&');
  return query ? `${source}?${query}` : source;
}

/** The readings of the newest files, by source, from what storage holds; anything else is no reading. */
export function parseReadings(text) {
  try {
    const list = JSON.parse(text ?? '[]');
    return new Map(list.filter(([source, reading]) => typeof source === 'string' && (reading.as === '' || READINGS.includes(reading.as)) &&
      typeof reading.unit === 'string').map(([source, { as, unit }]) => [source, { as, unit: cleanUnit(unit) }]));
  } catch {
    return new Map();
  }
}

/** The same with one more; a reading without `as` and `unit` is forgotten. Returns the text for storage. */
export function rememberReading(readings, source, { as, unit }) {
  readings.delete(source);
  if (as || unit) readings.set(source, { as, unit });
  return JSON.stringify([...readings].slice(-MAX));
}
