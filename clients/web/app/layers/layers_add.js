// SPDX-License-Identifier: Apache-2.0
// The button "Add from a volume …" and its dialog: the loaded volumes whose elements a layer can show, and files.
import { contentsText } from '../../core/kinds.js';
import { canAdd } from '../../core/layers.js';
import { t } from '../../core/text.js';
import { fullNameOf } from '../../core/volume_names.js';
import { byId, icon, make } from '../controls/dom.js';

export class LayerAdder {
  #app; #layers; #added;
  #dialog = byId('add-layer');
  #index = null; // of the layer that gets another volume; null = a new one

  /** added(add) calls add() and shows the new layer. */
  constructor(app, layers, added) {
    this.#app = app;
    this.#layers = layers;
    this.#added = added;
    this.button = make('button', { id: 'layer-add-elements', text: t('layers.add.elements'), title: t('layers.add.elements.title'), press: () => this.show(null) });
    byId('add-layer-close').addEventListener('click', () => this.#dialog.close());
    byId('add-layer-open').addEventListener('click', () => {
      const index = this.#index;
      this.#dialog.close();
      app.open((volume) => this.#take(volume, index));
    });
  }

  /** A guest gets no list of volumes. */
  follow() {
    this.button.hidden = Boolean(this.#app.connection.session?.isJoined);
    this.button.disabled = !canAdd(this.#layers.list, 'points');
  }

  /** Shows the dialog for a new layer, or for one that gets another volume. */
  show(index) {
    const { sources } = this.#layers;
    this.#index = index;
    byId('add-layer-list').replaceChildren(...sources.map((volume) => make('li', {}, this.#choice(volume))));
    byId('add-layer-none').hidden = sources.length > 0;
    byId('add-layer-open').hidden = !this.#app.mayOpen;
    this.#dialog.showModal();
  }

  #choice(volume) {
    const { connection, viewer } = this.#app;
    const about = [contentsText(volume), volume.id === viewer.view.volume ? t('layers.add.current') : ''].filter(Boolean).join(' · ');
    return make('button', {
      'data-id': volume.id,
      press: () => {
        this.#dialog.close();
        this.#take(volume, this.#index);
      },
    }, icon('box'), make('span', { class: 'name', text: fullNameOf(volume, connection.volumes) }), make('span', { class: 'about', text: about }));
  }

  #take(volume, index) { this.#added(() => this.#layers.addVolume(volume, performance.now(), index)); }
}
