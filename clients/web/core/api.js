// SPDX-License-Identifier: Apache-2.0
// The daemon's HTTP interface, as far as the page needs it. All addresses are relative to `base`.

/** Why a request failed: `status` 0 = no answer at all; else HTTP's, with what the problem document says. */
export class ApiError extends Error {
  name = 'ApiError';
  constructor(status, message, { pointer = '', retryAfter = 0 } = {}) {
    super(message);
    this.status = status;
    this.pointer = pointer;
    this.retryAfter = retryAfter;
  }
}

const TIMEOUT_MS = 10000;

export class Api {
  #base; #fetch;
  token;

  constructor({ base, token, fetch }) {
    this.#base = base;
    this.#fetch = fetch;
    this.token = token;
  }

  async volumes() {
    const { volumes } = await this.#request('GET', 'api/v1/volumes');
    if (!Array.isArray(volumes)) throw new ApiError(200, 'the list of volumes is not a list');
    return volumes;
  }

  /** The full default view of a volume. */
  volumeView(id) {
    return this.#request('GET', `api/v1/volumes/${encodeURIComponent(id)}/view`);
  }

  /** {id, tokens: {control, view}, view} */
  createSession(view) {
    return this.#request('POST', 'api/v1/sessions', { body: { view } });
  }

  /** A session that begins with the view of another one or with a kept view; `token`: the daemon's or, to fork, its control token. */
  sessionFrom(id, token = this.token) {
    return this.#request('POST', 'api/v1/sessions', { body: { from: id }, token });
  }

  /** {id}: a name for this view, for links. */
  keepView(view) {
    return this.#request('POST', 'api/v1/views', { body: view });
  }

  /** Names. */
  async presets() {
    const { presets } = await this.#request('GET', 'api/v1/presets');
    if (!Array.isArray(presets)) throw new ApiError(200, 'the list of presets is not a list');
    return presets;
  }

  /** A part of a view. */
  preset(name) {
    return this.#request('GET', `api/v1/presets/${encodeURIComponent(name)}`);
  }

  putPreset(name, patch) {
    return this.#request('PUT', `api/v1/presets/${encodeURIComponent(name)}`, { body: patch });
  }

  deletePreset(name) {
    return this.#request('DELETE', `api/v1/presets/${encodeURIComponent(name)}`);
  }

  session(id, token) {
    return this.#request('GET', `api/v1/sessions/${encodeURIComponent(id)}`, { token });
  }

  /** Address of a session's stream. */
  streamUrl(id, token) {
    const url = new URL(`api/v1/sessions/${encodeURIComponent(id)}/stream`, this.#base);
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    url.searchParams.set('token', token);
    return url.href;
  }

  async #request(method, path, { body, token = this.token } = {}) {
    const headers = { Accept: 'application/json' };
    if (token) headers.Authorization = `Bearer ${token}`;
    if (body) headers['Content-Type'] = 'application/json';
    const fetch = this.#fetch;
    let answer;
    let text;
    try {
      answer = await fetch(new URL(path, this.#base), {
        method, headers, body: body && JSON.stringify(body), cache: 'no-store', credentials: 'same-origin',
        signal: AbortSignal.timeout(TIMEOUT_MS),
      });
      text = await answer.text();
    } catch (error) {
      throw new ApiError(0, error.name === 'TimeoutError'
        ? `no answer within ${TIMEOUT_MS / 1000} s` : 'the daemon does not answer');
    }
    let json = null;
    try {
      if (text || !answer.ok) json = JSON.parse(text);
    } catch {
      if (answer.ok) throw new ApiError(answer.status, `the answer to ${method} ${path} is not JSON`);
    }
    if (answer.ok) return json;
    throw new ApiError(answer.status, json?.detail || json?.title || `${method} ${path}: status ${answer.status}`, {
      pointer: json?.pointer ?? '', retryAfter: Number(answer.headers.get('Retry-After')) || 0,
    });
  }
}
