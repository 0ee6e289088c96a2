// SPDX-License-Identifier: Apache-2.0
// Transfer functions by kind of data, placed by the histogram, and the default of the daemon.
import { KINDS, presetOf } from '../core/tissue.js';
import { t } from '../core/text.js';
import { byId } from './dom.js';

export function install({ transfer, api }) {
  const choice = byId('transfer-kind');
  let volume = null;

  function usePreset(kind, time) {
    const { points, map, note } = presetOf(kind, transfer.histogram);
    const range = [points[0].value, points.at(-1).value];
    transfer.replace({ points, gradient: [], map: map && { name: map, table: null, isReversed: false, steps: 0, range } },
      time, `${note[0].toUpperCase()}${note.slice(1)}.`);
  }

  async function useDefault(time) {
    const of = transfer.volume;
    try {
      const { points, gradient } = (await api.volumeView(of)).transfer_function;
      if (of === transfer.volume) transfer.replace({ points, gradient }, time);
    } catch (error) {
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
    if (transfer.volume !== volume) choice.value = '';
    volume = transfer.volume;
  });
}
