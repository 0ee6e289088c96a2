// SPDX-License-Identifier: Apache-2.0
// A fake daemon that misbehaves on demand. It implements the protocol and serves the page, but draws one colour per volume.
// Tests use it for what the real daemon does not do on request: wrong orders, broken frames, silence and failures.
import { createReadStream, existsSync, readdirSync, statSync } from 'node:fs';
import { createServer } from 'node:http';
import path from 'node:path';
import { fileURLToPath } from 'node:url';
import { WebSocketServer } from 'ws';
import { sphereAround, volumeBox } from '../../../clients/web/core/camera.js';
import { volumesOf } from '../../../clients/web/core/layers.js';
import { applyPatch } from '../../../clients/web/core/merge.js';
import { encodePng } from './png.mjs';

/** The page as its source files, and as the daemon serves it: the files that the build packs. The latter loads in half the time. */
export const SOURCES = fileURLToPath(new URL('../../../clients/web/', import.meta.url));
const BUILT = fileURLToPath(new URL('../../../build/release/bin', import.meta.url));
const PACKED = path.join(process.env.SPLATD_BIN_DIR ?? BUILT, '../clients/web/packed/');

/** The packed page, or the source files if one of them changed after the build. */
function newestPage() {
  const packed = statSync(path.join(PACKED, 'app/main.js'), { throwIfNoEntry: false });
  if (!packed) return SOURCES;
  const files = ['index.html', ...['app', 'core', 'style', 'text'].flatMap((folder) => readdirSync(path.join(SOURCES, folder), { recursive: true })
    .map((name) => path.join(folder, name)))];
  return files.some((file) => /\.(js|css|html)$/.test(file) && statSync(path.join(SOURCES, file)).mtimeMs > packed.mtimeMs) ? SOURCES : PACKED;
}
const PAGE = newestPage();
const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css', '.svg': 'image/svg+xml' };
const CSP = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
  + "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

export const volume = (id, more = {}) => ({
  id, name: id, source: `demo:${id}`, state: 'ready', progress: 1, dims: [64, 64, 32], spacing: [1, 1, 2], origin: [0, 0, 0],
  direction: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], unit: 'mm', type: 'uint8', components: 1, range: [0, 255], bytes: 131072, ...more,
});

export const defaultView = (id) => ({
  volume: id, size: [512, 512], background: [0, 0, 0, 1],
  camera: { projection: 'perspective', position: [31.5, 31.5, 300], target: [31.5, 31.5, 31], up: [0, 1, 0], fov_y: 30, height: 64, near: 0.1 },
  transfer_function: {
    reference_length: 1, order: 'auto', gradient: [],
    points: [{ value: 60, color: [1, 0.9, 0.8], opacity: 0 }, { value: 200, color: [1, 1, 1], opacity: 0.5 }],
  },
  filter: { mode: 'adaptive', kernel: 'gaussian', sigma: 0.7, cutoff: 3, lowpass: 1, c_min: 0.07, c_max: null },
  compositing: { mode: 'sheet', attenuation: 'exponential', slab: 1 }, shading: { mode: 'none' }, layers: [{ type: 'volume', visible: true }],
  clip: { box: [[0, 0, 0], [1, 1, 1]], planes: [] },
  slices: { mode: 'none', in_3d: false, planes: { i: true, j: true, k: true }, position: [31.5, 31.5, 31], normal: [0, 0, 1], window: { center: 128, width: 256 } },
});

/** A histogram with a peak of air at 10 and one of matter at 120, or the joint one with its edges. */
export function histogram(id, { isJoint = false, range = [0, 255], type = 'uint8' } = {}) {
  const peak = (x, at) => Math.round(1e5 * Math.exp(-(((x - at) / 6) ** 2)));
  const axes = [{ axis: 'value', range, bins: isJoint ? 128 : 256 }];
  if (isJoint) axes.push({ axis: 'gradient', range: [0, 80], bins: 64 });
  const values = Array.from({ length: axes[0].bins }, (_, i) => peak(i * 256 / axes[0].bins, 10) + peak(i * 256 / axes[0].bins, 120) + 1);
  const counts = isJoint ? Array.from({ length: 64 }, (_, g) => values.map((count) => Math.round(count / (1 + g * g)))).flat() : values;
  return { volume: id, type, axes, samples: counts.reduce((a, b) => a + b, 0), counts };
}

/** Encodes a frame after the table of the protocol. */
export function frameMessage({ frame, seq, width = 32, height = 32, color = [200, 120, 40], flags = 3, payload, codec = 2, depth = null }) {
  const bytes = payload ?? encodePng(width, height, color);
  const more = depth ? depthOf(depth, [width, height]) : Buffer.alloc(0);
  const head = Buffer.alloc(36);
  head.write('SPF1', 0, 'latin1');
  head.set([codec, flags | (depth ? 16 : 0), depth ? 136 : 36, 0], 4);
  head.writeUInt32LE(frame, 8);
  head.writeUInt32LE(seq, 12);
  head.writeUInt16LE(width, 16);
  head.writeUInt16LE(height, 18);
  head.writeUInt32LE(5000, 20);
  head.writeUInt32LE(1000, 24);
  head.writeUInt32LE(bytes.length, 28);
  head.writeUInt32LE(2000, 32);
  return Buffer.concat([head, more, bytes]);
}

/** The camera and the depth of a frame: one distance, half way to the target of the camera. */
function depthOf({ position, target, up, fov_y: fov }, size) {
  const cells = size.map((side) => Math.ceil(side / 4));
  const image = encodePng(cells[0], 2 * cells[1], [255, 255, 255]);
  const distance = Math.hypot(...position.map((x, i) => target[i] - x)) / 2;
  const head = Buffer.alloc(100);
  head.writeUInt32LE(image.length, 0);
  cells.forEach((count, i) => head.writeUInt16LE(count, 4 + 2 * i));
  [distance, distance * 1.01].forEach((depth, i) => head.writeFloatLE(depth, 8 + 4 * i));
  [...position, ...target, ...up, fov].forEach((x, i) => head.writeDoubleLE(x, 20 + 8 * i));
  return Buffer.concat([head, image]);
}

export class MockDaemon {
  token = 'secret';
  volumes = [volume('phantom')];
  sessions = new Map();
  streams = new Set();
  watches = new Set();
  requests = [];
  /** The messages of all clients, in order: {method, params}. */
  heard = [];
  /** Tests may replace it: (method, params, stream) → result of the call; a thrown {code, message} becomes an error. */
  answer = null;
  /** true: the daemon answers nothing, but connections stay open. */
  isSilent = false;
  /** The status of every HTTP answer below /api, or 0 for normal answers. */
  failWith = 0;
  /** Its frames have depth, for clients that ask for it. */
  hasDepth = false;
  /** The camera of a frame with depth: (camera of the view) → the camera that the daemon expects. */
  expect = (camera) => camera;
  /** Draws a frame after every change. */
  draws = true;
  /** Replaces the histograms: (id, isJoint) → answer, or null for 404. */
  histogramOf = (id, isJoint) => histogram(id, { isJoint });
  /** Camera paths as the daemon reports them; follow() changes one. */
  paths = [];
  /** The refusal of POST /paths: {status, detail, pointer}, or null to accept. */
  refusal = null;
  /** The folder of the page. */
  page = PAGE;
  /** Files that replace files of the page or are added to them: path → text. */
  files = {};
  /** The path prefix of all routes, as behind a reverse proxy. */
  prefix = '';
  /** If not null, replaces drawing: (stream) → array of messages to send. */
  script = null;

  static async start(options = {}) {
    const daemon = Object.assign(new MockDaemon(), options);
    await daemon.#listen(options.port ?? 0);
    return daemon;
  }

  get base() { return `http://127.0.0.1:${this.port}${this.prefix}/`; }
  get url() { return `${this.base}?token=${this.token}`; }

  async #listen(port) {
    this.server = createServer((request, response) => this.#serve(request, response));
    this.ws = new WebSocketServer({ noServer: true, handleProtocols: (names) => (names.has('splatd.v1') ? 'splatd.v1' : false) });
    this.server.on('upgrade', (request, socket, head) => this.#upgrade(request, socket, head));
    await new Promise((resolve, reject) => {
      this.server.once('error', reject);
      this.server.listen(port, '127.0.0.1', resolve);
    });
    this.port = this.server.address().port;
  }

  /** Acts like a killed process: every connection breaks. */
  async kill() {
    for (const stream of this.streams) stream.socket.terminate();
    const closed = new Promise((resolve) => { this.server.close(resolve); });
    this.server.closeAllConnections();
    await closed;
  }

  dropStreams() {
    for (const stream of this.streams) stream.socket.terminate();
  }

  notifyAll(method, params = {}) {
    for (const stream of this.streams) stream.send({ method, params });
  }

  /** Changes a camera path and notifies its watchers. */
  follow(id, change, event = 'progress') {
    const path = Object.assign(this.paths.find((one) => one.id === id), change);
    for (const watch of this.watches) if (watch.id === id) this.#tell(watch, event, path);
  }

  /** Breaks all event streams. */
  dropWatches() {
    for (const { response } of this.watches) response.destroy();
  }

  #tell({ response }, event, path) {
    response.write(`event: ${event}\ndata: ${JSON.stringify(path)}\n\n`);
    if (event !== 'progress') response.end();
  }

  #watch(path, response) {
    const watch = { id: path.id, response };
    this.watches.add(watch);
    response.on('close', () => this.watches.delete(watch));
    response.writeHead(200, { 'Content-Type': 'text/event-stream' });
    this.#tell(watch, 'progress', path);
  }

  #locate(request) {
    const isBelow = request.url.startsWith(`${this.prefix}/`);
    return new URL(isBelow ? request.url.slice(this.prefix.length) : '/outside', 'http://daemon/');
  }

  #serve(request, response) {
    const url = this.#locate(request);
    if (!url.pathname.startsWith('/api/')) {
      this.#file(url.pathname, response);
      return;
    }
    let text = '';
    request.on('data', (data) => { text += data; });
    request.on('end', () => this.#api(request, url, text, response));
  }

  #file(name, response) {
    const file = path.join(this.page, name === '/' ? 'index.html' : path.normalize(name));
    const text = this.files[name];
    if (text === undefined && (!existsSync(file) || !statSync(file).isFile())) {
      response.writeHead(404).end();
      return;
    }
    response.writeHead(200, {
      'Content-Type': TYPES[path.extname(file)] ?? 'application/octet-stream', 'Content-Security-Policy': CSP,
      'X-Content-Type-Options': 'nosniff',
    });
    if (text !== undefined) response.end(text);
    else createReadStream(file).pipe(response);
  }

  #api(request, url, text, response) {
    this.requests.push(`${request.method} ${url.pathname}`);
    const reply = (status, body, headers = {}) => response.writeHead(status, {
      'Content-Type': status < 400 ? 'application/json' : 'application/problem+json', ...headers,
    }).end(JSON.stringify(body));
    const problem = (status, detail, headers) => reply(status, { type: 'about:blank', title: detail, status, detail }, headers);
    if (this.isSilent) return;
    if (this.failWith) {
      problem(this.failWith, 'as asked', this.failWith === 503 ? { 'Retry-After': '2' } : {});
      return;
    }
    const bearer = (request.headers.authorization ?? '').replace('Bearer ', '');
    const [, id, what] = /^\/api\/v1\/sessions\/([^/]+)\/?(histogram|visible|volumes.*)?$/.exec(url.pathname) ?? [];
    if (bearer !== this.token && !(id && this.#role(id, bearer))) {
      problem(401, 'the token is missing or wrong');
    } else if (url.pathname === '/api/v1/volumes') {
      reply(200, { volumes: this.volumes });
    } else if (url.pathname === '/api/v1/views' && request.method === 'GET') {
      reply(200, { views: [] });
    } else if (url.pathname === '/api/v1/presets') {
      reply(200, { presets: [] });
    } else if (url.pathname === '/api/v1/paths') {
      if (request.method === 'GET') reply(200, { paths: this.paths });
      else if (this.refusal) reply(this.refusal.status, { title: 'refused', ...this.refusal });
      else reply(202, this.#makePath(JSON.parse(text)));
    } else if (/^\/api\/v1\/paths\/[^/]+\/events$/.test(url.pathname)) {
      const path = this.paths.find((one) => one.id === url.pathname.split('/')[4]);
      if (path) this.#watch(path, response);
      else problem(404, 'there is no such path');
    } else if (/^\/api\/v1\/volumes\/[^/]+$/.test(url.pathname) && request.method === 'DELETE') {
      this.volumes = this.volumes.filter(({ id }) => id !== decodeURIComponent(url.pathname.split('/').at(-1)));
      reply(204);
    } else if (/^\/api\/v1\/volumes\/[^/]+$/.test(url.pathname) && request.method === 'GET') {
      const volume = this.volumes.find((one) => one.id === decodeURIComponent(url.pathname.split('/')[4]));
      if (volume) reply(200, volume);
      else problem(404, 'there is no such volume');
    } else if (/^\/api\/v1\/volumes\/[^/]+\/view$/.test(url.pathname)) {
      reply(200, defaultView(decodeURIComponent(url.pathname.split('/')[4])));
    } else if (url.pathname === '/api/v1/sessions' && request.method === 'POST') {
      reply(201, this.#create(JSON.parse(text).view));
    } else if (what?.startsWith('volumes') && this.sessions.has(id)) {
      const [, name, isView] = what.split('/');
      const named = this.volumes.filter((one) => volumesOf(this.sessions.get(id).view).includes(one.id));
      const volume = named.find((one) => one.id === decodeURIComponent(name ?? ''));
      if (!name) reply(200, { volumes: named });
      else if (volume) reply(200, isView ? defaultView(volume.id) : volume);
      else problem(404, 'the session names no such volume');
    } else if (what === 'visible' && this.sessions.has(id)) {
      const volume = this.volumes.find((one) => one.id === this.sessions.get(id).view.volume);
      const box = volume?.dims && volumeBox(volume);
      if (box) reply(200, { volume: volume.id, visible: true, ...box, ...sphereAround(box) });
      else problem(404, 'this daemon does not know');
    } else if (what && this.sessions.has(id)) {
      const answer = this.histogramOf(this.sessions.get(id).view.volume, url.searchParams.get('axis') === 'value,gradient');
      if (answer) reply(200, answer);
      else problem(404, 'this daemon has no histograms');
    } else if (id && this.sessions.has(id)) {
      const { view } = this.sessions.get(id);
      reply(200, { id, view, participants: 0 });
    } else {
      problem(404, 'there is no such session');
    }
  }

  #create(patch) {
    const id = `s${this.sessions.size + 1}x${this.port}`;
    const session = {
      id, tokens: { control: `c-${id}`, view: `v-${id}` }, view: applyPatch(defaultView(patch.volume), patch), created: patch,
    };
    this.sessions.set(id, session);
    return { id, tokens: session.tokens, view: session.view };
  }

  #makePath({ view: { volume: id }, size, format, fps, frames }) {
    const path = { id: `p${this.paths.length + 1}`, state: 'waiting', volume: id, size, format, fps, frames, done: 0, bytes: 0 };
    this.paths.push(path);
    return path;
  }

  #role(id, token) {
    const tokens = this.sessions.get(id)?.tokens;
    return tokens && Object.keys(tokens).find((role) => tokens[role] === token);
  }

  #upgrade(request, socket, head) {
    const url = this.#locate(request);
    const [, id] = /^\/api\/v1\/sessions\/([^/]+)\/stream$/.exec(url.pathname) ?? [];
    const role = this.#role(id, url.searchParams.get('token'));
    if (!role || this.failWith) {
      socket.end(`HTTP/1.1 ${role ? 503 : 404} No\r\nContent-Length: 0\r\nConnection: close\r\n\r\n`);
      return;
    }
    this.ws.handleUpgrade(request, socket, head, (ws) => this.#open(ws, this.sessions.get(id), role));
  }

  #open(socket, session, role) {
    const stream = {
      socket, session, role, frame: 0, seq: 0, acked: 0, size: session.view.size,
      send: (message) => socket.send(JSON.stringify({ jsonrpc: '2.0', ...message })),
    };
    this.streams.add(stream);
    socket.on('close', () => this.streams.delete(stream));
    socket.on('error', () => {});
    socket.on('message', (data, isBinary) => {
      if (!isBinary && !this.isSilent) this.#message(stream, JSON.parse(data));
    });
    if (this.isSilent) return;
    stream.send({ method: 'session.participants', params: { you: 1, participants: [{ id: 1, role }] } });
    this.#draw(stream);
  }

  #message(stream, { id, method, params }) {
    this.heard.push({ method, params });
    try {
      const result = this.answer?.(method, params, stream) ?? this.#handle(stream, method, params);
      if (id !== undefined) stream.send({ id, result });
    } catch (error) {
      if (id !== undefined) stream.send({ id, error: { code: error.code ?? -32603, message: error.message, data: { pointer: error.pointer ?? '' } } });
    }
  }

  #handle(stream, method, params) {
    const { session } = stream;
    switch (method) {
      case 'ping': return {};
      case 'view.get': return { view: session.view };
      case 'stream.ack':
        stream.acked = params.frame;
        return {};
      case 'stream.configure':
        stream.size = params.size ?? stream.size;
        stream.wantsDepth = params.depth ?? stream.wantsDepth;
        this.#draw(stream);
        return params;
      case 'view.update': {
        if (stream.role === 'view') throw Object.assign(new Error('this token may watch, not change'), { code: -32004 });
        stream.seq = params.seq;
        const id = params.patch.volume;
        const start = id && id !== session.view.volume
          ? { ...defaultView(id), size: session.view.size, background: session.view.background } : session.view;
        session.view = applyPatch(start, params.patch);
        this.#draw(stream);
        return { seq: params.seq };
      }
      default: throw Object.assign(new Error(`no method ${method}`), { code: -32601 });
    }
  }

  #draw(stream) {
    const messages = this.script ? this.script(stream) : [];
    if (!this.script && this.draws) {
      stream.frame += 1;
      const [width, height] = stream.size;
      const { view } = stream.session;
      const depth = this.hasDepth && stream.wantsDepth ? this.expect(view.camera) : null;
      const flags = !depth || depth === view.camera ? 3 : 1; // a frame that is ahead is not final
      messages.push(frameMessage({ frame: stream.frame, seq: stream.seq, width, height, color: this.color?.(view) ?? [200, 120, 40], depth, flags }));
    }
    for (const message of messages) stream.socket.send(message);
  }
}
