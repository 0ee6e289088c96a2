// SPDX-License-Identifier: Apache-2.0
// V shows the value, where there is one, and the position under the cursor, and offers the surface of that value.
import { canAdd } from '../../core/layers.js';
import { dataText } from '../../core/lengths.js';
import { t } from '../../core/text.js';
import { placeOf } from '../../core/vertical.js';
import { place } from '../camera/pointer.js';

const OFFER_MS = 12000;
const REST_MS = 200;

export function install(app) {
  const { connection, viewer, screen, notice, prompts, shortcuts, status } = app;
  let pointer = null;

  function show({ position, value, opacity }) {
    notice.hide('pick');
    prompts.hide('pick');
    if (!position) {
      notice.show(t('pick.nothing', { percent: Math.round(opacity * 100) }), 'info', 'pick');
      return;
    }
    const { transfer } = app;
    const where = placeOf(viewer.volume, position, viewer.extent);
    const hasValue = Number.isFinite(value);
    const text = (hasValue ? t('pick.value', { value: dataText(value, transfer.range, transfer.unit), ...where }) : t('pick.place', where)).trim();
    const { layers } = app;
    const isNew = hasValue && viewer.kind === 'grid' && layers.isEditable && canAdd(layers.list, 'surface') && !layers.list.some((layer) => layer.value === value);
    if (isNew) prompts.show('pick', { text, actions: [{ label: t('pick.surface'), press: () => layers.addSurface(performance.now(), value) }], ms: OFFER_MS });
    else notice.show(text, 'info', 'pick');
  }

  screen.element.addEventListener('pointermove', (event) => { pointer = place(screen.element, event); });
  shortcuts.add('v', async () => {
    const { width, height } = screen.viewport;
    const point = pointer ?? [width / 2, height / 2];
    try {
      show(await connection.call('pick', screen.pickAt(point))); // the value belongs to this picture alone
    } catch (error) {
      notice.show(error.message, 'error');
    }
  });
  // The status line tells the value where the pointer rests, of the view that is shown.
  let timer = 0;
  let asked = 0;
  let over = null; // where the mouse is in the picture
  const tell = async (at) => {
    const own = ++asked;
    try {
      const { position, value } = await connection.call('pick', screen.pickAt(at));
      if (own === asked) status.setValue(position && Number.isFinite(value) ? dataText(value, app.transfer.range, app.transfer.unit) : '');
    } catch { /* the next rest of the pointer asks again */ }
  };
  const restart = () => {
    clearTimeout(timer);
    asked += 1;
    status.setValue('');
    if (over && connection.isLive && viewer.kind === 'grid') timer = window.setTimeout(tell, REST_MS, over);
  };
  const hover = (event) => {
    const isOver = event.type === 'pointermove' && event.pointerType === 'mouse' && event.buttons === 0;
    over = isOver ? place(screen.element, event) : null;
    restart();
  };
  for (const type of ['pointermove', 'pointerleave', 'pointerdown', 'wheel']) screen.element.addEventListener(type, hover, { passive: true });
  const forget = () => {
    notice.hide('pick');
    prompts.hide('pick');
    if (over) restart(); // else the status line shows a value of a slice
  };
  viewer.on('camera', forget);
  viewer.on('view', forget);
}

/** {position, value} below a point of the 3-D picture, or null. */
export async function pickAt({ connection, screen, notice }, at) {
  try {
    const found = await connection.call('pick', screen.pickAt(at));
    if (!found.position) notice.show(t('measure.nothing'));
    return found.position ? found : null;
  } catch (error) {
    notice.show(error.message, 'error');
    return null;
  }
}
