// SPDX-License-Identifier: Apache-2.0
// The banner over the picture follows the state of the connection.
import { t } from '../../core/text.js';

/** Why there is no connection: offline, busy (the daemon is over a limit), or lost. */
function whyLost(error) {
  if (!navigator.onLine) return 'offline';
  return error?.status === 503 || error?.status === 429 ? 'busy' : 'lost';
}

/** There is no volume to show: one is loading, all failed, or there are none. */
function showWaiting({ banner, connection, api }) {
  const { volumes } = connection;
  const canOpen = Boolean(api.may.open);
  const loading = volumes.find((v) => v.state === 'loading');
  const failed = volumes.find((v) => v.state === 'failed');
  if (loading) {
    banner.show({ kind: 'wait', title: t('banner.loading', { name: loading.name || loading.id }), progress: loading.progress ?? 0 });
  } else if (failed) {
    banner.show({
      kind: 'error', title: t('banner.failed', { name: failed.name || failed.id }), text: failed.reason || t('banner.failed.noreason'), canOpen,
    });
  } else {
    banner.show({ kind: 'wait', title: t('banner.empty'), text: t(canOpen ? 'banner.empty.open' : 'banner.empty.text'), canOpen });
  }
}

function showRefused({ banner, connection }, error) {
  if (error?.status === 401 && !connection.session?.isJoined) {
    const title = t(connection.api.token ? 'banner.token.wrong' : 'banner.token.missing');
    banner.show({ kind: 'error', title, text: t('banner.token.text'), asksToken: true });
  } else {
    banner.show({ kind: 'error', title: t('banner.refused'), text: error?.message ?? '', canRetry: true, asksToken: error?.status === 403 });
  }
}

/** Shows the state of the connection, as the event "state" of core/connection.js tells it. */
function show(app, { state, reason, retryMs, error }) {
  const { banner, frames } = app;
  switch (state) {
    case 'live':
      if (frames.hasPicture) banner.hide();
      else banner.show({ kind: 'busy', title: t('banner.first') });
      break;
    case 'waiting': showWaiting(app); break;
    case 'draining': banner.show({ kind: 'lost', title: t('banner.draining'), text: reason }); break;
    case 'lost': banner.showLost(reason, retryMs, whyLost(error)); break;
    case 'refused': showRefused(app, error); break;
    default: // After a lost connection the banner stays until a frame arrives.
      if (!frames.hasPicture) banner.show({ kind: 'busy', title: t('banner.connecting') });
  }
}

export function install(app) {
  const { connection, frames, warp, viewer, participants } = app;
  let last = { state: 'idle', reason: '', retryMs: 0, error: null };

  connection.on('state', (change) => {
    last = change;
    if (change.state !== 'live') warp.hide();
    if (change.state === 'live') {
      participants.reset();
      viewer.resume();
    } else if (change.state === 'lost' || change.state === 'refused') {
      viewer.suspend();
    }
    show(app, last);
  });
  connection.on('volumes', () => connection.state === 'waiting' && showWaiting(app));
  frames.on('drawn', () => frames.drawn.count === 1 && show(app, last));
  window.addEventListener('online', () => connection.retryNow());
  window.addEventListener('offline', () => last.state === 'lost' && show(app, last));
  document.addEventListener('visibilitychange', () => !document.hidden && last.state === 'lost' && connection.retryNow());
  show(app, last);
}
