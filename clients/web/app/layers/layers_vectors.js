// SPDX-License-Identifier: Apache-2.0
// The controls of a layer of vectors: how streaks look, and how they move.
import { Playing, speedScale } from '../../core/playing.js';
import { quadratic } from '../../core/slider.js';
import { t } from '../../core/text.js';
import { icon, make, setAttribute } from '../controls/dom.js';
import { ColorByRow } from './layers_color_by.js';
import { showNumber, showValue } from '../controls/fields.js';
import { digits, hexOf, onColor, onSlide, sliderRow } from './layers_rows.js';

const STRETCH_MAX = 8;
const STYLES = ['modulate', 'blend'];
const densityScale = quadratic(1);

/** The place in a period of a phase. */
const partOf = (phase) => phase - Math.floor(phase);

/** The streaks of the session's view. */
export function createPlaying({ connection, viewer, notice }) {
  const playing = new Playing({
    call: (method, params) => connection.call(method, params),
    stopped: async () => {
      try {
        const answer = await connection.call('view.get');
        viewer.takeShared(answer.view ?? answer);
      } catch { /* without a stream: the next one begins with the view */ }
    },
    failed: (error) => { if (connection.isLive) notice.show(error.message, 'warning'); },
  });
  connection.on('notification', ({ method, params }) => { if (method === 'time.changed') playing.take(params.rate); });
  connection.on('state', ({ state }) => { if (state === 'live') playing.reset(); });
  return playing;
}

export class VectorsDetails {
  #layers; #playing;
  #index = -1;
  #colorBy; #style; #color; #colorRow; #stretch; #density; #play; #speed; #phase; #number;

  constructor(layers, playing) {
    this.#layers = layers;
    this.#playing = playing;
    this.#style = make('select', { id: 'vectors-style' }, ...STYLES.map((name) => new Option(t(`layers.style.${name}`), name)));
    this.#color = make('input', { id: 'vectors-color', type: 'color' });
    this.#stretch = make('input', { id: 'vectors-stretch', type: 'range', min: 1, max: STRETCH_MAX, step: 0.1 });
    this.#density = make('input', { id: 'vectors-density', type: 'range', min: 0, max: 1, step: 0.01 });
    this.#play = make('button', { id: 'vectors-play', press: () => (playing.rate === 0 ? playing.play() : playing.stop()) });
    this.#speed = make('input', { id: 'vectors-speed', type: 'range', min: -1, max: 1, step: 0.02, 'aria-label': t('layers.speed') });
    this.#phase = make('input', { id: 'vectors-phase', type: 'range', min: 0, max: 1, step: 0.01 });
    this.#number = make('input', { id: 'vectors-phase-value', type: 'number', step: 'any', 'aria-label': t('layers.phase') });
    this.#colorBy = new ColorByRow(layers, 'vectors-color-by');
    this.#listen();
    this.#colorRow = make('div', { class: 'row' }, make('label', { for: 'vectors-color', text: t('layers.color') }), this.#color);
    this.root = make('div', { class: 'layer-details' },
      make('div', { class: 'row', title: t('layers.style.title') }, make('label', { for: 'vectors-style', text: t('layers.style') }), this.#style),
      this.#colorRow, this.#colorBy.root,
      sliderRow({ id: 'vectors-stretch', label: t('layers.stretch'), title: t('layers.stretch.title'), slider: this.#stretch }),
      sliderRow({ id: 'vectors-density', label: t('layers.density'), title: t('layers.density.title'), slider: this.#density }),
      make('div', { class: 'row', title: t('layers.speed.title') }, this.#play, this.#speed, make('output', { for: 'vectors-speed' })),
      sliderRow({ id: 'vectors-phase', label: t('layers.phase'), title: t('layers.phase.title'), slider: this.#phase, value: this.#number }));
  }

  #listen() {
    const layers = this.#layers;
    const set = (change, time) => layers.change(this.#index, change, time);
    this.#style.addEventListener('change', ({ timeStamp }) => set({ style: this.#style.value }, timeStamp));
    onColor(layers, this.#color, (color, time) => set({ color }, time));
    onSlide(layers, this.#stretch, (stretch, time) => set({ stretch }, time));
    onSlide(layers, this.#density, (at, time) => set({ density: densityScale.at(at) }, time));
    this.#speed.addEventListener('input', () => { this.#playing.speed = speedScale.at(this.#speed.valueAsNumber); });
    onSlide(layers, this.#phase, (phase, time) => set({ phase }, time));
    this.#number.addEventListener('change', ({ timeStamp }) => {
      if (Number.isFinite(this.#number.valueAsNumber)) set({ phase: this.#number.valueAsNumber }, timeStamp);
      this.show(this.#index);
    });
    this.#playing.on('change', () => { if (this.root.isConnected) this.#showMotion(layers.list[this.#index]); });
  }

  show(index) {
    const layer = this.#layers.list[index];
    this.#index = index;
    this.#style.value = layer.style;
    this.#colorRow.hidden = layer.style !== 'blend';
    this.#color.value = hexOf(layer.color);
    this.#colorBy.show(index);
    this.#stretch.value = String(layer.stretch);
    showValue(this.#stretch, t('layers.times', { factor: showNumber(layer.stretch) }));
    this.#density.value = String(densityScale.of(layer.density));
    showValue(this.#density, t('layers.density.value', { percent: showNumber(100 * layer.density) }));
    this.#showMotion(layer);
  }

  #showMotion({ visible, phase }) {
    const { rate, speed } = this.#playing;
    const isMoving = rate !== 0;
    const name = isMoving ? 'pause' : 'play';
    if (this.#play.dataset.icon !== name) {
      this.#play.dataset.icon = name;
      this.#play.replaceChildren(isMoving ? icon('pause') : icon('play'));
      setAttribute(this.#play, 'aria-label', t(`layers.${name}`));
    }
    this.#play.disabled = !visible;
    setAttribute(this.#play, 'title', t(visible ? `layers.${name}.title` : 'layers.play.hidden'));
    this.#speed.value = String(speedScale.of(speed));
    showValue(this.#speed, t('layers.speed.value', { rate: showNumber(speed) }));
    this.#phase.disabled = this.#number.disabled = isMoving;
    this.#phase.value = String(partOf(phase));
    this.#phase.setAttribute('aria-valuetext', showNumber(phase));
    if (document.activeElement !== this.#number || this.#number.valueAsNumber === phase) this.#number.value = String(digits(phase));
  }
}
