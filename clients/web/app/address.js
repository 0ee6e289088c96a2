// SPDX-License-Identifier: Apache-2.0
// The address of the page: which token, session, volume or saved view it names.

/** {token, session, volume, saved} from the address and from this tab's storage. Removes the token from the address. */
export function readAddress({ recall, remember }) {
  const query = new URLSearchParams(location.search);
  const hash = new URLSearchParams(location.hash.slice(1));
  const get = (name) => query.get(name) ?? hash.get(name);
  const id = get('session');
  const given = get('token');
  if (given) {
    remember(id ? `join:${id}` : 'token', given);
    query.delete('token');
    hash.delete('token');
    const tail = (mark, params) => (String(params) ? mark + params : '');
    history.replaceState(null, '', location.pathname + tail('?', query) + tail('#', hash));
  }
  const token = recall('token') ?? '';
  if (id) return { token, volume: null, saved: null, session: { id, token: recall(`join:${id}`) ?? token, isJoined: true } };
  let session = null;
  try {
    session = JSON.parse(recall('session') ?? 'null');
  } catch { /* an unreadable entry counts as missing */ }
  const volume = get('volume');
  const isStale = volume || (given && given !== session?.daemon);
  const saved = get('view');
  return { token, volume, saved, session: isStale || saved ? null : session };
}

/** Remembers the session of this tab, so that a reload returns to it. */
export function rememberSession(app, { id, tokens, token }) {
  app.storage.remember('session', JSON.stringify({ id, token: tokens?.control ?? token, daemon: app.api.token }));
}
