// SPDX-License-Identifier: Apache-2.0
// The controls of the selected channel: its window in numbers, its opacity, and its curve over the histogram.
import { CHANNEL_POINTS_MAX, fade, moveEnd, opacityOf, windowOf } from '../../core/channels.js';
import { quadratic } from '../../core/slider.js';
import { t } from '../../core/text.js';
import { OPACITY_MAX } from '../../core/transfer.js';
import { Curve } from '../controls/curve.js';
import { byId, make } from '../controls/dom.js';
import { showNumber, showValue } from '../controls/fields.js';
import { digits, onSlide, sliderRow } from '../layers/layers_rows.js';
import { paintCurve, paintStrip } from '../transfer/transfer_paint.js';

const ENDS = ['low', 'high'];
const opacityScale = quadratic(OPACITY_MAX);

/** A copy of the editor of the transfer function, without the colours of points. */
function makeCurve() {
  const root = byId('transfer-curve').cloneNode(true);
  root.querySelector('#layer-markers').remove();
  root.querySelector('.row:has([type="color"])').remove();
  for (const element of root.querySelectorAll('[id], [for]')) {
    const name = element.id ? 'id' : 'for';
    element.setAttribute(name, `channel-${element.getAttribute(name)}`);
  }
  root.id = 'channel-curve';
  root.removeAttribute('data-pointer');
  for (const group of root.querySelectorAll('fieldset')) group.disabled = false;
  return root;
}

export class ChannelDetails {
  #layers; #channel = null; #numbers; #opacity; #fold; #curve; #shown = '';

  /** layers: app.layers, for steps of undo. */
  constructor(layers) {
    this.#layers = layers;
    this.#numbers = ENDS.map((name, end) => {
      const input = make('input', { id: `channel-${name}`, type: 'number', step: 'any', 'aria-label': t(`channels.${name}`) });
      input.addEventListener('change', ({ timeStamp }) => {
        const { points, gap, set } = this.#channel;
        if (Number.isFinite(input.valueAsNumber)) set(moveEnd(points, end, input.valueAsNumber, gap), timeStamp);
        else this.#showNumbers(true);
      });
      return input;
    });
    this.#opacity = make('input', { id: 'channel-opacity', type: 'range', min: 0, max: 1, step: 0.01 });
    onSlide(layers, this.#opacity, (at, time) => this.#channel.set(fade(this.#channel.points, opacityScale.at(at)), time));
    const curve = makeCurve();
    this.#fold = make('details', { class: 'fold' }, make('summary', {}, make('h3', { text: t('channels.curve') })), curve);
    this.#curve = new Curve(curve, {
      edit: (points, { time }) => this.#channel.set(points, time), limit: CHANNEL_POINTS_MAX, name: 'transfer', seal: () => layers.end(),
    });
    curve.addEventListener('pointerdown', () => layers.begin(), { capture: true });
    this.#fold.addEventListener('toggle', () => this.#showCurve());
    this.root = make('div', { class: 'channel-details' },
      make('div', { class: 'layer-details' },
        make('div', { class: 'row', title: t('channels.window.title') },
          make('span', { text: t('channels.window') }), make('span', { class: 'range' }, this.#numbers[0], '–', this.#numbers[1])),
        sliderRow({ id: 'channel-opacity', label: t('layers.opacity'), slider: this.#opacity })),
      this.#fold);
  }

  #showNumbers(isForced = false) {
    windowOf(this.#channel.points).forEach((value, end) => {
      const input = this.#numbers[end];
      if (isForced || document.activeElement !== input || input.valueAsNumber === value) input.value = String(digits(value));
    });
  }

  #showCurve() {
    this.#fold.hidden = !this.#channel.hasCurve;
    if (!this.#fold.open || this.#fold.hidden) return;
    const { points, extent, gap, histogram } = this.#channel;
    this.#curve.show({
      points, extent, gap, isEditable: this.#layers.isEditable,
      paint: (context, width, height, [low, high], top) => {
        paintStrip(byId('channel-transfer-strip'), paintCurve(context, points, histogram, { width, height, low, high, top }), width);
      },
    });
  }

  /** channel: {key, points, extent, gap, histogram, hasCurve, set(points, time)} */
  show(channel) {
    if (channel.key !== this.#shown) this.#curve.selected = 0;
    this.#shown = channel.key;
    this.#channel = channel;
    this.#showNumbers();
    const opacity = opacityOf(channel.points);
    this.#opacity.value = String(opacityScale.of(opacity));
    showValue(this.#opacity, showNumber(opacity));
    this.#showCurve();
  }
}

