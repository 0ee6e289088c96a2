// SPDX-License-Identifier: Apache-2.0
// How a client reaches its daemon: the requests and the stream. A host with another way, such as the channel of a notebook's kernel, gives
// <splat-view> a transport of its own. Paths are relative to the address of the daemon.

const SUBPROTOCOL = 'splatd.v1';
const OPEN = 1;

/**
 * @typedef {object} Stream An open stream, or one that opens.
 * @property {(text: string) => void} send sends a message; does nothing unless the stream is open
 * @property {() => void} close ends it; no function of its Hearer is called afterwards
 *
 * @typedef {object} Hearer What a stream calls.
 * @property {() => void} opened it is open
 * @property {(data: string | ArrayBuffer) => void} heard a message: a text, or a frame
 * @property {(code: number, reason: string) => void} closed it ended, or did not open; 1006: without a reason of the daemon
 *
 * @typedef {object} Transport
 * @property {(method: string, path: string, options: RequestInit) => Promise<Response>} request like fetch(). A frame or file may be the body
 *   of the answer; options.signal cancels the request
 * @property {(path: string, token: string, hearer: Hearer) => Stream} open opens the stream of a session
 */

/**
 * The transport of a browser: fetch() and WebSocket. base: address of the daemon, with a slash at its end.
 * @returns {Transport}
 */
export function webTransport({ base, fetch, WebSocket }) {
  return {
    request: (method, path, options) => fetch(new URL(path, base), { method, credentials: 'same-origin', ...options }),
    open(path, token, { opened, heard, closed }) {
      const url = new URL(path, base);
      url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
      url.searchParams.set('token', token);
      const socket = new WebSocket(url.href, [SUBPROTOCOL]);
      socket.binaryType = 'arraybuffer';
      socket.onopen = opened;
      socket.onmessage = ({ data }) => heard(data);
      socket.onclose = ({ code, reason }) => closed(code, reason);
      socket.onerror = () => {};
      return {
        send(text) { if (socket.readyState === OPEN) socket.send(text); },
        close() {
          socket.onopen = socket.onmessage = socket.onclose = null;
          socket.close();
        },
      };
    },
  };
}
