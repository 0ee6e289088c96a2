// SPDX-License-Identifier: Apache-2.0
// The session: remembers it for a reload, and passes the notifications of the stream on.
import { t } from '../../core/text.js';
import { rememberSession } from '../shell/address.js';

const NAMES_MAX = 8;

/** Says that the daemon began a new session, so that the links of the guests no longer work. */
function showReplaced({ prompts, panel }) {
  prompts.show('replaced', {
    text: t('connection.replaced'), isUrgent: true,
    actions: [{ label: t('connection.replaced.links'), press: () => panel.reveal('people-fold') }],
  });
}

/** Asks for the token of a session of before that the token of this page does not open. */
function showLocked({ prompts, banner }) {
  prompts.show('locked', {
    text: t('connection.locked'), isUrgent: true,
    actions: [{ label: t('connection.locked.enter'), press: () => banner.askToken() }],
  });
}

/** Says why the picture is not of the volume that the address names. */
function showMissing({ prompts }, { wanted, volume, shown, volumes }) {
  const values = { wanted, shown: shown.name || shown.id };
  const names = volumes.slice(0, NAMES_MAX).map(({ id }) => id).join(', ') + (volumes.length > NAMES_MAX ? ', …' : '');
  prompts.show('missing', {
    text: volume?.reason ? t('connection.volume.failed', { ...values, reason: volume.reason })
      : `${t('connection.volume.unknown', values)} ${t('connection.volume.loaded', { names })}`,
  });
}

function showRenderError({ warp, notice }, { message, pointer }) {
  warp.hide();
  notice.show(t(pointer ? 'render.failed.at' : 'render.failed', { reason: message ?? t('render.noreason'), place: pointer ?? '' }), 'error', 'render');
}

/** Shows why the daemon refused a change of the view: beside its control, or as a notice. */
function showRefused({ panel, notice }, { message, pointer }) {
  if (pointer && panel.complain(pointer, message)) return;
  notice.show(t(pointer ? 'view.refused.at' : 'view.refused', { reason: message, place: pointer ?? '' }), 'warning');
}

export function install(app) {
  const { connection, viewer, participants, prompts, address } = app;
  let hadGuests = false; // in this session

  connection.on('session', (session) => {
    if (!session.isJoined) rememberSession(app, session);
    // The session replaces the address: a reload returns to it.
    if (session.isNew && address.saved) history.replaceState(null, '', location.pathname);
    if (session.replaced && hadGuests) showReplaced(app);
    if (session.isLocked) showLocked(app);
    else prompts.hide('locked');
    if (session.isNew) hadGuests = false;
    viewer.adopt(session);
  });
  connection.on('missing', (missing) => showMissing(app, missing));
  connection.on('fault', app.report);

  /** Notifications of the stream; other modules take the others. */
  const notifications = {
    'view.changed': ({ view, by }) => { if (view && by !== participants.you) viewer.takeShared(view); },
    'session.participants': (params) => {
      participants.takeParticipants(params);
      hadGuests ||= participants.count > 1;
      app.showParticipants();
    },
    'session.control': (params) => {
      participants.takeControl(params);
      app.showParticipants();
    },
    'render.error': (params) => showRenderError(app, params),
  };
  connection.on('notification', ({ method, params }) => notifications[method]?.(params));
  app.frames.on('drawn', () => app.notice.hide('render'));

  viewer.on('refused', (refusal) => showRefused(app, refusal));
  // Opening a link in a tab that already shows the page changes only the hash.
  window.addEventListener('hashchange', () => location.reload());
}
