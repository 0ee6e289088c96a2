// SPDX-License-Identifier: Apache-2.0
// Volumes in several files: headers whose samples are in other files, series of DICOM, and stacks of images. Which of the files at hand belong together.

const HEADER_BYTES = 1 << 16; // of a .nrrd, whose header stands before its samples
const SERIES_BYTES = 1 << 16; // of a DICOM file, which names its series before its pixels
const isHeader = (name) => /\.(nhdr|json|mhd|hdr|vgi)$/i.test(name);
const mayBeDicom = (name) => /\.(dcm|ima)$|^[^.]*$/i.test(name) || /\.\d+$/.test(name);
const isTiff = (name) => /\.tiff?$/i.test(name);
const isImage = (name) => /\.(png|jpe?g)$/i.test(name) || isTiff(name);
const mayBeHeader = (name) => isHeader(name) || /\.nrrd$/i.test(name);

function namesOfNrrd(text) {
  const lines = text.split(/\r?\n/);
  const end = lines.indexOf('');
  const at = lines.findIndex((line, i) => (end < 0 || i < end) && /^data ?file:/i.test(line));
  if (at < 0) return [];
  const value = lines[at].slice(lines[at].indexOf(':') + 1).trim();
  if (/^LIST\b/.test(value)) return lines.slice(at + 1).map((line) => line.trim()).filter(Boolean);
  return namesOfPattern(value);
}

/** "FORMAT MIN MAX STEP": the names of numbered files; or the one name. */
function namesOfPattern(value) {
  const pattern = value.match(/^(.*?)%(0?)(\d*)d(.*?)\s+(-?\d+)\s+(-?\d+)\s+(-?\d+)(\s+\d+)?$/);
  if (!pattern) return [value];
  const [, before, zero, width, after] = pattern;
  const [first, last, step] = pattern.slice(5, 8).map(Number);
  const count = step === 0 ? 0 : Math.min(1000, Math.max(0, Math.floor((last - first) / step) + 1));
  return Array.from({ length: count }, (_, i) => `${before}${String(first + i * step).padStart(Number(width || 0), zero || ' ')}${after}`);
}

function namesOfMetaImage(text) {
  const lines = text.split(/\r?\n/);
  const at = lines.findIndex((line) => /^ElementDataFile\s*=/i.test(line));
  if (at < 0) return [];
  const value = lines[at].slice(lines[at].indexOf('=') + 1).trim();
  if (/^LOCAL$/i.test(value)) return [];
  if (/^LIST\b/i.test(value)) return lines.slice(at + 1).map((line) => line.trim()).filter(Boolean);
  return namesOfPattern(value);
}

/** The samples of a NIfTI or ANALYZE header have its name with another ending; "n+1" means that they are in the file itself. */
const namesOfNifti = (name, text) => (text.slice(344, 347) === 'n+1' ? [] : [name.replace(/hdr$/i, (ending) => (ending === 'HDR' ? 'IMG' : 'img'))]);

/** The first file that a .vgi of VGStudio names, which may be a path of another computer. */
function namesOfVgi(text) {
  const [, path = ''] = text.slice(Math.max(0, text.search(/\[file1\]/i))).match(/^\s*Name\s*=\s*(.+?)\s*$/im) ?? [];
  const name = path.split(/[\\/]/).at(-1);
  return name ? [name] : [];
}

/** The names of the files with the samples of a header; [] = it has its own, or cannot be read. */
export function namesIn(name, text) {
  if (/\.mhd$/i.test(name)) return namesOfMetaImage(text);
  if (/\.hdr$/i.test(name)) return namesOfNifti(name, text);
  if (/\.vgi$/i.test(name)) return namesOfVgi(text);
  if (!/\.json$/i.test(name)) return namesOfNrrd(text);
  try {
    const { file } = JSON.parse(text);
    return typeof file === 'string' ? [file] : [];
  } catch {
    return [];
  }
}

/** The SeriesInstanceUID of a DICOM file, from its first bytes; '' = it has none, or is none. */
export function seriesIn(bytes) {
  const text = String.fromCharCode(...bytes.subarray(128, 132));
  const isLittle = bytes[132] !== 0; // group 2 is always little-endian; the series may not be
  if (text !== 'DICM' || !isLittle) return '';
  for (let i = 132; i + 8 < bytes.length; i += 1) {
    if (bytes[i] !== 0x20 || bytes[i + 1] !== 0 || bytes[i + 2] !== 0x0e || bytes[i + 3] !== 0) continue; // (0020,000E)
    const hasType = bytes[i + 4] === 0x55 && bytes[i + 5] === 0x49; // "UI", else the length has four bytes
    const length = hasType ? bytes[i + 6] + 256 * bytes[i + 7] : bytes[i + 4] + 256 * bytes[i + 5];
    const uid = String.fromCharCode(...bytes.subarray(i + 8, i + 8 + Math.min(length, 64)));
    if (/^[0-9.]+[\0 ]*$/.test(uid)) return uid.replace(/[\0 ]+$/, '');
  }
  return '';
}

/** The name that the daemon knows a DICOM file by. */
const named = (file) => (/\.(dcm|ima)$/i.test(file.name) ? file : new File([file], `${file.name}.dcm`, { lastModified: file.lastModified }));

/** Series of DICOM files: their first file in the order of names, then the others. Files that are none are left in `rest`. */
async function seriesOf(files) {
  const series = new Map();
  const rest = [];
  for (const file of files) {
    const uid = mayBeDicom(file.name) ? seriesIn(new Uint8Array(await file.slice(0, SERIES_BYTES).arrayBuffer())) : '';
    if (uid) series.set(uid, [...(series.get(uid) ?? []), named(file)]);
    else rest.push(file);
  }
  return { series: [...series.values()].map((of) => of.sort((a, b) => (a.name < b.name ? -1 : 1))), rest };
}

/** True if a TIFF has one page: a file with more is a volume of its own. */
async function hasOnePage(file) {
  const bytes = async (at, count) => new DataView(await file.slice(at, at + count).arrayBuffer());
  const head = await bytes(0, 8);
  if (head.byteLength < 8) return false;
  const isLittle = head.getUint8(0) === 0x49;
  const first = head.getUint32(4, isLittle);
  const directory = head.getUint16(2, isLittle) === 42 ? await bytes(first, 2) : head;
  if (directory === head || directory.byteLength < 2) return false;
  const next = await bytes(first + 2 + 12 * directory.getUint16(0, isLittle), 4);
  return next.byteLength === 4 && next.getUint32(0, isLittle) === 0;
}

/** Images whose names differ in numbers only, in the order of these: stacks of slices. The others are left in `rest`. */
async function stacksOf(files) {
  const stacks = new Map();
  const rest = [];
  for (const file of files) {
    const isSlice = isImage(file.name) && /\d/.test(file.name) && (!isTiff(file.name) || await hasOnePage(file));
    const pattern = file.name.toLowerCase().replace(/\d+/g, '*');
    if (isSlice) stacks.set(pattern, [...(stacks.get(pattern) ?? []), file]);
    else rest.push(file);
  }
  const { compare } = new Intl.Collator('en', { numeric: true });
  return { stacks: [...stacks.values()].map((of) => of.sort((a, b) => compare(a.name, b.name))), rest };
}

/**
 * Sorts files (with name, size, slice()) into volumes: [{file, companions, missing}]. `missing`: names that a header gives and no file
 * has. A file that a header names is no volume of its own, nor are the other files of a series of DICOM or of a stack.
 */
export async function sortedIntoSets(all) {
  const { series, rest } = await seriesOf(all);
  const { stacks, rest: files } = await stacksOf(rest);
  const namedBy = new Map(); // header → names
  for (const file of files) {
    if (!mayBeHeader(file.name)) continue;
    const names = namesIn(file.name, await file.slice(0, HEADER_BYTES).text());
    if (names.length > 0) namedBy.set(file, names);
  }
  const taken = new Set();
  const sets = [...namedBy].map(([file, names]) => {
    const companions = names.map((name) => files.find((other) => (other.name === name || other.name === `${name}.gz`) && other !== file)).filter(Boolean);
    for (const companion of companions) taken.add(companion);
    return { file, companions, missing: names.filter((name) => !companions.some((other) => other.name === name || other.name === `${name}.gz`)) };
  });
  const byFile = new Map(sets.map((set) => [set.file, set]));
  return [...[...series, ...stacks].map(([file, ...companions]) => ({ file, companions, missing: [] })),
    ...files.filter((file) => !taken.has(file)).map((file) => byFile.get(file) ?? { file, companions: [], missing: [] })];
}
