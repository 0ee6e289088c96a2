// SPDX-License-Identifier: Apache-2.0
// What is known of the shown volume: a fold below the list.
import { sizeText } from '../../core/files.js';
import { elementRows, kindOf } from '../../core/kinds.js';
import { numberText, valueUnit } from '../../core/lengths.js';
import { t } from '../../core/text.js';
import { sizesOf } from '../../core/vertical.js';
import { make } from '../controls/dom.js';

const number = (value) => numberText(Number(Number(value).toPrecision(6)));

/** The samples and the vectors, by name. */
function fieldText({ name, components, range }) {
  if (components === 1) return name || t('info.fields.values');
  return t('info.fields.vectors', { name: name || t('info.fields.unnamed'), longest: number(range[1]) });
}

/** [label, value] of the samples. */
function gridRows(volume) {
  const sizes = (list) => Object.values(sizesOf(volume, list, number)).join(' ').trim();
  const { dims, spacing } = volume.whole ?? volume;
  return [
    [t('info.dims'), dims?.join(' × ')],
    [t('info.spacing'), spacing && sizes(spacing)],
    [t('info.size'), dims && spacing && t('info.size.value', {
      size: sizes(dims.map((n, i) => Math.max(n - 1, 0) * spacing[i])),
    })],
    [t('info.type'), volume.type],
  ];
}

/** [label, value] of all that the daemon tells. */
function rows(volume) {
  const kind = kindOf(volume);
  const hasValues = kind === 'grid' || kind === 'points';
  const list = [
    ...(kind === 'grid' ? gridRows : elementRows)(volume),
    [t('info.range'), hasValues && !isBlank(volume) && volume.range && `${t('info.range.value', { low: number(volume.range[0]), high: number(volume.range[1]) })} ${valueUnit(volume)}`.trim()],
    [t('info.noise'), volume.noise > 0 && `${numberText(Number(volume.noise.toPrecision(2)))} ${valueUnit(volume)}`.trim()],
    [t('info.fields'), volume.fields?.some(({ name, components }) => name || components > 1) && volume.fields.map(fieldText).join('; ')],
    [t('info.nonfinite'), volume.nonfinite ? String(volume.nonfinite) : ''],
    [t('info.warnings'), volume.warnings?.join(' ')],
    [t('info.anatomy'), volume.anatomy?.join(' ')],
    [t('info.format'), volume.format],
    [t('info.source'), volume.source],
    [t('info.id'), volume.id],
    [t('info.memory'), volume.memory && t('info.memory.value', { voxels: sizeText(volume.memory.voxels) })],
  ];
  return list.filter(([, value]) => value);
}

/** True if no sample of a grid is a finite number, so that there is nothing to see. Of elements the warnings say so. */
const isBlank = (volume) => volume?.dims && kindOf(volume) === 'grid' && volume.nonfinite >= volume.dims.reduce((a, b) => a * b, 1);

export class VolumeInfo {
  #app; #fold; #list;
  #volume = null;

  constructor(app, fold) {
    this.#app = app;
    this.#fold = fold;
    this.#list = fold.querySelector('dl');
    fold.addEventListener('toggle', () => this.#fill());
  }

  /** The shown volume, as in the list; null = unknown. */
  show(volume) {
    if (volume?.id !== this.#volume?.id) this.#app.notice.hide('volume'); // it is about another one
    const isOther = volume?.id !== this.#volume?.id || volume?.state !== this.#volume?.state;
    this.#volume = volume;
    this.#fold.hidden = volume?.state !== 'ready';
    if (!isOther) return;
    this.#fill();
    if (isBlank(volume)) this.#app.notice.show(t('info.blank', { name: volume.name }), 'warning', 'volume');
    else this.#tellWarnings();
  }

  /** Says once per tab what of the volume differs from its file. */
  #tellWarnings() {
    const { notice, storage } = this.#app;
    const { id, source, name, warnings, state } = this.#volume ?? {};
    if (state !== 'ready' || !warnings?.length) return;
    const key = `warned:${id}:${source}`;
    if (storage.recall(key) === warnings.join(' ')) return;
    storage.remember(key, warnings.join(' '));
    notice.show(warnings.length === 1 ? t('info.warnings.one', { name, text: warnings[0] }) : t('info.warnings.more', { name, text: warnings[0] }), 'info', 'volume');
  }

  async #fill() {
    const volume = this.#volume;
    if (!this.#fold.open || this.#fold.hidden || !volume) return;
    let whole = volume;
    try {
      whole = await this.#app.api.volume(volume.id);
    } catch { /* what the list tells has to do */ }
    if (volume !== this.#volume && volume.id !== this.#volume?.id) return;
    this.#list.replaceChildren(...rows(whole).map(([label, value]) => make('div', {}, make('dt', { text: label }), make('dd', { text: value, title: value }))));
  }
}
