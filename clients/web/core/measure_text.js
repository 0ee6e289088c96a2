// SPDX-License-Identifier: Apache-2.0
// The words of a measurement: each number with its name and unit, in labels, in the list, and in the table for the clipboard.
import { KINDS, shortNumber, unitText, valueText } from './measures.js';
import { t } from './text.js';
import { withUnit } from './unit_text.js';

const NAMES = {
  distance: 'measure.length', profile: 'measure.length', angle: 'measure.tool.angle', rectangle: 'measure.area', ellipse: 'measure.area', marker: 'measure.value', part: 'measure.volume', path: 'measure.length',
};
const STATISTICS = [['count', 'measure.count'], ['mean', 'measure.mean.short'], ['deviation', 'measure.deviation'], ['min', 'measure.min'], ['max', 'measure.max']];
// Blanks and characters without a width that spreadsheets skip, and the signs that begin a formula, full-width ones too.
const FORMULA = /^[\s\u0000-\u0020\u007f-\u00a0\u00ad\u180e\u200b-\u200f\u2028-\u202e\u205f-\u206f\ufeff]*[=+\-@\u2212\ufe62\ufe63\ufe66\ufe6b\uff0b\uff0d\uff1d\uff20]/u;

/** What the value of this kind is: "Length", "Area", "Angle" or "Value". */
const valueName = (kind) => t(NAMES[kind]);

/** True if the value is a length or an area and the file does not name its unit. */
export const lacksUnit = ({ kind, value, unit }) => kind !== 'angle' && kind !== 'marker' && !unit && value !== null && value !== undefined;

/** The value with its unit: "12.5 mm²", "90°", "12.5 (no unit)". */
function resultText(item) {
  const text = valueText(item, t('measure.novalue'));
  return lacksUnit(item) ? withUnit(text, '') : text;
}

/** The unit of lengths of a part or a path, from the unit of its value. */
const lengthUnit = ({ unit }) => (unit ?? '').replace(/\^\d$/, '');

/** A length or an area beside the value of a part or a path, with its unit. */
function besides(value, unit, digits = 4) {
  return withUnit(valueText({ value, unit }, '–', digits), unit);
}

/** Returns a [name, text] pair for each further number: the area and samples of a part, the straight distance of a path. */
function moreOf(item, digits = 4) {
  const unit = lengthUnit(item);
  if (item.area !== undefined) return [[t('measure.surface'), besides(item.area, unit && `${unit}^2`, digits)], [t('measure.count'), String(item.samples)]];
  return item.straight === undefined ? [] : [[t('measure.straight'), besides(item.straight, unit, digits)]];
}

/** Why a part or a path has no value: the daemon measures it, or there is none. */
const withoutValue = ({ kind, note }) => t(note === undefined ? 'measure.waiting' : `measure.none.${kind}`);

/** The value with its name: "Area 12.5 mm²", or "No value". */
export function namedValue(item) {
  const { kind, value } = item;
  if (KINDS[kind].hasRange && (value === null || value === undefined)) return withoutValue(item);
  return value === null || value === undefined ? t('measure.novalue.alone') : t('measure.named', { name: valueName(kind), value: resultText(item) });
}

/** Which part lies outside of the volume; '' = none. */
export function outsideText({ outside }) {
  if (!(outside > 0)) return '';
  if (outside >= 1) return t('measure.outside.all');
  const percent = outside * 100;
  const part = percent < 1 ? t('measure.outside.few') : percent > 99 ? t('measure.outside.most') : t('measure.outside.percent', { percent: Math.round(percent) });
  return t('measure.outside.part', { part });
}

/** A number and the unit of the values of the volume: "12.5 HU". */
const ofData = (text, { data_unit: unit }) => `${text} ${unit ?? ''}`.trim();

const numberText = (value, digits = 4) => (value === null || value === undefined ? '–' : shortNumber(value, digits));

/** The lines of the label in the picture. */
export function labelLines(item) {
  const { text, statistics } = item;
  const lines = text ? [text, namedValue(item)] : [namedValue(item)];
  if (statistics?.count > 0) lines.push(ofData(t('measure.mean', { mean: numberText(statistics.mean), deviation: numberText(statistics.deviation) }), item));
  const more = moreOf(item);
  if (more.length) lines.push(more[0].join(' '));
  const outside = outsideText(item);
  return outside ? [...lines, outside] : lines;
}

/** [name, text] of all numbers of a measurement. */
export function numbersOf(item) {
  const { statistics: s, kind, unit } = item;
  const rows = [[valueName(kind), lacksUnit(item) ? withUnit(shortNumber(item.value, 5), '') : valueText({ value: item.value, unit }, t('measure.novalue'), 5)]];
  if (item.range) rows.push(...moreOf(item, 5), [t('measure.range'), ofData(item.range.map((end) => shortNumber(end, 5)).join(' – '), item)]);
  if (!s) return rows;
  return [...rows, ...STATISTICS.filter(([key]) => key !== 'count').map(([key, name]) => [t(name), ofData(numberText(s[key], 5), item)]), [t('measure.count'), String(s.count)],
    ...(s.nonfinite ? [[t('measure.nonfinite'), String(s.nonfinite)]] : [])];
}

/** A cell of a table: no tabs, and no formula. */
const cell = (text) => (FORMULA.test(text) ? `'${text}` : text).replace(/[\t\r\n]+/g, ' ');

/** The table of a list for the clipboard: a heading and a line per measurement, with tabs. */
export function tableText(items, nameOf) {
  const headings = ['measure.table.name', 'measure.table.kind', 'measure.value', 'measure.table.unit', ...STATISTICS.map(([, name]) => name), 'measure.table.data', 'measure.outside', 'measure.surface', 'measure.straight'];
  const rows = items.map((item) => [cell(nameOf(item)), t(`measure.tool.${item.kind}`), item.value ?? '', cell(unitText(item.unit ?? '')),
    ...STATISTICS.map(([key]) => item.statistics?.[key] ?? ''), cell(item.data_unit ?? ''), item.outside ?? '', item.area ?? '', item.straight ?? '']);
  return [headings.map((key) => t(key)), ...rows].map((row) => row.join('\t')).join('\n');
}
