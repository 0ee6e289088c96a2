// SPDX-License-Identifier: Apache-2.0
// V shows the value and the position under the cursor, and offers the surface of that value.
import { canAdd } from '../core/layers.js';
import { t } from '../core/text.js';
import { showNumber } from './fields.js';
import { place } from './pointer.js';

const OFFER_MS = 12000;

export function install(app) {
  const { connection, viewer, screen, notice, prompts, shortcuts } = app;
  let pointer = null;

  function show({ position, value, opacity }) {
    notice.hide('pick');
    prompts.hide('pick');
    if (!position) {
      notice.show(t('pick.nothing', { percent: Math.round(opacity * 100) }), 'info', 'pick');
      return;
    }
    const text = t('pick.value', { value: showNumber(value), place: position.map(showNumber).join(', '), unit: viewer.volume?.unit ?? '' }).trim();
    const { layers } = app;
    const isNew = layers.isEditable && canAdd(layers.list, 'surface') && !layers.list.some((layer) => layer.value === value);
    if (isNew) prompts.show('pick', { text, actions: [{ label: t('pick.surface'), press: () => layers.addSurface(performance.now(), value) }], ms: OFFER_MS });
    else notice.show(text, 'info', 'pick');
  }


  screen.element.addEventListener('pointermove', (event) => { pointer = place(screen.element, event); });
  shortcuts.add('v', async () => {
    const { width, height } = screen.viewport;
    const point = pointer ?? [width / 2, height / 2];
    const at = [point[0] * screen.size[0] / width, point[1] * screen.size[1] / height];
    try {
      show(await connection.call('pick', { at })); // the value belongs to this picture alone
    } catch (error) {
      notice.show(error.message, 'error');
    }
  });
  const forget = () => {
    notice.hide('pick');
    prompts.hide('pick');
  };
  viewer.on('camera', forget);
  viewer.on('view', forget);
}
