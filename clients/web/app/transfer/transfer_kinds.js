// SPDX-License-Identifier: Apache-2.0
// Transfer functions by kind of data, placed by the histogram, and the default of the daemon.
import { KINDS, presetOf } from '../../core/tissue.js';
import { t } from '../../core/text.js';
import { byId } from '../controls/dom.js';
import { tellIfNothing } from '../rendering/nothing_visible.js';

export function install(app) {
  const { transfer, api, prompts, viewer } = app;
  const choice = byId('transfer-kind');
  let volume = null;
  let placed = null; // the points that the chosen kind set

  const isPlaced = () => transfer.volume === volume && JSON.stringify(transfer.state.points) === placed;

  function usePreset(kind, time) {
    const { points, map, note } = presetOf(kind, transfer.histogram, transfer.unit, viewer.volume?.meaning);
    const range = [points[0].value, points.at(-1).value];
    transfer.replace({ points, gradient: [], map: map && { name: map, table: null, isReversed: false, steps: 0, range } },
      time, `${note[0].toUpperCase()}${note.slice(1)}.`);
    placed = JSON.stringify(transfer.state.points);
    prompts.hide('kind');
    tellIfNothing(app, { id: 'kind', text: t('kind.nothing', { kind: t(`kind.${kind}`) }), isLate: () => !isPlaced() });
  }

  async function useDefault(time) {
    const of = transfer.volume;
    try {
      const { points, gradient } = (await api.volumeView(of)).transfer_function;
      if (of !== transfer.volume) return;
      transfer.replace({ points, gradient }, time);
      placed = JSON.stringify(transfer.state.points);
      prompts.hide('kind');
      choice.value = 'default';
    } catch (error) {
      choice.value = '';
      transfer.tell(t('transfer.default.failed', { reason: error.message }));
    }
  }

  choice.append(...KINDS.map((id) => new Option(t(`kind.${id}`), id)));
  choice.addEventListener('change', ({ timeStamp }) => {
    if (choice.value === 'default') useDefault(timeStamp);
    else if (KINDS.includes(choice.value) && transfer.histogram) usePreset(choice.value, timeStamp);
  });
  transfer.onShow(() => {
    choice.disabled = !transfer.histogram;
    if (transfer.volume === volume && (!choice.value || isPlaced())) return;
    prompts.hide('kind');
    if (choice.value && transfer.volume === volume) transfer.tell(''); // the note was about the kind
    choice.value = '';
    volume = transfer.volume;
  });
}
