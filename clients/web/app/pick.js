// SPDX-License-Identifier: Apache-2.0
// V shows the value and the position under the cursor.
import { t } from '../core/text.js';
import { showNumber } from './fields.js';
import { place } from './pointer.js';

export function install({ connection, viewer, screen, notice, shortcuts }) {
  let pointer = null;
  screen.element.addEventListener('pointermove', (event) => { pointer = place(screen.element, event); });
  shortcuts.add('v', async () => {
    const { width, height } = screen.viewport;
    const point = pointer ?? [width / 2, height / 2];
    const at = [point[0] * screen.size[0] / width, point[1] * screen.size[1] / height];
    try {
      const { position, value, opacity } = await connection.call('pick', { at });
      notice.show(position // the value belongs to this picture alone
        ? t('pick.value', { value: showNumber(value), place: position.map(showNumber).join(', '), unit: viewer.volume?.unit ?? '' }).trim()
        : t('pick.nothing', { percent: Math.round(opacity * 100) }), 'info', 'pick');
    } catch (error) {
      notice.show(error.message, 'error');
    }
  });
  const forget = () => notice.hide('pick');
  viewer.on('camera', forget);
  viewer.on('view', forget);
}
