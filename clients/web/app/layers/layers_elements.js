// SPDX-License-Identifier: Apache-2.0
// The controls of layers of points, Gaussians and triangles: how they look, and where they lie.
import { roundCoordinate } from '../../core/lengths.js';
import { IDENTITY, UNMOVED, isSameMatrix, matrixOf, placementOf } from '../../core/placement.js';
import { logarithmic } from '../../core/slider.js';
import { t } from '../../core/text.js';
import { make, setText } from '../controls/dom.js';
import { showNumber, showValue } from '../controls/fields.js';
import { ColorByRow } from './layers_color_by.js';
import { digits, hexOf, onColor, onSlide, sliderRow } from './layers_rows.js';

const sizeScale = logarithmic(0.1, 10);
const scaleScale = logarithmic(0.01, 100);
const REACH = 1.5; // of the sliders that move a layer, in radii of the volume or of the layer
const ORIGIN = [0, 0, 0];
const AXES = ['x', 'y', 'z'];

/** What all of them have: where the layer lies, and what to do if its volume is closed. */
class ElementsDetails {
  #choose; #closed; #placement; #odd; #numbers; #sliders; #fit;
  #shown = null; // {index, id, placement}: the placement that the fields show; the same matrix may have others
  layers;
  index = -1;

  /** choose(index) lets the user choose another volume for the layer. */
  constructor(layers, choose) {
    this.layers = layers;
    this.#choose = choose;
    this.#closed = make('div', { class: 'layer-closed', hidden: true }, make('p', { class: 'about' }),
      make('div', { class: 'buttons' }, make('button', { text: t('layers.closed.choose'), press: () => this.#choose(this.index) })));
    this.root = make('div', { class: 'layer-details' }, this.#closed, this.#makePlacement());
  }

  /** Adds rows above the placement. */
  add(...rows) { this.root.lastElementChild.before(...rows); }

  get layer() { return this.layers.list[this.index]; }

  set(change, time) { this.layers.change(this.index, change, time); }

  get #center() { return this.layers.sphereOf(this.layer)?.center ?? ORIGIN; }

  /** How far the sliders move the layer. */
  get #reach() {
    return REACH * Math.max(this.layers.sphereOf({ id: '' })?.radius ?? 0, this.layers.sphereOf(this.layer)?.radius ?? 0) || REACH;
  }

  /** One row per number: [field of the placement, index in it, label, how the slider shows it]. */
  get #fields() {
    const moves = { at: (share) => roundCoordinate((2 * share - 1) * this.#reach, this.#reach), of: (value) => (value / this.#reach + 1) / 2 };
    const turns = { at: (share) => Math.round(360 * share - 180), of: (value) => (value + 180) / 360 };
    return [
      ...AXES.map((axis, i) => ({ name: 'move', i, label: t('layers.move', { axis }), scale: moves })),
      ...AXES.map((axis, i) => ({ name: 'turn', i, label: t('layers.turn', { axis }), scale: turns })),
      { name: 'scale', i: null, label: t('layers.scale'), scale: scaleScale },
    ];
  }

  #makePlacement() {
    const fields = this.#fields;
    this.#sliders = fields.map(({ label }) => make('input', { type: 'range', min: 0, max: 1, step: 0.0025, 'aria-label': label }));
    this.#numbers = fields.map(({ name, i, label }) => make('input', { type: 'number', step: 'any', 'aria-label': label, 'data-field': i === null ? name : `${name}-${AXES[i]}` }));
    fields.forEach(({ name, i, scale }, at) => {
      const put = (value, time) => {
        const before = this.#shown.placement;
        this.#place({ ...before, [name]: i === null ? value : before[name].map((part, k) => (k === i ? value : part)) }, time);
      };
      onSlide(this.layers, this.#sliders[at], (share, time) => put(scale.at(share), time));
      this.#numbers[at].addEventListener('change', ({ timeStamp }) => {
        const value = this.#numbers[at].valueAsNumber;
        if (Number.isFinite(value) && (name !== 'scale' || value > 0)) put(value, timeStamp);
        else this.#numbers[at].value = ''; // show() fills it
        this.show(this.index);
      });
    });
    this.#placement = make('div', { class: 'layer-placement' }, ...fields.map(({ label }, at) => make('div', { class: 'row' }, make('span', { text: label, 'aria-hidden': 'true' }), this.#sliders[at], this.#numbers[at])));
    this.#odd = make('p', { class: 'about', text: t('layers.placement.odd') });
    this.#fit = make('button', { text: t('layers.fit'), title: t('layers.fit.title'), press: ({ timeStamp }) => this.#place(this.layers.fitOf(this.layer), timeStamp) });
    const reset = make('button', { text: t('layers.placement.reset'), title: t('layers.placement.reset.title'), press: ({ timeStamp }) => this.#place(UNMOVED, timeStamp) });
    return make('details', { class: 'fold' }, make('summary', {}, make('h3', { text: t('layers.placement') })),
      this.#odd, this.#placement, make('div', { class: 'buttons' }, this.#fit, reset));
  }

  #place(placement, time) {
    this.#shown = { index: this.index, id: this.layer.id, placement };
    this.set({ transform: placement === UNMOVED ? [...IDENTITY] : matrixOf(placement, this.#center) }, time);
  }

  /** Finds the placement of the layer. The numbers that the user typed stay while they give the matrix of the view. */
  #findPlacement() {
    const { transform, id } = this.layer;
    const center = this.#center;
    const isKnown = this.#shown?.index === this.index && this.#shown.id === id && this.#shown.placement
      && isSameMatrix(transform, matrixOf(this.#shown.placement, center), this.#reach);
    if (!isKnown) this.#shown = { index: this.index, id, placement: placementOf(transform, center) };
    return this.#shown.placement;
  }

  show(index) {
    this.index = index;
    const isClosed = this.layers.isClosed(this.layer);
    this.#closed.hidden = !isClosed;
    this.root.toggleAttribute('data-closed', isClosed);
    if (isClosed) setText(this.#closed.firstChild, t('layers.closed.about', { name: this.layers.nameOf(index) }));
    const placement = this.#findPlacement();
    this.#odd.hidden = placement !== null;
    this.#placement.hidden = placement === null;
    this.#fit.disabled = !this.layer.id || !this.layers.fitOf(this.layer);
    if (!placement) return;
    this.#fields.forEach(({ name, i, scale }, at) => {
      const value = i === null ? placement[name] : placement[name][i];
      const [slider, number] = [this.#sliders[at], this.#numbers[at]];
      slider.value = String(scale.of(value));
      slider.setAttribute('aria-valuetext', showNumber(value));
      if (document.activeElement !== number || number.valueAsNumber === value || (!number.value && !number.validity.badInput)) number.value = String(digits(value));
    });
  }
}

/** Adds a slider of opacity; returns the function that shows a value. */
function addOpacity(details, id) {
  const slider = make('input', { id, type: 'range', min: 0, max: 1, step: 0.01 });
  onSlide(details.layers, slider, (opacity, time) => details.set({ opacity }, time));
  details.add(sliderRow({ id, label: t('layers.opacity'), title: t('layers.opacity.title'), slider }));
  return (opacity) => {
    slider.value = String(opacity);
    showValue(slider, showNumber(opacity));
  };
}

export class PointsDetails extends ElementsDetails {
  #size; #colorBy;

  constructor(layers, choose) {
    super(layers, choose);
    this.#size = make('input', { id: 'points-size', type: 'range', min: 0, max: 1, step: 0.01 });
    onSlide(layers, this.#size, (share, time) => this.set({ size: sizeScale.at(share) }, time));
    this.#colorBy = new ColorByRow(layers, 'points-color-by');
    this.add(sliderRow({ id: 'points-size', label: t('layers.size'), title: t('layers.size.title'), slider: this.#size }), this.#colorBy.root);
  }

  show(index) {
    super.show(index);
    const { size } = this.layer;
    this.#size.value = String(sizeScale.of(size));
    showValue(this.#size, t('layers.times', { factor: showNumber(size) }));
    this.#colorBy.show(index);
  }
}

export class GaussiansDetails extends ElementsDetails {
  #showOpacity; #convention;

  constructor(layers, choose) {
    super(layers, choose);
    this.#showOpacity = addOpacity(this, 'gaussians-opacity');
    this.#convention = make('select', { id: 'gaussians-convention' }, ...['inria', 'normalised'].map((name) => new Option(t(`layers.convention.${name}`), name)));
    this.#convention.addEventListener('change', ({ timeStamp }) => this.set({ convention: this.#convention.value }, timeStamp));
    this.add(make('div', { class: 'row', title: t('layers.convention.title') }, make('label', { for: 'gaussians-convention', text: t('layers.convention') }), this.#convention));
  }

  show(index) {
    super.show(index);
    this.#showOpacity(this.layer.opacity);
    this.#convention.value = this.layer.convention;
  }
}

export class GeometryDetails extends ElementsDetails {
  #showOpacity; #color; #colors;

  constructor(layers, choose) {
    super(layers, choose);
    this.#colors = make('select', { id: 'geometry-colors' }, ...['own', 'layer'].map((name) => new Option(t(`layers.colors.${name}`), name)));
    this.#color = make('input', { id: 'geometry-color', type: 'color' });
    this.#colors.addEventListener('change', ({ timeStamp }) => this.set({ colors: this.#colors.value }, timeStamp));
    onColor(layers, this.#color, (color, time) => this.set({ color, colors: 'layer' }, time));
    this.add(
      make('div', { class: 'row', title: t('layers.colors.title') }, make('label', { for: 'geometry-colors', text: t('layers.colors') }), this.#colors),
      make('div', { class: 'row' }, make('label', { for: 'geometry-color', text: t('layers.color') }), this.#color));
    this.#showOpacity = addOpacity(this, 'geometry-opacity');
  }

  show(index) {
    super.show(index);
    this.#showOpacity(this.layer.opacity);
    this.#colors.value = this.layer.colors;
    this.#color.value = hexOf(this.layer.color);
  }
}
