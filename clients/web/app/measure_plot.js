// SPDX-License-Identifier: Apache-2.0
// Small plots of a measurement: the values of a profile over the distance, and the histogram of a region.
import { shortNumber, unitText } from '../core/measures.js';
import { t } from '../core/text.js';
import { make, setText, svg } from './dom.js';

const WIDTH = 264;
const HEIGHT = 96;
const LEFT = 4;
const TOP = 6;

const axis = (low, middle, high) => make('div', { class: 'axis' }, make('span', { text: low }), make('span', { text: middle }), make('span', { text: high }));
const frame = (label) => svg('svg', { class: 'measure-plot', viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: 'img', 'aria-label': label });

/** The plot of a profile: {profile: {step, positions, values}, value, unit, statistics}. show(world) marks a place in the pictures. */
export function profilePlot({ profile, value, unit, statistics }, show) {
  const { step, positions, values } = profile;
  const { min, max } = statistics;
  const length = `${shortNumber(value)} ${unitText(unit)}`.trim();
  const figure = frame(t('measure.plot', { length, min: shortNumber(min ?? 0), max: shortNumber(max ?? 0) }));
  const span = max > min ? max - min : 1;
  const x = (i) => LEFT + (WIDTH - 2 * LEFT) * i / (values.length - 1);
  const y = (v) => HEIGHT - TOP - (HEIGHT - 2 * TOP) * (v - (min ?? 0)) / span;
  let isDown = false;
  const d = values.map((v, i) => {
    const part = v === null ? '' : `${isDown ? 'L' : 'M'}${x(i).toFixed(1)} ${y(v).toFixed(1)}`;
    isDown = v !== null;
    return part;
  }).join('');
  const line = svg('line', { class: 'measure-cursor', y1: 0, y2: HEIGHT, visibility: 'hidden' });
  figure.append(svg('path', { class: 'measure-curve', d }), line);
  const range = t('measure.range', { min: min === null ? '–' : shortNumber(min), max: max === null ? '–' : shortNumber(max) });
  const read = make('p', { class: 'measure-read', text: range });
  figure.addEventListener('pointermove', ({ clientX }) => {
    const box = figure.getBoundingClientRect();
    const i = Math.min(Math.max(Math.round(((clientX - box.left) * WIDTH / box.width - LEFT) / (WIDTH - 2 * LEFT) * (values.length - 1)), 0), values.length - 1);
    for (const name of ['x1', 'x2']) line.setAttribute(name, x(i));
    line.setAttribute('visibility', 'visible');
    const at = `${shortNumber(step * i)} ${unitText(unit)}`.trim();
    setText(read, t('measure.at', { place: at, value: values[i] === null ? t('measure.novalue') : shortNumber(values[i]) }));
    show(positions[i]);
  });
  figure.addEventListener('pointerleave', () => {
    line.setAttribute('visibility', 'hidden');
    setText(read, range);
    show(null);
  });
  return make('div', {}, figure, axis('0', t('measure.distance.axis'), length), read);
}

/** The histogram of a region: {range, counts}. */
export function histogramPlot({ range, counts }) {
  const most = Math.max(...counts, 1);
  const figure = frame(t('measure.histogram', { min: shortNumber(range[0]), max: shortNumber(range[1]) }));
  const wide = (WIDTH - 2 * LEFT) / counts.length;
  counts.forEach((count, i) => {
    const tall = (HEIGHT - 2 * TOP) * count / most;
    if (count) figure.append(svg('rect', { class: 'measure-bar', x: LEFT + wide * i, y: HEIGHT - TOP - tall, width: Math.max(wide - 1, 1), height: tall }));
  });
  return make('div', {}, figure, axis(shortNumber(range[0]), t('measure.value.axis'), shortNumber(range[1])));
}

/** The statistics of a profile or a region as a table. */
export function statisticsTable({ statistics: s, value, unit, kind }) {
  const number = (v) => (v === null ? '–' : shortNumber(v, 5));
  const size = `${value === null ? '–' : shortNumber(value, 5)} ${unitText(unit)}`.trim();
  const rows = [
    [t(kind === 'profile' ? 'measure.length' : 'measure.area'), size], [t('measure.mean.short'), number(s.mean)],
    [t('measure.deviation'), number(s.deviation)], [t('measure.min'), number(s.min)], [t('measure.max'), number(s.max)],
    [t('measure.count'), String(s.count)], ...(s.nonfinite ? [[t('measure.nonfinite'), String(s.nonfinite)]] : []),
  ];
  return make('dl', { class: 'measure-table' }, ...rows.flatMap(([name, text]) => [make('dt', { text: name }), make('dd', { text })]));
}
