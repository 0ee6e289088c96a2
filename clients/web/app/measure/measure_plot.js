// SPDX-License-Identifier: Apache-2.0
// Small plots of a measurement, with axes: the values of a profile over the distance, and the histogram of a region.
import { numbersOf } from '../../core/measure_text.js';
import { shortNumber, ticks, unitText } from '../../core/measures.js';
import { t } from '../../core/text.js';
import { make, setText, svg } from '../controls/dom.js';

const WIDTH = 264;
const HEIGHT = 118;
const RIGHT = 8;
const TOP = 8;
const BOTTOM = 20;
const WIDE_TEXT = 10; // letters of a number that takes a row for itself
const LETTER_PX = 6; // of a tick's number

/** The caption of an axis of values. */
const valuesIn = (unit) => (unit ? t('measure.value.unit', { unit }) : t('measure.value'));

/** A frame with grid lines and numbers: x(value), y(value) in px. The axes are [low, high]. */
function axes(figure, xs, ys) {
  const [xTicks, yTicks] = [ticks(...xs, 4), ticks(...ys, 3)];
  const left = 8 + LETTER_PX * Math.max(...yTicks.map((value) => shortNumber(value, 3).length));
  const place = (from, to, [low, high]) => (value) => from + (to - from) * (high > low ? (value - low) / (high - low) : 0.5);
  const [x, y] = [place(left, WIDTH - RIGHT, xs), place(HEIGHT - BOTTOM, TOP, ys)];
  for (const value of yTicks) {
    figure.append(svg('line', { class: 'measure-grid', x1: left, x2: WIDTH - RIGHT, y1: y(value), y2: y(value) }));
    figure.append(svg('text', { class: 'measure-tick', x: left - 4, y: y(value), 'text-anchor': 'end', 'dominant-baseline': 'central' }, shortNumber(value, 3)));
  }
  xTicks.forEach((value, i) => {
    figure.append(svg('line', { class: 'measure-grid', x1: x(value), x2: x(value), y1: TOP, y2: HEIGHT - BOTTOM }));
    const isEdge = i === xTicks.length - 1 && x(value) > WIDTH - RIGHT - 20;
    figure.append(svg('text', { class: 'measure-tick', x: isEdge ? WIDTH - 2 : x(value), y: HEIGHT - 6, 'text-anchor': isEdge ? 'end' : 'middle' }, shortNumber(value, 3)));
  });
  return { x, y, left };
}

const figureOf = (attributes) => svg('svg', { class: 'measure-plot', viewBox: `0 0 ${WIDTH} ${HEIGHT}`, ...attributes });
const captions = (vertical, horizontal) => [make('p', { class: 'measure-caption', text: vertical }), make('p', { class: 'measure-caption', 'data-axis': 'x', text: horizontal })];

/** The points of the curve; null values leave gaps. */
function curveOf(values, place) {
  let isDown = false;
  return values.map((value, i) => {
    const part = value === null ? '' : `${isDown ? 'L' : 'M'}${place(i, value)}`;
    isDown = value !== null;
    return part;
  }).join('');
}

/** The plot of a profile: {profile: {step, positions, values}, value, unit, data_unit, statistics}. show(world) marks a place in the pictures. */
export function profilePlot({ profile, value, unit, data_unit: dataUnit, statistics }, show) {
  const { step, positions, values } = profile;
  const { min, max } = statistics;
  const last = values.length - 1;
  const unitName = unitText(unit) || t('measure.axis.nounit');
  const length = `${shortNumber(value)} ${unitName}`;
  const figure = figureOf({
    role: 'slider', tabindex: 0, 'aria-label': t('measure.plot', { length, min: shortNumber(min ?? 0), max: shortNumber(max ?? 0) }), 'aria-valuemin': 0, 'aria-valuemax': last,
    'aria-valuenow': 0,
  });
  const { x, y } = axes(figure, [0, value], [min ?? 0, max ?? 0]);
  const line = svg('line', { class: 'measure-cursor', y1: TOP, y2: HEIGHT - BOTTOM, visibility: 'hidden' });
  const dot = svg('circle', { class: 'measure-cursor-dot', r: 3, visibility: 'hidden' });
  figure.append(svg('path', { class: 'measure-curve', d: curveOf(values, (i, v) => `${x(step * i).toFixed(1)} ${y(v).toFixed(1)}`) }), line, dot);
  const hint = t('measure.plot.hint');
  const read = make('p', { class: 'measure-read', text: hint });
  let at = 0;
  const point = (i) => {
    at = Math.min(Math.max(i, 0), last);
    const has = values[at] !== null;
    const text = t('measure.at', { place: `${shortNumber(step * at)} ${unitName}`, value: has ? `${shortNumber(values[at])} ${dataUnit}`.trim() : t('measure.novalue') });
    for (const name of ['x1', 'x2']) line.setAttribute(name, x(step * at));
    line.setAttribute('visibility', 'visible');
    dot.setAttribute('visibility', has ? 'visible' : 'hidden');
    if (has) {
      dot.setAttribute('cx', x(step * at));
      dot.setAttribute('cy', y(values[at]));
    }
    figure.setAttribute('aria-valuenow', at);
    figure.setAttribute('aria-valuetext', text);
    setText(read, text);
    show(positions[at]);
  };
  const leave = () => {
    for (const mark of [line, dot]) mark.setAttribute('visibility', 'hidden');
    setText(read, hint);
    show(null);
  };
  figure.addEventListener('pointermove', ({ clientX }) => {
    const box = figure.getBoundingClientRect();
    const [from, to] = [x(0), x(value)];
    point(to > from ? Math.round(((clientX - box.left) * WIDTH / box.width - from) / (to - from) * last) : 0);
  });
  figure.addEventListener('pointerleave', leave);
  figure.addEventListener('focus', () => point(at));
  figure.addEventListener('blur', leave);
  figure.addEventListener('keydown', (event) => {
    const to = { ArrowLeft: at - 1, ArrowRight: at + 1, PageDown: at - 16, PageUp: at + 16, Home: 0, End: last }[event.key];
    if (to === undefined || event.ctrlKey || event.altKey || event.metaKey) return;
    point(to);
    event.preventDefault();
    event.stopPropagation();
  });
  const [above, below] = captions(valuesIn(dataUnit), t('measure.distance.axis', { unit: unitName }));
  return make('div', {}, above, figure, below, read);
}

/** The histogram of a region: {histogram: {range, counts}, data_unit}. */
export function histogramPlot({ histogram: { range, counts }, data_unit: dataUnit }) {
  const most = Math.max(...counts, 1);
  const figure = figureOf({ role: 'img', 'aria-label': t('measure.histogram', { min: shortNumber(range[0]), max: shortNumber(range[1]) }) });
  const { x, y } = axes(figure, range, [0, most]);
  const isFlat = !(range[1] > range[0]);
  const [from, to] = isFlat ? [x(range[0]) - 4, x(range[0]) + 4] : [x(range[0]), x(range[1])];
  const wide = (to - from) / (isFlat ? 1 : counts.length);
  counts.forEach((count, i) => {
    if (!count) return;
    figure.append(svg('rect', { class: 'measure-bar', x: from + wide * i, y: y(count), width: Math.max(wide - 1, 1), height: y(0) - y(count) }));
  });
  const [above, below] = captions(t('measure.count'), valuesIn(dataUnit));
  return make('div', {}, above, figure, below);
}

/** All numbers of a measurement with their names, as a table. */
export function numbersTable(item) {
  return make('dl', { class: 'measure-table' }, ...numbersOf(item).map(([name, text], i) => make('div', { class: i === 0 || text.length > WIDE_TEXT ? 'measure-first' : '' }, make('dt', { text: name }), make('dd', { text }))));
}
