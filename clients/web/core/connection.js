// SPDX-License-Identifier: Apache-2.0
// Gets from an address to a live stream, and back to one after every failure.
//
//   GET volumes ─► a ready one ─► POST sessions ─► stream (WebSocket) ─► frames
//
// A session outlives its connections. After a lost connection the client joins the same session again if it still exists,
// and otherwise creates one from the last view. A daemon that keeps its sessions over a restart keeps their join tokens, but may
// have a new token of its own: then the client returns by its join token, and the session is locked until useToken(). Events:
// state {state, reason, retryMs, error}, volumes [list],
// session {id, token, tokens, view, isNew, isDefault, isJoined, isLocked, replaced (id of the session that the daemon no longer has)},
// missing {wanted, volume (its description, or null), shown (the volume instead), volumes}: the requested volume cannot be shown,
// frame {header and payload}, notification {method, params},
// fault Error (a wrong message from the daemon or an unexpected failure; the stream continues).
import { Api, ApiError, streamPath } from './api.js';
import { Emitter } from './emitter.js';
import { FrameError, decodeFrame } from './frame.js';
import { ConnectionState } from './connection_state.js';
import { Rpc } from './rpc.js';
import { t } from './text.js';
import { webTransport } from './transport.js';

const RETRY_FIRST_MS = 250;
const RETRY_MAX_MS = 5000;
const POLL_LOADING_MS = 300;
const POLL_MS = 2000;
const PING_MS = 5000;
const OPEN_TIMEOUT_MS = 10000;
const GONE_MAX = 3; // sessions that may vanish in a row before the client waits between attempts

export class Connection extends Emitter {
  #env; #api; #states; #transport;
  #stream = null;
  #rpc = null;
  #session = null;
  #replaced = null;
  #volumes = [];
  #asked = 0; // requests for the list
  #listed = 0; // the one whose answer is the list
  #ahead = null; // the answer to the request of prepare()
  #wanted; #saved;
  #epoch = 0;
  #failures = 0;
  #timer = null;
  #ping = null;
  #heard = 0;
  #rtt = 0;
  #lastView = () => null;
  #size = () => [512, 512];

  /**
   * base: address of the page's folder; token: the daemon's token; session: {id, token, isJoined} to join, or null;
   * volume: id of the first volume, or null; saved: id of the saved view to start with, or null; lastView(): the view to
   * restore, or null; size(): [width, height] px; env: {fetch, WebSocket, setTimeout, clearTimeout, now}, or with `transport` (transport.js) in
   * place of the first two.
   */
  constructor({ base, token, session = null, volume = null, saved = null, lastView, size, env }) {
    super();
    this.#env = env;
    this.#transport = env.transport ?? webTransport({ base, fetch: env.fetch, WebSocket: env.WebSocket });
    this.#api = new Api({ base, token, transport: this.#transport });
    this.#session = session;
    this.#wanted = volume;
    this.#saved = saved;
    this.#lastView = lastView;
    this.#size = size;
    this.#states = new ConnectionState();
  }

  get state() { return this.#states.state; }
  get volumes() { return this.#volumes; }
  get session() { return this.#session; }
  /** Round trip of the newest ping in ms; 0 = not measured yet. */
  get rttMs() { return this.#rtt; }
  get api() { return this.#api; }
  /** As in the constructor, for a second connection. */
  get env() { return this.#env; }
  get isLive() { return this.state === 'live' || this.state === 'draining'; }

  /** Requests the list of volumes before start(), so that the daemon answers while the page is being built. */
  prepare() {
    this.#scope(this.#session);
    this.#ahead = this.#askVolumes();
    this.#ahead.answer.catch(() => {}); // start() reports it
  }

  start() {
    this.#step('start');
    this.#seek();
  }

  /** Ends the wait before the next attempt. */
  retryNow() {
    if (!this.#states.can('retry')) return;
    this.#clearTimer();
    this.#step('retry');
    this.#seek();
  }

  /** Takes another token from the user. The client returns to its own session if the daemon still has it. */
  useToken(token) {
    const own = this.#session;
    this.#api.token = token;
    this.#session = own?.isJoined && !own.isLocked ? null : own && { ...own, isJoined: false, isLocked: false };
    this.#failures = 0;
    if (this.isLive) {
      this.#hangUp(new Error(t('connection.lost')));
      this.#step('lose');
    }
    this.retryNow();
  }

  stop() {
    this.#step('stop');
    this.#hangUp(new Error('the page stopped'));
  }

  /** Calls a method; resolves to its result. Rejects at once without a stream. */
  call(method, params) {
    if (!this.#rpc) return Promise.reject(new Error('there is no stream'));
    return this.#rpc.call(method, params);
  }

  notify(method, params) {
    this.#rpc?.notify(method, params);
  }

  /** Reads the list of volumes again and resolves to it. */
  async refresh() {
    await this.#takeVolumes(this.#askVolumes());
    return this.#volumes;
  }

  #askVolumes() {
    this.#asked += 1;
    return { number: this.#asked, answer: this.#api.volumes() };
  }

  /** Takes the answer to a request for the list. One that arrives after the answer to a later request is out of date and ignored. */
  async #takeVolumes({ number, answer }, isWanted = () => true) {
    const volumes = await answer;
    if (number < this.#listed || !isWanted()) return;
    this.#listed = number;
    this.#volumes = volumes;
    this.emit('volumes', volumes);
  }

  #step(step, detail = {}) {
    this.#states.step(step);
    this.emit('state', { state: this.state, reason: '', retryMs: 0, error: null, ...detail });
  }

  // Each attempt and each stream is an epoch. Late results of an older epoch are ignored.
  async #seek() {
    const epoch = ++this.#epoch;
    try {
      const session = await this.#findSession(epoch);
      if (epoch !== this.#epoch || !session) return;
      this.#session = session;
      this.#join(epoch); // first: the daemon answers while the page shows the session
      this.emit('session', { ...session, replaced: session.isNew ? this.#replaced : null });
      this.#replaced = null;
      this.#step('found');
    } catch (error) {
      if (epoch === this.#epoch) this.#failed(error);
    }
  }

  /** A guest reads the volumes of its session alone. */
  #scope(session) {
    this.#api.joined = session?.isJoined ? session : null;
  }

  /** The session to join, existing or new; null if there is nothing to show yet (state: waiting). */
  async #findSession(epoch) {
    const known = this.#session;
    this.#scope(known);
    if (known?.isJoined) return this.#findJoined(known, epoch);
    try {
      await this.#readVolumes(epoch);
    } catch (error) {
      const token = known?.tokens?.control ?? known?.token;
      if (error.status !== 401 || !token) throw error;
      return this.#returnByJoinToken({ ...known, token, isJoined: true, isLocked: true }, error, epoch);
    }
    if (epoch !== this.#epoch) return null;
    if (known) {
      try {
        const { view, tokens = known.tokens } = await this.#askSession(known);
        return { ...known, view, tokens, isNew: false };
      } catch (error) {
        if (![401, 403, 404, 410].includes(error.status)) throw error;
        this.#replaced = known.id;
        this.#session = null;
      }
    }
    if (this.#saved) {
      const begun = await this.#createKept(epoch);
      if (begun || epoch !== this.#epoch) return begun;
    }
    const last = this.#lastView();
    const volume = this.#pick(last);
    if (epoch !== this.#epoch) return null;
    if (!volume) {
      this.#wait();
      return null;
    }
    return this.#create(volume, last);
  }

  /** The session of a guest, with what its join token may read. */
  async #readJoined(known, epoch) {
    const [{ view, tokens = known.tokens }] = await Promise.all([this.#askSession(known), this.#readVolumes(epoch)]);
    return { ...known, view, tokens, isNew: false };
  }

  async #findJoined(known, epoch) {
    try {
      return await this.#readJoined(known, epoch);
    } catch (error) {
      if (![401, 403, 404, 410].includes(error.status)) throw error;
      if (!known.isLocked) throw new ApiError(error.status, t('connection.ended'));
      this.#session = { ...known, isJoined: false, isLocked: false };
      throw new ApiError(401, error.message);
    }
  }

  /** The own session `known` without a valid token of the daemon. Throws `error` if its join token is not valid either. */
  async #returnByJoinToken(known, error, epoch) {
    this.#scope(known);
    try {
      return await this.#readJoined(known, epoch);
    } catch (refusal) {
      throw [401, 403, 404, 410].includes(refusal.status) ? error : refusal;
    }
  }

  /** Asks for our own session with the daemon's token, so that 404 means that the session is gone. */
  #askSession({ id, token, isJoined }) {
    return this.#api.session(id, isJoined ? token : this.#api.token);
  }

  async #readVolumes(epoch) {
    const request = this.#ahead ?? this.#askVolumes();
    this.#ahead = null;
    await this.#takeVolumes(request, () => epoch === this.#epoch);
  }

  /** The volume of the last view, else the requested volume, else the first ready volume. */
  #pick(last) {
    const ready = this.#volumes.filter((v) => v.state === 'ready');
    const byId = (id) => this.#volumes.find((v) => v.id === id);
    for (const id of [last?.volume, this.#wanted]) {
      const volume = id && byId(id);
      if (volume?.state === 'ready') return volume;
      if (volume?.state === 'loading') return null;
    }
    const shown = ready[0] ?? null;
    if (!last && this.#wanted && shown) {
      this.emit('missing', { wanted: this.#wanted, volume: byId(this.#wanted) ?? null, shown, volumes: this.#volumes });
      this.#wanted = null;
    }
    return shown;
  }

  /** A session from the saved view, or null if it cannot be shown. Used at the start only; later the last view counts. */
  async #createKept(epoch) {
    try {
      const session = await this.#api.sessionFrom(this.#saved);
      this.#saved = null;
      return { ...session, isNew: true };
    } catch (error) {
      if (error.status !== 422 || epoch !== this.#epoch) throw error;
      this.#saved = null;
      this.emit('fault', new Error(t('connection.link.failed', { reason: error.message })));
      return null;
    }
  }

  async #create(volume, last) {
    const size = this.#size();
    if (last && last.volume === volume.id) {
      try {
        return { ...await this.#api.createSession({ ...last, size }), isNew: true };
      } catch (error) {
        // The daemon may have another version or backend. Then its default view is better than nothing.
        if (error.status !== 422) throw error;
        this.emit('fault', new Error(t('connection.restore.failed', { reason: error.message })));
      }
    }
    const view = { volume: volume.id, size };
    if (last?.background) view.background = last.background;
    return { ...await this.#api.createSession(view), isNew: true, isDefault: true };
  }

  #wait() {
    this.#failures = 0;
    const isLoading = this.#volumes.some((v) => v.state === 'loading');
    this.#step('empty');
    this.#arm(isLoading ? POLL_LOADING_MS : POLL_MS, () => {
      this.#step('again');
      this.#seek();
    });
  }

  #join(epoch) {
    const { id } = this.#session;
    const token = this.#session.tokens?.control ?? this.#session.token;
    this.#arm(OPEN_TIMEOUT_MS, () => this.#lose(epoch, t('connection.open.late')));
    const stream = this.#transport.open(streamPath(id), token, {
      opened: () => epoch === this.#epoch && this.#opened(epoch, stream),
      heard: (data) => epoch === this.#epoch && this.#message(data),
      closed: (code, reason) => this.#closed(epoch, code, reason),
    });
    this.#stream = stream;
  }

  #opened(epoch, stream) {
    this.#clearTimer();
    this.#rpc = new Rpc({
      write: (text) => stream.send(text),
      notified: (method, params) => {
        if (method === 'server.draining' && this.#states.can('drain')) {
          this.#step('drain', { reason: params.reason ?? '' });
        }
        this.emit('notification', { method, params });
      },
    });
    this.#heard = this.#env.now();
    this.#keepAlive(epoch);
    this.#step('opened');
  }

  #keepAlive(epoch) {
    const sent = this.#env.now();
    this.#rpc.call('ping').then(() => {
      if (epoch === this.#epoch) this.#rtt = this.#env.now() - sent;
    }, () => {});
    this.#ping = this.#env.setTimeout(() => {
      if (epoch !== this.#epoch) return;
      if (this.#heard < sent) this.#lose(epoch, t('connection.silent'));
      else this.#keepAlive(epoch);
    }, PING_MS);
  }

  #message(data) {
    this.#heard = this.#env.now();
    try {
      if (typeof data === 'string') {
        this.#rpc.take(data);
      } else {
        const frame = decodeFrame(data);
        this.#failures = 0; // reset here, so that a daemon that opens and closes at once is not flooded
        this.emit('frame', frame);
      }
    } catch (error) {
      this.#acknowledge(data); // or the daemon waits for it, and sends no other
      this.emit('fault', error instanceof FrameError
        ? new Error(t('connection.frame', { reason: error.message })) : error);
    }
  }

  /** Acknowledges a frame of which only the number can be read. */
  #acknowledge(data) {
    if (typeof data === 'string' || data.byteLength < 12) return;
    const view = new DataView(data);
    if (view.getUint32(0, false) === 0x53504631) this.notify('stream.ack', { frame: view.getUint32(8, true) });
  }

  #closed(epoch, code, reason) {
    if (epoch !== this.#epoch) return;
    const what = reason || (code === 1006 ? '' : t('connection.closed', { code }));
    if (this.state === 'joining') this.#explain(epoch, what);
    else this.#lose(epoch, what);
  }

  // A browser does not say why a WebSocket was refused. A request for the session over HTTP does.
  async #explain(epoch, what) {
    this.#clearTimer();
    try {
      await this.#askSession(this.#session);
      this.#lose(epoch, what || t('connection.refused'));
    } catch (error) {
      if (epoch !== this.#epoch) return;
      const isGone = error.status === 404 || error.status === 410;
      if (isGone && !this.#session.isJoined && this.#failures < GONE_MAX) {
        this.#failures += 1;
        this.#replaced = this.#session.id;
        this.#session = null;
        this.#step('gone');
        this.#seek();
      } else if (isGone && !this.#session.isJoined) {
        this.#lose(epoch, error.message);
      } else {
        this.#failed(error);
      }
    }
  }

  #failed(error) {
    if (error instanceof ApiError && [401, 403, 404].includes(error.status)) {
      this.#hangUp(error);
      this.#step('refuse', { reason: error.message, error });
      return;
    }
    this.#lose(this.#epoch, error.message, error);
  }

  #lose(epoch, reason, error = null) {
    if (epoch !== this.#epoch || !this.#states.can('lose')) return;
    this.#hangUp(new Error(reason || t('connection.lost')));
    const backoff = Math.min(RETRY_MAX_MS, RETRY_FIRST_MS * 2 ** this.#failures);
    const retryMs = Math.min(RETRY_MAX_MS, Math.max(backoff, (error?.retryAfter ?? 0) * 1000));
    this.#failures += 1;
    this.#step('lose', { reason, retryMs, error });
    this.#arm(retryMs, () => this.retryNow());
  }

  #hangUp(reason) {
    this.#epoch += 1;
    this.#clearTimer();
    this.#env.clearTimeout(this.#ping);
    this.#rpc?.close(reason);
    this.#rpc = null;
    this.#stream?.close();
    this.#stream = null;
  }

  #arm(ms, then) {
    this.#clearTimer();
    this.#timer = this.#env.setTimeout(() => {
      this.#timer = null;
      then();
    }, ms);
  }

  #clearTimer() {
    this.#env.clearTimeout(this.#timer);
    this.#timer = null;
  }
}
