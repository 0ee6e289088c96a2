// SPDX-License-Identifier: Apache-2.0
// The address of the page: which token, session, volume or saved view it names.
//
// The tab remembers its session: {id, token (for control), daemon (the token of the daemon), asked (the volume of the address)}. A reload
// returns to it, and so does the address of a restarted daemon, which has a new token. The browser remembers the last session of the
// user, without tokens: a new tab with a new token returns to that session, where the guests are.

/** 32 bits of a token, to see that it is another one (FNV-1a). */
function fingerprint(token) {
  let hash = 0x811c9dc5;
  for (const letter of token) hash = Math.imul(hash ^ letter.charCodeAt(0), 0x01000193) >>> 0;
  return hash.toString(16);
}

function parse(text) {
  try {
    return JSON.parse(text ?? 'null');
  } catch {
    return null; // an unreadable entry counts as missing
  }
}

/** {token, session, volume, saved} from the address and from this tab's storage. Removes the token from the address. */
export function readAddress({ recall, remember, recallForever }) {
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
  const volume = get('volume');
  const saved = get('view');
  if (saved) return { token, volume, saved, session: null };
  const own = parse(recall('session'));
  if (own && (!volume || volume === own.asked)) return { token, volume, saved, session: own };
  const last = own || volume || !given ? null : parse(recallForever('session'));
  return { token, volume, saved, session: last && last.daemon !== fingerprint(given) ? { id: last.id } : null };
}

/** Remembers the session of this tab, so that a reload returns to it. */
export function rememberSession({ storage, api, address }, { id, tokens, token }) {
  storage.remember('session', JSON.stringify({ id, token: tokens?.control ?? token, daemon: api.token, asked: address.volume }));
  storage.rememberForever('session', JSON.stringify({ id, daemon: fingerprint(api.token) }));
}
