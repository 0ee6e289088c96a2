// SPDX-License-Identifier: Apache-2.0
// The section "Time", where the volume is a time series: which step the view shows, and playing them. The daemon plays, for all participants.
import { numberText } from '../../core/lengths.js';
import { t } from '../../core/text.js';
import { byId, icon, make, setAttribute, setText } from '../controls/dom.js';
import { ORDER } from '../shell/panel.js';

const RATE = 5; // steps per second at first
const DIGITS = 6;

class TimeSection {
  #app; #fold; #play; #slider; #number; #rate; #note;
  #playing = 0; // steps per second; 0 = the time stands
  #isLoading = false; // the step of the view

  constructor(app) {
    this.#app = app;
    this.#play = make('button', { id: 'time-play', press: () => this.#toggle() });
    this.#slider = make('input', { id: 'time-step', type: 'range', min: 0, step: 1, 'data-pointer': '/time/step' });
    this.#number = make('input', { id: 'time-number', type: 'number', min: 0, step: 1, 'aria-label': t('time.step') });
    this.#rate = make('input', { id: 'time-rate', type: 'number', min: 0.1, max: 120, step: 'any', value: RATE });
    this.#note = make('p', { id: 'time-note', class: 'note', role: 'status' });
    app.panel.section({ id: 'time', title: t('time.section'), order: ORDER.time, isOpen: true }).append(
      make('div', { class: 'row' }, make('label', { for: 'time-step', text: t('time.step') }), this.#slider, this.#number),
      make('div', { class: 'row', title: t('time.rate.title') }, this.#play, make('label', { for: 'time-rate', text: t('time.rate') }), this.#rate),
      this.#note,
    );
    this.#fold = byId('time');
    this.#listen();
    this.#show();
  }

  /** {count, unit, times}; null = no series. */
  get #steps() { return this.#app.viewer.volume?.steps ?? null; }

  get #step() { return this.#app.viewer.view?.time?.step ?? 0; }

  #listen() {
    const { connection, shortcuts, viewer } = this.#app;
    this.#slider.addEventListener('input', ({ timeStamp }) => this.#set(this.#slider.valueAsNumber, timeStamp));
    this.#number.addEventListener('change', ({ timeStamp }) => this.#set(this.#number.valueAsNumber, timeStamp));
    this.#rate.addEventListener('change', () => this.#playing && this.#start());
    shortcuts.add(['<', '>'], ({ key, timeStamp }) => this.#move(key === '>' ? 1 : -1, timeStamp), t('time.keys'));
    viewer.on('view', () => this.#show());
    connection.on('volumes', () => this.#show());
    connection.on('state', ({ state }) => {
      if (state !== 'live') return;
      this.#playing = 0; // the daemon says if it plays
      this.#isLoading = false;
      this.#show();
    });
    connection.on('notification', ({ method, params }) => {
      if (method !== 'time.changed') return;
      this.#playing = params.steps;
      this.#isLoading = params.loading;
      viewer.takeStep(params.step);
      this.#show();
    });
  }

  #set(step, time) {
    const { viewer } = this.#app;
    const last = (this.#steps?.count ?? 1) - 1;
    const wanted = Math.max(0, Math.min(last, Math.round(step)));
    if (Number.isFinite(wanted) && wanted !== this.#step && viewer.mayChange()) viewer.change({ time: { step: wanted } }, time);
    this.#show();
  }

  /** Goes round the ends, as playing does. */
  #move(by, time) {
    const count = this.#steps?.count ?? 0;
    if (count) this.#set((this.#step + by + count) % count, time);
  }

  #start() {
    const rate = this.#rate.valueAsNumber;
    this.#call('time.play', { steps: rate >= 0.1 && rate <= 120 ? rate : RATE });
  }

  #toggle() {
    if (!this.#app.viewer.mayChange()) return;
    if (this.#playing) this.#call('time.stop', {});
    else this.#start();
  }

  async #call(method, params) {
    const { connection, notice } = this.#app;
    try {
      await connection.call(method, params);
    } catch (error) {
      if (connection.isLive) notice.show(error.message, 'warning');
    }
  }

  #show() {
    const steps = this.#steps;
    this.#fold.hidden = !steps;
    if (!steps) return;
    const isEnabled = this.#app.viewer.canControl;
    const time = steps.times ? t('time.at', { time: numberText(Number(steps.times[this.#step].toPrecision(DIGITS))), unit: steps.unit }).trim() : '';
    this.#slider.max = this.#number.max = String(steps.count - 1);
    this.#slider.value = String(this.#step);
    this.#slider.setAttribute('aria-valuetext', time ? `${this.#step}, ${time}` : String(this.#step));
    if (document.activeElement !== this.#number || this.#playing) this.#number.value = String(this.#step);
    for (const control of [this.#slider, this.#number, this.#rate, this.#play]) control.disabled = !isEnabled;
    this.#showButton();
    setText(this.#note, [time, t('time.last', { last: steps.count - 1 }), this.#isLoading ? t('time.loading') : ''].filter(Boolean).join(' · '));
  }

  #showButton() {
    const name = this.#playing ? 'pause' : 'play';
    if (this.#play.dataset.icon === name) return;
    this.#play.dataset.icon = name;
    this.#play.replaceChildren(this.#playing ? icon('pause') : icon('play'));
    setAttribute(this.#play, 'aria-label', t(`time.${name}`));
    setAttribute(this.#play, 'title', t(`time.${name}`));
  }
}

export function install(app) {
  new TimeSection(app);
}
