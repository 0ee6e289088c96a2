// SPDX-License-Identifier: Apache-2.0
// How a notebook's page reaches the daemon: by a WebSocket to its own address, by one through jupyter-server-proxy, or through the kernel.

const WAIT_MS = 3000;
const SUBPROTOCOL = 'splatd.v1';

const isLoopback = (host) => /^(localhost|127\.\d+\.\d+\.\d+|\[::1\])$/.test(host);

/** The address of the Jupyter server that serves this page, or null: another program shows the notebook. */
function jupyterBase() {
  try {
    const data = document.getElementById('jupyter-config-data')?.textContent;
    const base = data ? JSON.parse(data).baseUrl : document.body.dataset.baseUrl;
    return base ? new URL(base, location.href).href : null;
  } catch {
    return null;
  }
}

/** The addresses to try, and why others are left out: [{url, name}, {why}, …] */
function addresses({ url, port }) {
  const ways = [];
  const direct = url && new URL(url);
  if (!direct) ways.push({ why: 'the daemon has no address for browsers' });
  // A loopback address means this computer, which is another one than that of the kernel if the page comes from elsewhere.
  else if (isLoopback(direct.hostname) && !isLoopback(location.hostname)) ways.push({ why: `${direct.host} is on the computer of the kernel` });
  else if (direct.protocol === 'http:' && location.protocol === 'https:' && !isLoopback(direct.hostname)) ways.push({ why: `${direct.host} has no HTTPS` });
  else ways.push({ url: direct.href, name: direct.host });
  const base = jupyterBase();
  if (base && port) ways.push({ url: new URL(`proxy/${port}/`, base).href, name: 'jupyter-server-proxy' });
  else if (port) ways.push({ why: 'no Jupyter server has served the page' });
  return ways;
}

function openOnce(url, session, token) {
  const address = new URL(`api/v1/sessions/${encodeURIComponent(session)}/stream`, url);
  address.protocol = address.protocol === 'https:' ? 'wss:' : 'ws:';
  address.searchParams.set('token', token);
  return new Promise((resolve, reject) => {
    const socket = new WebSocket(address.href, [SUBPROTOCOL]);
    const timer = setTimeout(() => {
      reject(new Error('no WebSocket in time'));
      socket.close();
    }, WAIT_MS);
    socket.onopen = () => {
      clearTimeout(timer);
      resolve();
      socket.close();
    };
    socket.onerror = () => {
      clearTimeout(timer);
      reject(new Error('no WebSocket'));
    };
  });
}

/** Asks for the session, and opens its stream once. Rejects with the reason why one of them fails. */
async function check(url, { session, token }) {
  let answer;
  try {
    answer = await fetch(new URL(`api/v1/sessions/${encodeURIComponent(session)}?token=${encodeURIComponent(token)}`, url), {
      cache: 'no-store', credentials: 'same-origin', signal: AbortSignal.timeout(WAIT_MS),
    });
  } catch {
    throw new Error('no answer');
  }
  const about = answer.ok && await answer.json().catch(() => null);
  if (about?.id !== session) throw new Error(answer.ok ? 'another program answers' : `status ${answer.status}`);
  await openOnce(url, session, token);
}

/**
 * Resolves to the address for fetch() and WebSocket, or to '' for the kernel, and why: {url, why}. welcome: {session, token, url, port,
 * transport: 'auto', 'websocket' or 'kernel'}.
 */
export async function chooseWay(welcome) {
  if (welcome.transport === 'kernel') return { url: '', why: 'as asked' };
  const reasons = [];
  for (const { url, name, why } of addresses(welcome)) {
    if (!url) {
      reasons.push(why);
      continue;
    }
    try {
      await check(url, welcome);
      return { url, why: [...reasons, `${name} answers`].join('; ') };
    } catch (error) {
      reasons.push(`${name}: ${error.message}`);
    }
  }
  if (welcome.transport === 'websocket') throw new Error(`no WebSocket reaches the daemon: ${reasons.join('; ')}`);
  return { url: '', why: reasons.join('; ') };
}
