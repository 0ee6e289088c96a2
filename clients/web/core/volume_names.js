// SPDX-License-Identifier: Apache-2.0
// Names of volumes that tell them apart. A volume has the name of its file, so files of two folders may share a name.

export const nameOf = (volume) => volume.name || volume.id;

/** The end of a source, which says how the file is read; `words` = "unit=µm". The name of a file may also have a question mark. */
const QUERY = /\?(?<words>(?:as|unit|field|vectors|series)=.*)$/;
const folderOf = (source = '') => {
  const file = source.replace(QUERY, '');
  return file.includes('/') ? file.slice(0, file.lastIndexOf('/')) : '';
};
const readingOf = (source = '') => QUERY.exec(source)?.groups.words.replaceAll('&', ', ') ?? '';

/** Tells volumes of one name apart: the folder of the volume, or how its file is read, or else its id; '' if no other volume has its name. */
export function placeOf(volume, volumes) {
  const same = volumes.filter((other) => other.id !== volume.id && nameOf(other) === nameOf(volume));
  if (!same.length) return '';
  const found = [folderOf, readingOf].find((tell) => tell(volume.source) && same.every((other) => tell(other.source) !== tell(volume.source)));
  return found?.(volume.source) ?? volume.id;
}

/** The volumes whose names, ids or sources have all words of a filter: {open: ready volumes, then volumes that are being loaded; failed}. */
export function grouped(volumes, filter = '') {
  const words = filter.toLowerCase().split(/\s+/).filter(Boolean);
  const found = volumes.filter(({ name = '', id, source = '' }) => {
    const text = `${name} ${id} ${source}`.toLowerCase();
    return words.every((word) => text.includes(word));
  });
  const of = (...states) => found.filter(({ state }) => states.includes(state));
  const failed = of('failed');
  const loading = of('loading');
  return { open: [...found.filter((volume) => !failed.includes(volume) && !loading.includes(volume)), ...loading], failed };
}

/** The name with what tells it apart, for a line of text. */
export function fullNameOf(volume, volumes) {
  const place = placeOf(volume, volumes);
  return place ? `${nameOf(volume)} (${place})` : nameOf(volume);
}
