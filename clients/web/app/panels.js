// SPDX-License-Identifier: Apache-2.0
// The panel: volumes, rendering choices, clipping.
import { flatLimit, hideFlat, steepest } from '../core/choices.js';
import { quadratic } from '../core/slider.js';
import { ClipPanel } from './clip.js';
import { Complaints, Fields, showNumber, showValue } from './fields.js';

const byId = (id) => document.getElementById(id);

const hex = (part) => Math.round(Math.min(1, Math.max(0, part)) * 255).toString(16).padStart(2, '0');
/** [r, g, b, a] in [0,1] → "#rrggbb" */
export const colorToHex = (color) => `#${color.slice(0, 3).map(hex).join('')}`;
/** "#rrggbb" → [r, g, b, 1] */
export const hexToColor = (text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255).concat(1);

function describe(volume) {
  if (volume.state === 'failed') return `failed: ${volume.reason || 'no reason given'}`;
  if (volume.state === 'loading') return `loading … ${Math.round((volume.progress ?? 0) * 100)} %`;
  return [volume.dims?.join(' × '), volume.type].filter(Boolean).join(' · ');
}

export class Panels {
  #viewer; #panel; #list; #fields; #clip; #complaints;
  #key = '';

  constructor(viewer, { help }) {
    this.#viewer = viewer;
    this.#panel = byId('panel');
    this.#list = byId('volumes');
    byId('panel-toggle').addEventListener('click', () => this.toggle());
    byId('help-open').addEventListener('click', help);
    byId('fit').addEventListener('click', (event) => viewer.fit(event.timeStamp));
    byId('reset').addEventListener('click', (event) => viewer.reset(event.timeStamp));
    byId('background').addEventListener('input', (event) => this.#setBackground(event.target.value, event.timeStamp));
    for (const swatch of document.querySelectorAll('.swatches button')) {
      swatch.style.backgroundColor = swatch.dataset.color;
      swatch.addEventListener('click', (event) => this.#setBackground(swatch.dataset.color, event.timeStamp));
    }
    byId('shading').addEventListener('change', (event) => {
      viewer.change({ shading: { mode: event.target.checked ? 'phong' : 'none' } }, event.timeStamp);
    });
    byId('flat').addEventListener('input', (event) => {
      const magnitude = this.#flatScale.at(event.target.valueAsNumber);
      viewer.change({ transfer_function: { gradient: hideFlat(magnitude) } }, event.timeStamp);
    });
    this.#fields = new Fields(byId('panel-body'), viewer);
    this.#clip = new ClipPanel(viewer);
    this.#complaints = new Complaints(byId('panel-body'));
    this.toggle(!window.matchMedia('(max-width: 640px), (max-height: 480px)').matches);
  }

  toggle(isOpen = this.#panel.dataset.open !== 'true') {
    this.#panel.dataset.open = String(isOpen);
    const button = byId('panel-toggle');
    button.setAttribute('aria-expanded', String(isOpen));
    button.setAttribute('aria-label', isOpen ? 'Hide the panel' : 'Show the panel');
    byId('panel-body').hidden = !isOpen;
  }

  #setBackground(text, time) {
    this.#viewer.change({ background: hexToColor(text) }, time);
  }

  /** Shows below a field's control why the daemon refused it. False if no visible control represents the field. */
  complain(pointer, text) {
    return this.#complaints.show(pointer, text);
  }

  /** The largest gradient of the volume's samples; without a list of volumes, of the transfer function's points. */
  get #flatScale() {
    const { volume, view } = this.#viewer;
    if (volume?.range) return quadratic(steepest(volume));
    const { points = [], reference_length: unit = 1 } = view?.transfer_function ?? {};
    return quadratic(points.length ? steepest({ range: [points[0].value, points.at(-1).value], spacing: [unit] }) : 0);
  }

  #showFlat(gradient) {
    const slider = byId('flat');
    const limit = flatLimit(gradient);
    slider.value = this.#flatScale.of(limit ?? gradient.at(-1).magnitude);
    showValue(slider, limit === null ? 'other' : limit === 0 ? 'off' : showNumber(limit));
  }

  showView(view) {
    for (const id of ['picture-section', 'clip-section', 'plane-section', 'moves']) byId(id).inert = !this.#viewer.canControl;
    const color = colorToHex(view.background ?? [0, 0, 0, 1]);
    byId('background').value = color;
    for (const swatch of document.querySelectorAll('.swatches button')) {
      swatch.setAttribute('aria-pressed', String(swatch.dataset.color === color));
    }
    document.body.style.backgroundColor = color;
    byId('shading').checked = view.shading?.mode === 'phong';
    this.#showFlat(view.transfer_function?.gradient);
    this.#fields.show(view);
    this.#clip.show();
    document.title = view.volume ? `${view.volume} — splatd` : 'splatd';
  }

  /** Draws the list; `current` is the id of the shown volume. */
  showVolumes(volumes, current) {
    byId('volumes-section').hidden = volumes.length === 0;
    const key = JSON.stringify([current, volumes.map((v) => [v.id, v.name, describe(v), v.progress])]);
    if (key === this.#key) return;
    this.#key = key;
    const focused = document.activeElement?.closest?.('#volumes button')?.dataset.id;
    this.#list.replaceChildren(...volumes.map((volume) => this.#entry(volume, current)));
    if (focused) [...this.#list.querySelectorAll('button')].find((b) => b.dataset.id === focused)?.focus();
  }

  #entry(volume, current) {
    const item = document.createElement('li');
    const button = document.createElement('button');
    button.type = 'button';
    button.dataset.id = volume.id;
    button.dataset.state = volume.state;
    button.disabled = volume.state !== 'ready';
    if (volume.id === current) button.setAttribute('aria-current', 'true');
    const name = document.createElement('span');
    name.className = 'name';
    name.textContent = volume.name || volume.id;
    const about = document.createElement('span');
    about.className = 'about';
    about.textContent = describe(volume);
    button.append(name, about);
    if (volume.state === 'loading') {
      const progress = document.createElement('progress');
      progress.max = 1;
      progress.value = volume.progress ?? 0;
      progress.setAttribute('aria-label', `Loading ${volume.name || volume.id}`);
      button.append(progress);
    }
    button.addEventListener('click', () => this.#viewer.selectVolume(volume.id));
    item.append(button);
    return item;
  }
}
