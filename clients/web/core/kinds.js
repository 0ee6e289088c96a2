// SPDX-License-Identifier: Apache-2.0
// What volumes consist of (`kind` in the protocol): samples on a grid, points, Gaussians or triangles; and what of the page has a meaning
// for the picture of a view.
import { numberText, unitName } from './lengths.js';
import { layersOf } from './layers.js';
import { t } from './text.js';

/** The type of the layer that shows the elements of a volume, by its kind. */
const LAYER_TYPES = Object.freeze({ points: 'points', gaussians: 'gaussians', mesh: 'geometry' });
const KINDS = Object.freeze(Object.fromEntries(Object.entries(LAYER_TYPES).map(([kind, type]) => [type, kind])));

/** The type of the layer that shows a volume of this kind. */
export const layerTypeOf = (kind) => LAYER_TYPES[kind] ?? 'volume';

/** The kind of the volumes that a layer of this type shows. */
const kindOfType = (type) => KINDS[type] ?? 'grid';

/** The kind of a volume of the list. */
export const kindOf = (volume) => volume?.kind ?? 'grid';

/** The kind of a view's volume. A guest, who gets no list of volumes, learns it from the layers: a layer without an id shows the volume of the view.
 */
export function kindOfView(view, volume) {
  if (volume) return kindOf(volume);
  const own = layersOf(view).find(({ id }) => id === '');
  return own ? kindOfType(own.type) : 'grid';
}

/**
 * What has a meaning for a view of a volume of this kind:
 *   grid        samples on a grid: slices, surfaces, edits, measurements of values, compositing
 *   values      the transfer function
 *   footprint   the filters of splats
 *   lit         shading
 */
export function offersOf(kind, view) {
  const has = (type) => layersOf(view).some((layer) => layer.type === type);
  const isGrid = kind === 'grid';
  const hasValues = isGrid || kind === 'points' || has('points');
  return [...(isGrid ? ['grid'] : []), ...(hasValues ? ['values', 'footprint'] : []), ...(isGrid || has('geometry') ? ['lit'] : [])];
}

/** A number with groups of three digits. */
const grouped = (count) => String(count).replace(/\B(?=(\d{3})+$)/g, ' ');

/** The number of elements of a volume; '' if it is not known. */
export const countText = (volume) => (volume?.elements ? grouped(volume.elements.count) : '');

/** "20 000 Gaussians"; '' for a grid. */
function elementsText(volume) {
  const kind = kindOf(volume);
  return kind === 'grid' || !volume.elements ? '' : t(`kinds.${kind}.count`, { count: countText(volume) });
}

/** The text about the samples or elements of a volume, for the list of volumes: "256 × 256 × 110 · uint8", or "20 000 Gaussians". */
export const contentsText = (volume) => elementsText(volume) || [(volume.whole ?? volume).dims?.join(' × '), volume.type].filter(Boolean).join(' · ');

const digits = (value) => numberText(Number(Number(value).toPrecision(6)));

/** Rows of a table about the elements of a volume: pairs of a label and a value. */
export function elementRows(volume) {
  const { spacing, vertices, degree } = volume.elements ?? {};
  const unit = volume.unit ? ` ${unitName(volume.unit)}` : '';
  return [
    [t(`kinds.${kindOf(volume)}`), countText(volume)],
    [t('kinds.vertices'), vertices === undefined ? '' : grouped(vertices)],
    [t('kinds.degree'), degree === undefined ? '' : t('kinds.degree.value', { degree })],
    [t('info.size'), volume.spacing ? t('kinds.box', { size: volume.spacing.map(digits).join(' × ') + unit }) : ''],
    [t('kinds.spacing'), spacing ? digits(spacing) + unit : ''],
  ];
}
