// SPDX-License-Identifier: Apache-2.0
// The choices "Field" and "Vectors" below the list of volumes, if the file of the shown volume has several: load others of it, and show them
// under the same camera. Who may not load them sees which one is shown.
import { t } from '../../core/text.js';
import { make } from '../controls/dom.js';

class Choice {
  #select;
  #shown = '';
  #own = '';

  /** key: of the text; load(name): the user chose a name. */
  constructor(key, load) {
    const id = `volume-${key}`;
    this.#select = make('select', { id });
    this.#select.addEventListener('change', () => {
      const { value } = this.#select;
      this.#select.value = this.#own; // until it is shown
      load(value);
    });
    this.root = make('div', { class: 'row', hidden: true, title: t(`volumes.${key}.title`) }, make('label', { for: id, text: t(`volumes.${key}`) }), this.#select);
  }

  show(own, others, isEnabled) {
    this.#own = own;
    this.root.hidden = others.length === 0;
    this.#select.disabled = !isEnabled;
    const shown = JSON.stringify([own, others]);
    if (shown !== this.#shown) {
      this.#shown = shown;
      this.#select.replaceChildren(...[own, ...others].map((name) => new Option(name)));
    }
    this.#select.value = own;
  }
}

export class VolumeField {
  #app;
  #volume = null;
  #field = new Choice('field', (field) => this.#open({ field }));
  #vectors = new Choice('vectors', (vectors) => this.#open({ vectors }));

  constructor(app) {
    this.#app = app;
    this.root = make('div', {}, this.#field.root, this.#vectors.root);
  }

  /** The shown volume, as in the list; null = unknown. */
  show(volume) {
    const { mayOpen, viewer } = this.#app;
    const [values, vectors] = volume?.fields ?? [];
    const mayChange = mayOpen && viewer.canControl;
    this.#volume = volume;
    this.#field.show(values?.name ?? '', volume?.other_fields ?? [], mayChange);
    this.#vectors.show(vectors?.name ?? '', volume?.other_vectors ?? [], mayChange);
  }

  async #open(names) {
    const { api, notice, openVolume, viewer } = this.#app;
    const { id } = this.#volume;
    try {
      openVolume(await api.openVolume({ volume: id, ...names }), async (other) => {
        const view = await api.volumeView(other.id);
        if (viewer.view?.volume !== id) return;
        const { camera, clip, slices } = viewer.view;
        const { window } = view.slices; // of the values
        viewer.restore({ ...view, camera, clip, slices: { ...slices, window } }, performance.now());
      });
    } catch (error) {
      notice.show(t('volumes.field.failed', { field: names.field ?? names.vectors, reason: error.message }), 'error', 'open');
    }
  }
}
