// SPDX-License-Identifier: Apache-2.0
// The part of the daemon's HTTP interface that the page uses.
import { eventReader } from './events.js';
import { readSlice } from './slice_image.js';
import { t } from './text.js';

/** A failed request: the HTTP status, or 0 without an answer, and the text of the problem document. */
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

/** The path of a session's stream. */
export const streamPath = (id) => `api/v1/sessions/${encodeURIComponent(id)}/stream`;

export class Api {
  #base; #transport;
  #reasons = new Map(); // of failed loads in full: id → {short, reason}
  token;
  /** The session {id, token} that this client joined by a join token. The token reads the volumes of this session only. null = all volumes of the daemon. */
  joined = null;
  /** What the token may do with volumes: {open, browse, upload, remote}; known after volumes(). */
  may = {};

  /** base: address of the daemon, for links; transport: see transport.js. */
  constructor({ base, token, transport }) {
    this.#base = base;
    this.#transport = transport;
    this.token = token;
  }

  async volumes() {
    const { volumes, may = {} } = await this.#read('volumes');
    if (!Array.isArray(volumes)) throw new ApiError(200, t('api.notlist'));
    this.may = may;
    return Promise.all(volumes.map((volume) => this.#explained(volume)));
  }

  /** Reads what is below the daemon, or below the session for a guest. */
  #read(path) {
    const { id, token } = this.joined ?? {};
    return id ? this.#request('GET', `api/v1/sessions/${encodeURIComponent(id)}/${path}`, { token }) : this.#request('GET', `api/v1/${path}`);
  }

  /** The volume; if its load failed, with the whole reason, which the list shortens. */
  async #explained(volume) {
    const { id, state, reason: short } = volume;
    if (state !== 'failed' || !short) {
      this.#reasons.delete(id);
      return volume;
    }
    if (this.#reasons.get(id)?.short !== short) {
      const whole = await this.volume(id).catch(() => null); // it was removed meanwhile
      this.#reasons.set(id, { short, reason: whole?.reason || short });
    }
    return { ...volume, reason: this.#reasons.get(id).reason };
  }

  /** A volume with all that is known of it. */
  volume(id) {
    return this.#read(`volumes/${encodeURIComponent(id)}`);
  }

  /** Loads {source} or {upload}; resolves to the volume, which may still be loading. */
  openVolume(what) {
    return this.#request('POST', 'api/v1/volumes', { body: what });
  }

  closeVolume(id) {
    return this.#request('DELETE', `api/v1/volumes/${encodeURIComponent(id)}`);
  }

  /** A page of a folder of the data folder: {entries, next}. */
  files(path, after = '') {
    const query = new URLSearchParams({ path, limit: 500, ...(after ? { after } : {}) });
    return this.#request('GET', `api/v1/files?${query}`);
  }

  /** What has all words of a text in its name, in a folder and below it: {entries, unread, cut}. Takes seconds for thousands of folders. */
  findFiles(path, find) {
    return this.#request('GET', `api/v1/files?${new URLSearchParams({ path, find, limit: 200 })}`);
  }

  /** The DICOM series of a folder of the data folder: {series}. Takes seconds for thousands of files. */
  series(path) {
    return this.#request('GET', `api/v1/files/series?${new URLSearchParams({ path })}`);
  }

  /** {uploads, bytes, bytes_max, bytes_free, uploads_free} */
  uploads() {
    return this.#request('GET', 'api/v1/uploads');
  }

  /** Begins an upload of a File: {id, name, bytes, offset}. header: the upload of the header that names this file, or null. */
  createUpload({ name, size, lastModified }, header = null) {
    return this.#request('POST', 'api/v1/uploads', { body: { name, bytes: size, ...lastModified > 0 && { modified: lastModified }, ...header && { header } } });
  }

  upload(id) {
    return this.#request('GET', `api/v1/uploads/${encodeURIComponent(id)}`);
  }

  deleteUpload(id) {
    return this.#request('DELETE', `api/v1/uploads/${encodeURIComponent(id)}`);
  }

  /** Sends a part of an upload, and resolves to the new offset. checksum: the value of Upload-Checksum, or ''. */
  async sendPart(id, offset, part, { checksum = '', signal } = {}) {
    const path = `api/v1/uploads/${encodeURIComponent(id)}`;
    const headers = { 'Content-Type': 'application/offset+octet-stream', 'Tus-Resumable': '1.0.0', 'Upload-Offset': String(offset) };
    if (checksum) headers['Upload-Checksum'] = checksum;
    if (this.token) headers.Authorization = `Bearer ${this.token}`;
    const answer = await this.#transport.request('PATCH', path, { headers, body: part, signal });
    const text = await answer.text();
    if (!answer.ok) throw this.#refusal(answer, `PATCH ${path}`, text);
    return Number(answer.headers.get('Upload-Offset'));
  }

  /** The complete default view of a volume. */
  volumeView(id) {
    return this.#read(`volumes/${encodeURIComponent(id)}/view`);
  }

  /** {id, tokens: {control, view}, view} */
  createSession(view) {
    return this.#request('POST', 'api/v1/sessions', { body: { view } });
  }

  /** Creates a session from the view of another session or from a saved view. `token` is the daemon's or, to fork, the control token of that session. */
  sessionFrom(id, token = this.token) {
    return this.#request('POST', 'api/v1/sessions', { body: { from: id }, token });
  }

  /** Saves a view for links; resolves to {id}. */
  saveView(view) {
    return this.#request('POST', 'api/v1/views', { body: view });
  }

  /** Names of all presets. */
  async presets() {
    const { presets } = await this.#request('GET', 'api/v1/presets');
    if (!Array.isArray(presets)) throw new ApiError(200, t('api.notlist'));
    return presets;
  }

  /** A preset, which is a part of a view. */
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

  /** The histogram of the volume that the session shows: of its values, or of values and gradients together. */
  histogram(id, token, isJoint) {
    const what = `api/v1/sessions/${encodeURIComponent(id)}/histogram?axis=value${isJoint ? ',gradient' : ''}`;
    return this.#request('GET', what, { token });
  }

  /** The part of the volume that the view of the session leaves visible: {visible, box, center, half, radius}. */
  visiblePart(id, token) {
    return this.#request('GET', `api/v1/sessions/${encodeURIComponent(id)}/visible`, { token });
  }

  /** A slice of the volume that the session shows: {meta, values}. query: see GET /sessions/{id}/slice. */
  async slice(id, token, query, signal) {
    const what = `api/v1/sessions/${encodeURIComponent(id)}/slice?${new URLSearchParams({ ...query, format: 'raw' })}`;
    const answer = await this.#send('GET', what, { token, signal, accept: 'application/octet-stream' });
    if (!answer.ok) throw this.#refusal(answer, `GET ${what}`, await answer.text());
    return readSlice(answer.headers.get('X-Slice'), await answer.arrayBuffer());
  }

  /** Measures in the volume that the session shows; nothing is stored. what: {kind, points, samples}. */
  measure(id, token, what) {
    return this.#request('POST', `api/v1/sessions/${encodeURIComponent(id)}/measure`, { token, body: what });
  }

  /** The measurements of a session as the text of a file: json or csv. */
  async measures(id, token, format) {
    const what = `api/v1/sessions/${encodeURIComponent(id)}/measures?format=${format}`;
    const answer = await this.#send('GET', what, { token, accept: '*/*', signal: AbortSignal.timeout(TIMEOUT_MS) });
    const text = await answer.text();
    if (!answer.ok) throw this.#refusal(answer, `GET ${what}`, text);
    return text;
  }

  /** An image of a view, as a Blob. */
  async still(view, size) {
    const what = 'api/v1/render?format=jpeg';
    const answer = await this.#send('POST', what, { body: { ...view, size }, accept: 'image/jpeg', signal: AbortSignal.timeout(TIMEOUT_MS) });
    if (!answer.ok) throw this.#refusal(answer, `POST ${what}`, await answer.text());
    return answer.blob();
  }

  /** An image of a view, as the answer whose body still loads. It may take minutes; `signal` cancels it. */
  render(view, query, signal) {
    return this.#image('POST', `api/v1/render?${query}`, { body: view, signal });
  }

  /** Renders the current view of a session. A join token of the session may ask for it. */
  snapshot({ id, token }, query, signal) {
    return this.#image('GET', `api/v1/sessions/${encodeURIComponent(id)}/snapshot?${query}`, { token, signal });
  }

  /** A small image of a saved view, as a Blob. The browser's cache revalidates it. */
  async thumbnail(id, [width, height], signal) {
    const answer = await this.#image('GET', `api/v1/render/${encodeURIComponent(id)}?format=webp&quality=80&size=${width},${height}`,
      { signal, cache: 'no-cache' });
    return answer.blob();
  }

  async #image(method, path, { accept = 'image/*', ...options }) {
    const answer = await this.#send(method, path, { accept, ...options });
    if (!answer.ok) throw this.#refusal(answer, `${method} ${path}`, await answer.text());
    return answer;
  }

  /** The saved views of this token: [{id, name, saved, volume, size}]. */
  savedViews() {
    return this.#all('views');
  }

  /** A saved view, with every field. */
  savedView(id) {
    return this.#request('GET', `api/v1/views/${encodeURIComponent(id)}`);
  }

  renameView(id, name) {
    return this.#request('PATCH', `api/v1/views/${encodeURIComponent(id)}`, { body: { name } });
  }

  deleteView(id) {
    return this.#request('DELETE', `api/v1/views/${encodeURIComponent(id)}`);
  }

  /** Ends a session. A guest ends a fork of its own with the fork's control token. */
  deleteSession(id, token = this.token) {
    return this.#request('DELETE', `api/v1/sessions/${encodeURIComponent(id)}`, { token });
  }

  /** All camera paths that this token may see. */
  paths() {
    return this.#all('paths');
  }

  /** All items of a list that comes in pages. */
  async #all(name) {
    const all = [];
    let after = '';
    do {
      const page = await this.#request('GET', `api/v1/${name}?limit=1000${after && `&after=${encodeURIComponent(after)}`}`);
      if (!Array.isArray(page[name])) throw new ApiError(200, t('api.notlist'));
      all.push(...page[name]);
      after = page.next;
    } while (after);
    return all;
  }

  path(id) {
    return this.#request('GET', `api/v1/paths/${encodeURIComponent(id)}`);
  }

  createPath(body) {
    return this.#request('POST', 'api/v1/paths', { body });
  }

  deletePath(id) {
    return this.#request('DELETE', `api/v1/paths/${encodeURIComponent(id)}`);
  }

  /** Calls told(event, path) for every event of a path until the stream ends. The last event is done, failed or removed. */
  async watchPath(id, told, signal) {
    const address = `api/v1/paths/${encodeURIComponent(id)}/events`;
    const answer = await this.#send('GET', address, { accept: 'text/event-stream', signal });
    if (answer.status !== 200) throw this.#refusal(answer, `GET ${address}`, await answer.text());
    const take = eventReader((event, data) => told(event, JSON.parse(data)));
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    for (let part = await reader.read(); !part.done; part = await reader.read()) take(part.value);
  }

  /**
   * The address of a finished path's file, for the browser's own download, which has no size limit and resumes after an
   * interruption. The address contains the token, because a download cannot send headers.
   */
  pathFile({ id, format }) {
    const url = new URL(`api/v1/paths/${encodeURIComponent(id)}/${format === 'webm' ? 'movie' : 'archive'}`, this.#base);
    if (this.token) url.searchParams.set('token', this.token);
    return url.href;
  }

  /** Resolves to the answer with any status; its body may still be loading. */
  async #send(method, path, { body, token = this.token, accept = 'application/json', signal, cache = 'no-store' }) {
    const headers = { Accept: accept };
    if (token) headers.Authorization = `Bearer ${token}`;
    if (body) headers['Content-Type'] = 'application/json';
    return this.#transport.request(method, path, {
      headers, body: body && JSON.stringify(body), cache, signal,
      keepalive: method === 'DELETE', // also when the page is being left
    });
  }

  #refusal(answer, what, text) {
    let json = null;
    try {
      json = JSON.parse(text);
    } catch { /* not of the daemon: its status has to do */ }
    return new ApiError(answer.status, json?.detail || json?.title || t('api.status', { what, status: answer.status }), {
      pointer: json?.pointer ?? '', retryAfter: Number(answer.headers.get('Retry-After')) || 0,
    });
  }

  async #request(method, path, { body, token } = {}) {
    let answer;
    let text;
    try {
      answer = await this.#send(method, path, { body, token, signal: AbortSignal.timeout(TIMEOUT_MS) });
      text = await answer.text();
    } catch (error) {
      throw new ApiError(0, error.name === 'TimeoutError'
        ? t('api.late', { seconds: TIMEOUT_MS / 1000 }) : t('api.silent'));
    }
    if (!answer.ok) throw this.#refusal(answer, `${method} ${path}`, text);
    try {
      return text ? JSON.parse(text) : null;
    } catch {
      throw new ApiError(answer.status, t('api.notjson', { what: `${method} ${path}` }));
    }
  }
}
