// SPDX-License-Identifier: Apache-2.0
// Names of volumes that tell them apart. The name is that of the file, so files of two folders may share it.

export const nameOf = (volume) => volume.name || volume.id;

const folderOf = (source = '') => (source.includes('/') ? source.slice(0, source.lastIndexOf('/')) : '');

/** Tells volumes of one name apart: the folder of the volume, or else its id; '' if no other volume has its name. */
export function placeOf(volume, volumes) {
  const same = volumes.filter((other) => other.id !== volume.id && nameOf(other) === nameOf(volume));
  if (!same.length) return '';
  const folder = folderOf(volume.source);
  return folder && same.every((other) => folderOf(other.source) !== folder) ? folder : volume.id;
}

/** The volumes whose names, ids or sources have all words of a filter: {open: ready ones first, then those that load; failed}. */
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
