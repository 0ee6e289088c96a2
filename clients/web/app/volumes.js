// SPDX-License-Identifier: Apache-2.0
// The section "Volumes" of the panel: the list of the daemon's volumes, opening and closing them.
import { t } from '../core/text.js';
import { ask } from './ask.js';
import { byId, icon, make, setText } from './dom.js';
import { VolumeInfo } from './volume_info.js';

const LIST_MS = 500;

function describe(volume) {
  if (volume.state === 'failed') return t('volumes.failed', { reason: volume.reason || t('volumes.failed.noreason') });
  if (volume.state === 'loading') return t('volumes.loading', { percent: Math.round((volume.progress ?? 0) * 100) });
  return [volume.dims?.join(' × '), volume.type].filter(Boolean).join(' · ');
}

const nameOf = (volume) => volume.name || volume.id;

/** The button that shows the volume. */
function picker(volume, current, select) {
  const button = make('button', {
    class: 'pick', 'data-id': volume.id, 'data-state': volume.state, 'aria-current': volume.id === current ? 'true' : false,
    disabled: volume.state !== 'ready', press: () => select(volume.id),
  }, make('span', { class: 'name', text: nameOf(volume), title: nameOf(volume) }), make('span', { class: 'about', text: describe(volume) }));
  if (volume.state === 'loading') {
    const progress = make('progress', { max: 1, 'aria-label': t('volumes.loading.name', { name: nameOf(volume) }) });
    progress.value = volume.progress ?? 0;
    button.append(progress);
  }
  return button;
}

/** The whole reason of a failed load, on demand. */
function details(api, volume) {
  const text = make('p', { class: 'details', hidden: true });
  const button = make('button', {
    class: 'link', 'data-id': `details:${volume.id}`, 'aria-expanded': 'false', text: t('volumes.details'),
    press: async () => {
      text.hidden = !text.hidden;
      button.setAttribute('aria-expanded', String(!text.hidden));
      if (text.textContent) return;
      try {
        setText(text, (await api().volume(volume.id)).reason ?? '');
      } catch (error) {
        setText(text, error.message);
      }
    },
  });
  return make('div', { class: 'more' }, button, text);
}

function closeText(volume) {
  const name = nameOf(volume);
  if (volume.state === 'failed') return t('volumes.remove', { name });
  return volume.state === 'loading' ? t('volumes.cancel', { name }) : t('volumes.close', { name });
}

export function install(app) {
  const { connection, viewer, notice } = app;
  const list = byId('volumes');
  const info = new VolumeInfo(app, byId('volume-info'));
  let shown = '';
  let timer = null;
  let seen = null; // the shown volume
  let left = null; // the one before, if the daemon or another participant left it

  function note() {
    const current = viewer.view?.volume;
    if (current === seen) return;
    left = seen;
    seen = current;
  }

  function select(id) {
    viewer.selectVolume(id);
    left = null;
  }

  async function close(volume) {
    const others = app.participants.count > 1;
    if (volume.state === 'ready' && volume.id === viewer.view?.volume && others
        && !await ask(t('volumes.close.ask', { name: nameOf(volume) }), t('volumes.close.act'))) return;
    try {
      await app.api.closeVolume(volume.id);
    } catch (error) {
      if (error.status !== 404) notice.show(t('volumes.close.failed', { name: nameOf(volume), reason: error.message }));
    }
    if (list.contains(document.activeElement)) list.querySelector('button:not(:disabled)')?.focus();
    connection.refresh().catch(() => {}); // the stream reports a lost daemon
  }

  function entry(volume, current, mayClose) {
    const item = make('li', { 'data-state': volume.state }, picker(volume, current, select));
    if (mayClose) {
      const label = closeText(volume);
      const button = make('button', { class: 'close', 'data-id': `close:${volume.id}`, 'aria-label': label, title: label, press: () => close(volume) });
      button.append(icon('x'));
      item.append(button);
    }
    if (volume.state === 'failed') item.append(details(() => app.api, volume));
    return item;
  }

  function show() {
    const { volumes, session } = connection;
    const current = viewer.view?.volume;
    const mayOpen = Boolean(app.api.may.open) && !session?.isJoined;
    byId('open-button').hidden = !mayOpen;
    byId('volumes-section').hidden = volumes.length === 0 && !mayOpen;
    byId('volumes-why').hidden = !session?.isJoined;
    info.show(volumes.find(({ id }) => id === current) ?? null);
    const key = JSON.stringify([current, mayOpen, volumes.map((v) => [v.id, v.name, describe(v), v.progress])]);
    if (key === shown) return;
    shown = key;
    const focused = document.activeElement?.closest?.('#volumes button')?.dataset.id;
    const open = [...list.querySelectorAll('[aria-expanded="true"]')].map((button) => button.dataset.id);
    list.replaceChildren(...volumes.map((volume) => entry(volume, current, mayOpen)));
    for (const button of list.querySelectorAll('button')) {
      if (open.includes(button.dataset.id)) button.click();
      if (focused && button.dataset.id === focused) button.focus();
    }
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

  viewer.on('view', note);
  viewer.on('view', show);
  connection.on('session', show);
  connection.on('volumes', (volumes) => {
    show();
    if (connection.isLive && volumes.some((v) => v.state === 'loading')) refresh();
  });
  connection.on('notification', ({ method, params }) => {
    if (method !== 'volume.progress') return;
    const known = connection.volumes.find(({ id }) => id === params.volume);
    // The daemon may tell the other volume before or after it.
    if (params.state === 'unloaded' && [viewer.view?.volume, left].includes(params.volume)) {
      notice.show(t('volumes.closed', { name: known ? nameOf(known) : params.volume }));
    }
    refresh();
  });
  document.addEventListener('visibilitychange', () => !document.hidden && refresh());
}
