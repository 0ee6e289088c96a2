// SPDX-License-Identifier: Apache-2.0
// Files and folders: sizes for people, paths, and filters.

const UNITS = ['B', 'kB', 'MB', 'GB', 'TB'];

/** A size as people read it: 999 B, 1.2 MB, 34 GB; with `more` digits than usual. */
export function sizeText(bytes, more = 0) {
  let value = bytes;
  let unit = 0;
  while (value >= 999.5 && unit < UNITS.length - 1) {
    value /= 1000;
    unit += 1;
  }
  const digits = unit > 0 ? more + (value < 9.95 ? 1 : 0) : 0;
  return `${value.toFixed(digits)} ${UNITS[unit]}`;
}

/** Two sizes that differ, with as many digits as show the difference. */
export function sizeTexts(a, b) {
  for (let more = 0; ; more += 1) {
    const texts = [sizeText(a, more), sizeText(b, more)];
    if (texts[0] !== texts[1] || more === 6) return texts;
  }
}

export const joined = (folder, name) => (folder ? `${folder}/${name}` : name);

export const parentOf = (folder) => folder.slice(0, Math.max(0, folder.lastIndexOf('/')));

/** The folders on the way to a folder: [{name, path}], without the data folder itself. */
export function crumbs(folder) {
  const names = folder.split('/').filter(Boolean);
  return names.map((name, i) => ({ name, path: names.slice(0, i + 1).join('/') }));
}

/** Small letters without accents: texts of names are compared like this, here and by the daemon. */
const folded = (text) => text.normalize('NFD').replaceAll(/[\u0300-\u036f]/g, '').toLowerCase();

const wordsOf = (filter) => folded(filter).split(/\s+/).filter(Boolean);

/** What the daemon is asked to find for a filter; '' = nothing. */
export const searched = (filter) => filter.slice(0, 255).split(/\s+/).filter(Boolean).join(' ');

/** Found entries that lie below a folder, each with its `place` there. */
export function below(folder, entries) {
  return entries.filter((entry) => entry.folder !== folder)
    .map((entry) => ({ ...entry, place: folder ? entry.folder.slice(folder.length + 1) : entry.folder }));
}

/** Entries whose names have all words of the filter, in natural order: folders first, 2 before 10. */
export function arranged(entries, filter, compare = new Intl.Collator(undefined, { numeric: true, sensitivity: 'base' }).compare) {
  const words = wordsOf(filter);
  return entries
    .filter(({ name }) => words.every((word) => folded(name).includes(word)))
    .sort((a, b) => (a.kind === b.kind ? compare(a.name, b.name) : a.kind === 'folder' ? -1 : 1));
}

/** Formats whose numbered files are slices of one volume. */
const SLICES = new Set(['DICOM', 'TIFF', 'PNG', 'JPEG']);

/** The time series among entries: files of one format whose names differ in numbers only. [{name, count}]: '*' stands for each number. */
export function numberedSeries(entries) {
  const counts = new Map();
  for (const { name, kind, format } of entries) {
    if (kind === 'folder' || !format || SLICES.has(format) || !/\d/.test(name)) continue;
    const pattern = name.replaceAll(/\d+/g, '*');
    counts.set(pattern, (counts.get(pattern) ?? 0) + 1);
  }
  return [...counts].filter(([, count]) => count > 1).map(([name, count]) => ({ name, count }));
}

/** True if a folder may be a DICOM study: it has DICOM files, or folders and nothing else. */
export function mayBeStudy(folder, entries) {
  if (entries.some(({ format }) => format === 'DICOM')) return true;
  return folder !== '' && entries.length > 0 && entries.every(({ kind }) => kind === 'folder');
}

/** Series whose texts have all words of the filter. */
export function filteredSeries(series, filter) {
  const words = wordsOf(filter);
  const told = ({ number = '', description = '', modality = '' }) => folded(`${number} ${description} ${modality}`);
  return series.filter((one) => words.every((word) => told(one).includes(word)));
}

/** The newest first, each source once, at most `max`. */
export function withRecent(list, entry, max) {
  return [entry, ...list.filter(({ source }) => source !== entry.source)].slice(0, max);
}
