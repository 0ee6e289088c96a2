// SPDX-License-Identifier: Apache-2.0
// Runs the real daemon as a child process, with clients that wait for what they expect. Nothing here sleeps:
// every wait is for an event, with a deadline.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { once } from 'node:events';
import net from 'node:net';
import path from 'node:path';
import { after } from 'node:test';
import { fileURLToPath } from 'node:url';
import WebSocket from 'ws';

const DEADLINE_MS = 60000;
export const BIN = process.env.SPLATD_BIN_DIR ?? fileURLToPath(new URL('../../build/release/bin', import.meta.url));

/** Rejects when `promise` takes longer than the deadline. `what` (text or a function that returns it) names the event. */
export function within(promise, what, ms = DEADLINE_MS) {
  let timer;
  const late = new Promise((_, reject) => {
    timer = setTimeout(() => reject(new Error(`${typeof what === 'function' ? what() : what}: not within ${ms} ms`)), ms);
  });
  return Promise.race([promise, late]).finally(() => clearTimeout(timer));
}

/** Returns a small NRRD file: 4×4×4 voxels of one byte each. */
export function nrrd(voxels = Buffer.from([...Array(64).keys()])) {
  return Buffer.concat([Buffer.from('NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n\n'), voxels]);
}

/** A command prefix that applies a shell redirection. */
export const redirected = (redirection) => ['/bin/sh', '-c', `exec "$0" "$@" ${redirection}`];

/** Runs splatd until it exits. Resolves to {status, out, err}. */
export async function runToEnd(args, { prefix = [] } = {}) {
  const command = [...prefix, path.join(BIN, 'splatd'), ...args];
  const child = spawn(command[0], command.slice(1), { stdio: ['ignore', 'pipe', 'pipe'] });
  let out = '';
  let err = '';
  child.stdout.on('data', (data) => { out += data; });
  child.stderr.on('data', (data) => { err += data; });
  const [code, signal] = await within(once(child, 'close'), `splatd ${args.join(' ')}`);
  return { status: code ?? signal, out, err };
}

// A failed test leaves its daemon running: this process does not wait for the daemon, and kills it on exit. Open connections
// to the daemon would keep this process alive, so it is killed after the deadline at the latest.
// (Hooks of the tests that stop daemons run after this one.)
const running = new Set();
const killAll = () => running.forEach((child) => child.kill('SIGKILL'));
after(() => {
  running.forEach((child) => [child, child.stdout, child.stderr].forEach((handle) => handle.unref()));
  setTimeout(killAll, DEADLINE_MS).unref();
});
process.on('exit', killAll);

/** A daemon with the test-card backend. Call stop() at the end: it checks the exit status and the log. */
export class Daemon {
  log = '';
  out = '';
  #watchers = new Set();

  static async start(args = ['--volume', 'demo:engine?size=32'], { prefix = [], backend = 'null', program = 'splatd', env = {}, stdin = 'ignore' } = {}) {
    const daemon = new Daemon();
    const command = [...prefix, path.join(BIN, program), '--listen', '127.0.0.1:0', '--backend', backend, ...args];
    daemon.child = spawn(command[0], command.slice(1), { stdio: [stdin, 'pipe', 'pipe'], env: { ...process.env, ...env } });
    running.add(daemon.child);
    daemon.child.stderr.on('data', (data) => daemon.#note('log', data));
    daemon.child.stdout.on('data', (data) => daemon.#note('out', data));
    daemon.child.on('error', (error) => daemon.#note('out', `${error.message}\n`));
    daemon.ended = new Promise((resolve) => { daemon.child.on('close', (code, signal) => resolve(code ?? signal)); });
    daemon.ended.then(() => {
      running.delete(daemon.child);
      daemon.#note('log', '');
    });
    await daemon.until(() => daemon.out.includes('\n') || daemon.child.exitCode !== null, 'the ready line');
    const [, address] = /^splatd: listening on (\S+)\n$/.exec(daemon.out) ?? [];
    if (!address) throw new Error(`no ready line:\n${daemon.out}\n${daemon.log}`);
    const url = new URL(address);
    daemon.token = url.searchParams.get('token');
    daemon.port = Number(url.port);
    daemon.base = url.origin;
    return daemon;
  }

  #note(stream, data) {
    this[stream] += data;
    for (const watcher of this.#watchers) watcher();
  }

  /** Resolves when `condition()` holds, which is checked whenever the daemon writes. */
  until(condition, what) {
    if (condition()) return Promise.resolve();
    let watcher;
    const met = new Promise((resolve) => {
      watcher = () => condition() && resolve();
      this.#watchers.add(watcher);
    });
    return within(met, () => `${what} (log: ${this.log.slice(-2000)})`).finally(() => this.#watchers.delete(watcher));
  }

  /** Resolves when the log contains `text`, a string or a regular expression. */
  untilLogged(text) {
    return this.until(() => (text.test ? text.test(this.log) : this.log.includes(text)), `the log line "${text}"`);
  }

  fetch(target, { token = this.token, headers = {}, ...options } = {}) {
    const all = token ? { Authorization: `Bearer ${token}`, ...headers } : headers;
    return fetch(this.base + target, { ...options, headers: all, signal: AbortSignal.timeout(DEADLINE_MS) });
  }

  /** Sends one request. Resolves to {status, headers, json}. */
  async json(target, options) {
    const answer = await this.fetch(target, options);
    const text = await answer.text();
    return { status: answer.status, headers: answer.headers, json: text ? JSON.parse(text) : null };
  }

  post(target, body, options = {}) {
    const text = typeof body === 'string' ? body : JSON.stringify(body);
    return this.json(target, { method: 'POST', body: text, headers: { 'Content-Type': 'application/json' }, ...options });
  }

  /** Polls until the volume is no longer loading. */
  async loaded(id) {
    for (;;) {
      const { json } = await this.json(`/api/v1/volumes/${id}`);
      if (json.state !== 'loading') return json;
    }
  }

  async session(view) {
    const { status, json } = await this.post('/api/v1/sessions', view ? { view } : {});
    if (status !== 201) throw new Error(`no session: ${JSON.stringify(json)}`);
    return json;
  }

  streamUrl(session, token = session.tokens.control) {
    return `${this.base.replace('http', 'ws')}/api/v1/sessions/${session.id}/stream?token=${token}`;
  }

  /** Opens a stream of a session (of a new session if none is given). */
  async stream({ session, token, ...options } = {}) {
    const of = session ?? await this.session();
    return Stream.open(this.streamUrl(of, token), { session: of, ...options });
  }

  kill(signal) {
    this.child.kill(signal);
  }

  async stop(signal = 'SIGTERM') {
    this.kill(signal);
    const status = await within(this.ended, 'the end of splatd');
    if (/Sanitizer|runtime error/.test(this.log)) throw new Error(this.log);
    return status;
  }
}

export function decodeFrame(data) {
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  if (data.toString('latin1', 0, 4) !== 'SPF1') throw new Error('no SPF1');
  const header = {
    codec: view.getUint8(4), flags: view.getUint8(5), headerBytes: view.getUint16(6, true),
    frame: view.getUint32(8, true), seq: view.getUint32(12, true),
    width: view.getUint16(16, true), height: view.getUint16(18, true),
    renderUs: view.getUint32(20, true), encodeUs: view.getUint32(24, true), bytes: view.getUint32(28, true),
    queueUs: view.getUint32(32, true),
  };
  const depth = header.flags & DEPTH ? decodeDepth(view, data.subarray(header.headerBytes)) : null;
  const imageAt = header.headerBytes + (depth?.payload.length ?? 0);
  if (header.headerBytes !== (depth ? 136 : 36) || imageAt + header.bytes !== data.length) throw new Error('the sizes do not add up');
  return { ...header, depth, payload: data.subarray(imageAt) };
}

/** The camera and the depth of a frame; `rest`: what follows the header. */
function decodeDepth(view, rest) {
  const vector = (at) => [0, 8, 16].map((more) => view.getFloat64(at + more, true));
  return {
    cells: [view.getUint16(40, true), view.getUint16(42, true)], near: view.getFloat32(44, true), far: view.getFloat32(48, true),
    isFlat: view.getUint32(52, true) === 1, position: vector(56), target: vector(80), up: vector(104), extent: view.getFloat64(128, true),
    payload: rest.subarray(0, view.getUint32(36, true)),
  };
}

export const FINAL = 2;
export const LOSSLESS = 4;
export const INCOMPLETE = 8;
export const DEPTH = 16;

/** A WebSocket client of one stream. It acknowledges frames at once unless acks is false. */
export class Stream {
  frames = [];
  notes = [];
  closed = null;
  acks = true;
  #calls = new Map();
  #watchers = new Set();
  #id = 0;
  #seq = 0;

  static async open(url, { session, acks = true, protocols = ['splatd.v1'], ...options } = {}) {
    const stream = new Stream();
    stream.session = session;
    stream.acks = acks;
    const socket = new WebSocket(url, protocols, options);
    stream.socket = socket;
    socket.on('message', (data, isBinary) => stream.#take(data, isBinary));
    socket.on('close', (code, reason) => {
      stream.closed = { code, reason: String(reason) };
      for (const { reject } of stream.#calls.values()) reject(new Error(`closed with ${code} ${reason}`));
      stream.#look();
    });
    socket.on('error', () => {});
    const refused = once(socket, 'unexpected-response').then(([, answer]) => {
      throw Object.assign(new Error(`status ${answer.statusCode}`), { status: answer.statusCode });
    });
    refused.catch(() => {});
    await within(Promise.race([once(socket, 'open'), refused]), 'the stream to open');
    return stream;
  }

  #look() {
    for (const watcher of this.#watchers) watcher();
  }

  #take(data, isBinary) {
    if (isBinary) {
      const frame = decodeFrame(data);
      this.frames.push(frame);
      if (this.acks) this.ack(frame.frame);
    } else {
      const message = JSON.parse(String(data));
      const call = this.#calls.get(message.id);
      if (call) {
        this.#calls.delete(message.id);
        if (message.error) call.reject(Object.assign(new Error(message.error.message), message.error));
        else call.resolve(message.result);
      } else {
        this.notes.push(message);
      }
    }
    this.#look();
  }

  /** Resolves to the result of `condition()` once it is truthy. */
  until(condition, what) {
    const now = condition();
    if (now) return Promise.resolve(now);
    let watcher;
    const met = new Promise((resolve, reject) => {
      watcher = () => {
        const value = condition();
        if (value) resolve(value);
        else if (this.closed) reject(new Error(`${what}: closed with ${this.closed.code} ${this.closed.reason}`));
      };
      this.#watchers.add(watcher);
    });
    return within(met, what).finally(() => this.#watchers.delete(watcher));
  }

  /** Resolves to the first frame with a number of at least `from` that fits. */
  frame(fits, what, from = 0) {
    return this.until(() => this.frames.slice(from).find(fits), what);
  }

  final(seq = 0) {
    return this.frame((f) => (f.flags & FINAL) && f.seq === seq, `the final frame of seq ${seq}`);
  }

  note(method, fits = () => true) {
    return this.until(() => this.notes.find((n) => n.method === method && fits(n.params)), `the notification ${method}`);
  }

  send(text) {
    this.socket.send(text);
  }

  call(method, params = {}) {
    const id = ++this.#id;
    const answer = new Promise((resolve, reject) => this.#calls.set(id, { resolve, reject }));
    this.send(JSON.stringify({ jsonrpc: '2.0', id, method, params }));
    return within(answer, `the answer to ${method}`);
  }

  notify(method, params) {
    this.send(JSON.stringify({ jsonrpc: '2.0', method, params }));
  }

  ack(frame) {
    if (this.socket.readyState === WebSocket.OPEN) this.notify('stream.ack', { frame });
  }

  update(patch, seq = ++this.#seq) {
    this.#seq = seq;
    return this.call('view.update', { seq, patch });
  }

  async end() {
    if (!this.closed) this.socket.close();
    return this.until(() => this.closed, 'the close');
  }
}

/** Returns the camera of a view, rotated so that every step gives a different image. */
export function turned(view, step) {
  const [x, y, z] = view.camera.position;
  return { camera: { ...view.camera, position: [x + step * 0.01, y, z] } };
}

/** A plain TCP connection that stores all bytes it receives. */
export class Raw {
  bytes = Buffer.alloc(0);
  ended = false;
  #watchers = new Set();

  static async connect(port, options = {}) {
    const raw = new Raw();
    raw.socket = net.connect({ port, host: '127.0.0.1', ...options });
    const gone = () => { raw.ended = true; raw.#look(); };
    raw.socket.on('data', (data) => { raw.bytes = Buffer.concat([raw.bytes, data]); raw.#look(); });
    raw.socket.on('end', gone).on('close', gone).on('error', gone);
    await within(once(raw.socket, 'connect'), 'a TCP connection');
    return raw;
  }

  // Sends the headers of a POST request. Resolves when the daemon has accepted them and waits for `length` bytes of body.
  static async begin(daemon, target, length) {
    const raw = await Raw.connect(daemon.port);
    raw.write(`POST ${target} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${daemon.token}\r\n`
      + `Expect: 100-continue\r\nContent-Length: ${length}\r\n\r\n`);
    const accepted = 'HTTP/1.1 100 Continue\r\n\r\n';
    await raw.until(() => raw.bytes.length >= accepted.length, 'the request for the body');
    assert.equal(raw.text(), accepted);
    raw.bytes = Buffer.alloc(0);
    return raw;
  }

  #look() {
    for (const watcher of this.#watchers) watcher();
  }

  write(data) {
    this.socket.write(data);
  }

  until(condition, what) {
    const now = condition();
    if (now) return Promise.resolve(now);
    let watcher;
    const met = new Promise((resolve, reject) => {
      watcher = () => {
        const value = condition();
        if (value) resolve(value);
        else if (this.ended) reject(new Error(`${what}: the connection ended after ${this.bytes.length} bytes`));
      };
      this.#watchers.add(watcher);
    });
    return within(met, what).finally(() => this.#watchers.delete(watcher));
  }

  text() {
    return this.bytes.toString('latin1');
  }

  destroy() {
    this.socket.destroy();
  }

  /** A raw connection after a WebSocket handshake: frames() returns the server's frames. */
  static async webSocket(daemon, session, { extra = Buffer.alloc(0) } = {}) {
    const raw = await Raw.connect(daemon.port);
    const target = new URL(daemon.streamUrl(session));
    raw.write(Buffer.concat([Buffer.from(
      `GET ${target.pathname}${target.search} HTTP/1.1\r\nHost: 127.0.0.1:${daemon.port}\r\nUpgrade: websocket\r\n`
      + 'Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n'), extra]));
    await raw.until(() => raw.text().includes('\r\n\r\n'), 'the handshake');
    if (!raw.text().startsWith('HTTP/1.1 101')) throw new Error(raw.text());
    if (!raw.text().includes('s3pPLMBiTxaQ9kYGzzhZRbK+xOo=')) throw new Error('wrong Sec-WebSocket-Accept');
    raw.start = raw.bytes.indexOf('\r\n\r\n') + 4;
    return raw;
  }

  /** Returns the complete frames received so far: [{opcode, payload}]. */
  frames() {
    const list = [];
    for (let at = this.start; at + 2 <= this.bytes.length;) {
      let size = this.bytes[at + 1] & 127;
      let head = 2;
      if (size === 126 && at + 4 <= this.bytes.length) [size, head] = [this.bytes.readUInt16BE(at + 2), 4];
      else if (size === 127 && at + 10 <= this.bytes.length) [size, head] = [Number(this.bytes.readBigUInt64BE(at + 2)), 10];
      else if (size > 125) break;
      if (at + head + size > this.bytes.length) break;
      list.push({ opcode: this.bytes[at] & 15, payload: this.bytes.subarray(at + head, at + head + size) });
      at += head + size;
    }
    return list;
  }

  /** Resolves to the code of the server's close frame. */
  async closeCode() {
    const close = await this.until(() => this.frames().find((f) => f.opcode === 8), 'a close frame');
    return close.payload.readUInt16BE(0);
  }

  /** Resolves to the answer with this id. */
  async answer(id) {
    return this.until(() => this.frames().filter((f) => f.opcode === 1).map((f) => JSON.parse(String(f.payload)))
      .find((m) => m.id === id), `an answer with id ${id}`);
  }
}

/** Encodes one frame. Clients must mask their frames, so that is the default. */
export function clientFrame(opcode, payload, { fin = true, rsv = 0, masked = true } = {}) {
  const data = Buffer.from(payload);
  const head = [(fin ? 0x80 : 0) | (rsv << 4) | opcode];
  const bit = masked ? 0x80 : 0;
  if (data.length < 126) head.push(bit | data.length);
  else if (data.length < 65536) head.push(bit | 126, data.length >> 8, data.length & 255);
  else {
    const size = Buffer.alloc(8);
    size.writeBigUInt64BE(BigInt(data.length));
    head.push(bit | 127, ...size);
  }
  if (!masked) return Buffer.concat([Buffer.from(head), data]);
  const mask = [0x12, 0x34, 0x56, 0x78];
  return Buffer.concat([Buffer.from([...head, ...mask]), data.map((byte, i) => byte ^ mask[i & 3])]);
}
