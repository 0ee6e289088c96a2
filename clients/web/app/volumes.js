// SPDX-License-Identifier: Apache-2.0
// The section "Volumes" of the panel: the list of the daemon's volumes.
import { t } from '../core/text.js';
import { byId, make } from './dom.js';

const LIST_MS = 500;

function describe(volume) {
  if (volume.state === 'failed') return t('volumes.failed', { reason: volume.reason || t('volumes.failed.noreason') });
  if (volume.state === 'loading') return t('volumes.loading', { percent: Math.round((volume.progress ?? 0) * 100) });
  return [volume.dims?.join(' × '), volume.type].filter(Boolean).join(' · ');
}

function entry(volume, current, select) {
  const name = volume.name || volume.id;
  const button = make('button', {
    'data-id': volume.id, 'data-state': volume.state, 'aria-current': volume.id === current ? 'true' : false,
    disabled: volume.state !== 'ready', press: () => select(volume.id),
  }, make('span', { class: 'name', text: name }), make('span', { class: 'about', text: describe(volume) }));
  if (volume.state === 'loading') {
    const progress = make('progress', { max: 1, 'aria-label': t('volumes.loading.name', { name }) });
    progress.value = volume.progress ?? 0;
    button.append(progress);
  }
  return make('li', {}, button);
}

export function install({ connection, viewer }) {
  const list = byId('volumes');
  let shown = '';
  let timer = null;

  function show() {
    const { volumes } = connection;
    const current = viewer.view?.volume;
    byId('volumes-section').hidden = volumes.length === 0;
    const key = JSON.stringify([current, volumes.map((v) => [v.id, v.name, describe(v), v.progress])]);
    if (key === shown) return;
    shown = key;
    const focused = document.activeElement?.closest?.('#volumes button')?.dataset.id;
    list.replaceChildren(...volumes.map((volume) => entry(volume, current, (id) => viewer.selectVolume(id))));
    if (focused) [...list.querySelectorAll('button')].find((b) => b.dataset.id === focused)?.focus();
  }

  function refresh() {
    if (timer || connection.session?.isJoined) return;
    timer = setTimeout(async () => {
      timer = null;
      try {
        if (connection.isLive) await connection.refresh();
      } catch { /* the stream reports a lost daemon */ }
    }, LIST_MS);
  }

  viewer.on('view', show);
  connection.on('volumes', (volumes) => {
    show();
    if (connection.isLive && volumes.some((v) => v.state === 'loading')) refresh();
  });
  connection.on('notification', ({ method }) => method === 'volume.progress' && refresh());
  document.addEventListener('visibilitychange', () => !document.hidden && refresh());
}
