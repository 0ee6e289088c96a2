// SPDX-License-Identifier: Apache-2.0
// Headers whose samples are in other files: which files they name, and which of the files at hand belong together.

const HEADER_BYTES = 1 << 16; // of a .nrrd, whose header stands before its samples
const isHeader = (name) => /\.(nhdr|json)$/i.test(name);
const mayBeHeader = (name) => isHeader(name) || /\.nrrd$/i.test(name);

function namesOfNrrd(text) {
  const lines = text.split(/\r?\n/);
  const end = lines.indexOf('');
  const at = lines.findIndex((line, i) => (end < 0 || i < end) && /^data ?file:/i.test(line));
  if (at < 0) return [];
  const value = lines[at].slice(lines[at].indexOf(':') + 1).trim();
  if (/^LIST\b/.test(value)) return lines.slice(at + 1).map((line) => line.trim()).filter(Boolean);
  const pattern = value.match(/^(.*?)%(0?)(\d*)d(.*?)\s+(-?\d+)\s+(-?\d+)\s+(-?\d+)(\s+\d+)?$/);
  if (!pattern) return [value];
  const [, before, zero, width, after] = pattern;
  const [first, last, step] = pattern.slice(5, 8).map(Number);
  const count = step === 0 ? 0 : Math.min(1000, Math.max(0, Math.floor((last - first) / step) + 1));
  return Array.from({ length: count }, (_, i) => `${before}${String(first + i * step).padStart(Number(width || 0), zero || ' ')}${after}`);
}

/** The names of the files with the samples of a header; [] = it has its own, or cannot be read. */
export function namesIn(name, text) {
  if (!/\.json$/i.test(name)) return namesOfNrrd(text);
  try {
    const { file } = JSON.parse(text);
    return typeof file === 'string' ? [file] : [];
  } catch {
    return [];
  }
}

/**
 * Sorts files (with name, size, slice()) into volumes: [{file, companions, missing}]. `missing`: names that a header gives and no file
 * has. A file that a header names is no volume of its own.
 */
export async function sortedIntoSets(files) {
  const named = new Map(); // header → names
  for (const file of files) {
    if (!mayBeHeader(file.name)) continue;
    const names = namesIn(file.name, await file.slice(0, HEADER_BYTES).text());
    if (names.length > 0) named.set(file, names);
  }
  const taken = new Set();
  const sets = [...named].map(([file, names]) => {
    const companions = names.map((name) => files.find((other) => other.name === name && other !== file)).filter(Boolean);
    for (const companion of companions) taken.add(companion);
    return { file, companions, missing: names.filter((name) => !companions.some((other) => other.name === name)) };
  });
  const byFile = new Map(sets.map((set) => [set.file, set]));
  return files.filter((file) => !taken.has(file)).map((file) => byFile.get(file) ?? { file, companions: [], missing: [] });
}
