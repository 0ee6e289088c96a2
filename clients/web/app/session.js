// SPDX-License-Identifier: Apache-2.0
// The session: remembers it for a reload, and hands the notifications of the stream to those that they concern.
import { t } from '../core/text.js';
import { rememberSession } from './address.js';

export function install(app) {
  const { connection, viewer, participants, notice, panel, address, report } = app;

  connection.on('session', (session) => {
    if (session.isNew) {
      rememberSession(app, session);
      // The session replaces the address: a reload returns to it.
      if (address.saved) history.replaceState(null, '', location.pathname);
    }
    viewer.adopt(session);
  });
  connection.on('fault', report);
  connection.on('notification', ({ method, params }) => {
    switch (method) {
      case 'view.changed':
        if (params.view && params.by !== participants.you) viewer.takeShared(params.view);
        break;
      case 'session.participants': participants.takeParticipants(params); break;
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
