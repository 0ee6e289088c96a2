// SPDX-License-Identifier: Apache-2.0
// The controls of the transfer function for colour maps: which map, its range, reversed, in steps.
import { MAP_NAMES, STEPS_MAX } from '../../core/color_maps.js';
import { t } from '../../core/text.js';
import { byId } from '../controls/dom.js';

const OWN = ''; // the choice "colours of the points"
const IMPORTED = 'custom';
const RANGE = ['transfer-map-low', 'transfer-map-high'];

export function install({ transfer }) {
  const maps = new ColorMaps(transfer);
  transfer.onShow(() => maps.show());
}

class ColorMaps {
  #transfer;
  #imported = null; // {name, table}
  #choice = byId('transfer-map');

  constructor(transfer) {
    this.#transfer = transfer;
    this.#choice.replaceChildren(new Option(t('transfer.map.points'), OWN), ...MAP_NAMES.map((id) => new Option(t(`map.${id}`), id)));
    this.#choice.addEventListener('change', ({ timeStamp }) => this.#use(this.#choice.value, timeStamp));
    byId('transfer-reverse').addEventListener('change', ({ target, timeStamp }) => transfer.changeMap({ isReversed: target.checked }, timeStamp));
    const steps = byId('transfer-steps');
    steps.max = STEPS_MAX;
    steps.addEventListener('change', ({ timeStamp }) => {
      transfer.changeMap({ steps: Math.round(Math.min(STEPS_MAX, Math.max(0, steps.valueAsNumber || 0))) }, timeStamp);
    });
    RANGE.forEach((id, i) => byId(id).addEventListener('change', ({ target, timeStamp }) => this.#setEnd(i, target.valueAsNumber, timeStamp)));
  }

  #use(id, time) {
    if (id === OWN) this.#transfer.endMap(time);
    else this.#transfer.useMap(id === IMPORTED ? this.#imported : { name: id, table: null }, time);
  }

  /** Sets one end of the range; a range that is empty or no number changes nothing. */
  #setEnd(end, value, time) {
    const range = this.#transfer.state?.map?.range.map((old, i) => (i === end ? value : old));
    if (range?.every(Number.isFinite) && range[1] > range[0]) this.#transfer.changeMap({ range }, time);
    this.#transfer.plan();
  }

  show() {
    const { map } = this.#transfer.state;
    if (map?.table) this.#imported = { name: map.name, table: map.table };
    this.#showChoice(map);
    for (const id of ['transfer-map-shape', 'transfer-map-range']) byId(id).hidden = !map;
    if (!map) return;
    byId('transfer-reverse').checked = map.isReversed;
    for (const [id, value] of [['transfer-steps', map.steps], [RANGE[0], map.range[0]], [RANGE[1], map.range[1]]]) {
      if (document.activeElement !== byId(id) || byId(id).valueAsNumber === value) byId(id).value = Number(value.toPrecision(6));
    }
  }

  /** The last imported map stays among the choices. */
  #showChoice(map) {
    let option = [...this.#choice.options].find(({ value }) => value === IMPORTED);
    if (this.#imported && !option) this.#choice.add(option = new Option('', IMPORTED));
    if (option) option.text = this.#imported.name || t('transfer.map.imported');
    this.#choice.value = map ? (map.table ? IMPORTED : map.name) : OWN;
  }
}
