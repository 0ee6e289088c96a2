// SPDX-License-Identifier: Apache-2.0
// The session: remembers it for a reload, and hands the notifications of the stream to those that they concern.
import { t } from '../core/text.js';
import { rememberSession } from './address.js';

const NAMES_MAX = 8;

export function install(app) {
  const { connection, viewer, participants, notice, panel, prompts, address, report } = app;
  let hadGuests = false; // in this session

  connection.on('session', (session) => {
    if (!session.isJoined) rememberSession(app, session);
    // The session replaces the address: a reload returns to it.
    if (session.isNew && address.saved) history.replaceState(null, '', location.pathname);
    if (session.replaced && hadGuests) {
      prompts.show('replaced', {
        text: t('connection.replaced'), isUrgent: true,
        actions: [{ label: t('connection.replaced.links'), press: () => panel.reveal('people-fold') }],
      });
    }
    if (session.isLocked) {
      prompts.show('locked', {
        text: t('connection.locked'), isUrgent: true,
        actions: [{ label: t('connection.locked.enter'), press: () => app.banner.askToken() }],
      });
    } else {
      prompts.hide('locked');
    }
    if (session.isNew) hadGuests = false;
    viewer.adopt(session);
  });
  connection.on('missing', ({ wanted, volume, shown, volumes }) => {
    const values = { wanted, shown: shown.name || shown.id };
    const names = volumes.slice(0, NAMES_MAX).map(({ id }) => id).join(', ') + (volumes.length > NAMES_MAX ? ', …' : '');
    prompts.show('missing', {
      text: volume?.reason ? t('connection.volume.failed', { ...values, reason: volume.reason })
        : `${t('connection.volume.unknown', values)} ${t('connection.volume.loaded', { names })}`,
    });
  });
  connection.on('fault', report);
  connection.on('notification', ({ method, params }) => {
    switch (method) {
      case 'view.changed':
        if (params.view && params.by !== participants.you) viewer.takeShared(params.view);
        break;
      case 'session.participants':
        participants.takeParticipants(params);
        hadGuests ||= participants.count > 1;
        break;
      case 'session.control': participants.takeControl(params); break;
      case 'render.error': {
        const values = { reason: params.message ?? t('render.noreason'), place: params.pointer ?? '' };
        app.warp.hide();
        notice.show(t(params.pointer ? 'render.failed.at' : 'render.failed', values), 'render');
        break;
      }
      default: return; // of a newer daemon, or of another module
    }
    if (method.startsWith('session.')) app.showParticipants();
  });
  app.frames.on('drawn', () => notice.hide('render'));

  viewer.on('refused', ({ message, pointer }) => {
    if (pointer && panel.complain(pointer, message)) return;
    notice.show(t(pointer ? 'view.refused.at' : 'view.refused', { reason: message, place: pointer ?? '' }));
  });
  // Opening a link in a tab that already shows the page changes only the hash.
  window.addEventListener('hashchange', () => location.reload());
}
