// SPDX-License-Identifier: Apache-2.0
// <splat-view>: a picture of a splatd daemon for any page, as a custom element. element/README.md documents it.
import { Connection } from '../core/connection.js';
import { Emitter } from '../core/emitter.js';
import { Participants } from '../core/participants.js';
import { t } from '../core/text.js';
import * as frames from '../app/frames/frames.js';
import { attachPointers, attachWheel, cameraKeys } from '../app/camera/pointer.js';
import { Screen } from '../app/frames/screen.js';
import * as stream from '../app/session/stream.js';
import { Viewer } from '../app/camera/viewer.js';
import { follow, Warp } from '../app/frames/warp.js';

const STYLE = `
:host { display: block; position: relative; min-width: 1px; min-height: 1px; aspect-ratio: 4 / 3; background: #000; overflow: hidden; }
:host([hidden]) { display: none; }
div { position: absolute; inset: 0; pointer-events: none; background: var(--ground); }
div[hidden] { display: none; }
canvas { position: absolute; inset: 0; width: 100%; height: 100%; display: block; outline: none; }
:host(:not([controls])) canvas { pointer-events: none; }
:host([controls]) canvas { cursor: grab; touch-action: none; }
:host([controls]) canvas[data-mode="orbit"] { cursor: grabbing; }
canvas:focus-visible { box-shadow: inset 0 0 0 2px #6bb7f2; }
p { position: absolute; left: 50%; top: 50%; max-width: 90%; margin: 0; padding: 8px 14px; transform: translate(-50%, -50%);
  font: 14px/1.4 system-ui, sans-serif; color: #e6e9ee; background: rgb(18 21 26 / 86%); border-radius: 8px; text-align: center; }
p[hidden] { display: none; }`;

/** Attributes that name another picture: a change connects again. */
const PLACE = ['url', 'token', 'session', 'view'];
const NO_MODES = { down: () => false, move() {}, up() {}, cancel() {}, hover() {}, double: () => false, wheel: () => false };

let sheet = null;
function styles() {
  if (!sheet) {
    sheet = new CSSStyleSheet();
    sheet.replaceSync(STYLE);
  }
  return sheet;
}

/**
 * The element. Attributes: url, token, volume, session, view, controls, label.
 * Events: ready {session, view}, viewchange {view}, frame {frame, seq, width, height, isFinal, latency}, error {error}.
 */
export class SplatView extends HTMLElement {
  static get observedAttributes() { return [...PLACE, 'volume', 'controls', 'label']; } // esbuild writes a class with static fields without #names

  #canvas = document.createElement('canvas');
  #note = document.createElement('p');
  #layer = document.createElement('div'); // above the canvas: frames as the newest camera sees them
  #parts = null; // of the current connection: {connection, viewer, screen, participants, warp}
  #transport = null; // in place of fetch() and WebSocket
  #known = null; // the session to return to when the element moves in the document
  #isPlanned = false;
  #isDrawn = false;

  constructor() {
    super();
    const root = this.attachShadow({ mode: 'open' });
    root.adoptedStyleSheets = [styles()];
    this.#canvas.setAttribute('part', 'picture');
    this.#canvas.setAttribute('role', 'img');
    this.#note.setAttribute('part', 'message');
    this.#note.setAttribute('role', 'status');
    root.append(this.#canvas, this.#layer, this.#note);
    this.#attachControls();
  }

  // Attributes as properties.

  /** The address of the daemon: its root, or the folder of a reverse proxy. */
  get url() { return this.getAttribute('url') ?? ''; }
  set url(value) { this.setAttribute('url', value); }
  /** The daemon's token, or with `session` the join token of the session. */
  get token() { return this.getAttribute('token') ?? ''; }
  set token(value) { this.setAttribute('token', value); }
  /** The id of the volume: of the first one, and later of the shown one. */
  get volume() { return this.getAttribute('volume') ?? ''; }
  set volume(value) { this.setAttribute('volume', value); }
  /** The id of the session to join. If it is '', the element creates a session. */
  get session() { return this.getAttribute('session') ?? ''; }
  set session(value) { this.setAttribute('session', value); }
  /** True if the user can move the camera. */
  get controls() { return this.hasAttribute('controls'); }
  set controls(value) { this.toggleAttribute('controls', value); }

  /** The complete view that is shown, or null. Assigning a merge patch changes it; a text is the id of a saved view to start with. */
  get view() { return this.#parts ? structuredClone(this.#parts.viewer.view) : null; }
  set view(value) {
    if (typeof value === 'string') this.setAttribute('view', value);
    else this.change(value);
  }

  /**
   * How the element reaches the daemon (core/transport.js), or null: by fetch() and WebSocket at `url`. A change connects again.
   * @type {import('../core/transport.js').Transport | null}
   */
  get transport() { return this.#transport; }
  set transport(value) {
    this.#transport = value;
    this.#plan();
  }

  /** The state of the connection: idle, seeking, waiting, joining, live, draining, lost, refused or stopped. */
  get state() { return this.#parts?.connection.state ?? 'idle'; }

  // Methods.

  /** Changes fields of the view by a JSON merge patch, such as {shading: {mode: 'phong'}}. */
  change(patch) { this.#parts?.viewer.change(patch, performance.now()); }

  /** Frames the whole volume and keeps the direction. */
  fit() { this.#parts?.viewer.fit(performance.now()); }

  /** Returns to the volume's default camera. */
  reset() { return this.#parts?.viewer.reset(performance.now()); }

  /** Resolves to the shown picture as a Blob; type: 'image/png' or another format of canvas.toBlob(). */
  toBlob(type = 'image/png', quality = undefined) {
    return new Promise((resolve) => { this.#canvas.toBlob(resolve, type, quality); });
  }

  // Life in the document.

  connectedCallback() { this.#plan(); }

  disconnectedCallback() { this.#stop(); }

  attributeChangedCallback(name, before, now) {
    if (before === now) return;
    if (name === 'controls' || name === 'label') {
      this.#name();
      if (this.#parts) this.#parts.warp.isOn = this.controls;
    } else if (name === 'volume' && this.#parts?.viewer.view) {
      this.#parts.viewer.selectVolume(now);
    } else {
      if (PLACE.includes(name)) this.#known = null;
      this.#plan();
    }
  }

  #name() {
    this.#canvas.setAttribute('aria-label', this.getAttribute('label') || t('element.label'));
    this.#canvas.tabIndex = this.controls ? 0 : -1;
  }

  /** Connects in a microtask, so that several attributes count as one change. */
  #plan() {
    if (this.#isPlanned || !this.isConnected) return;
    this.#isPlanned = true;
    queueMicrotask(() => {
      this.#isPlanned = false;
      this.#stop();
      if (this.isConnected && (this.url || this.#transport)) this.#start();
    });
  }

  #start() {
    this.#name();
    this.#isDrawn = false;
    const base = new URL(this.url, document.baseURI).href.replace(/[?#].*$/, '').replace(/\/?$/, '/');
    const { token, session: id } = this;
    const screen = new Screen(this.#canvas);
    const connection = new Connection({
      base, token, volume: this.volume || null, saved: this.getAttribute('view'),
      session: id ? { id, token, isJoined: true } : this.#known,
      lastView: () => viewer.lastView, size: () => screen.size,
      env: {
        transport: this.#transport, fetch: (address, options) => window.fetch(address, options), WebSocket: window.WebSocket,
        setTimeout: (act, ms) => window.setTimeout(act, ms), clearTimeout: (timer) => window.clearTimeout(timer),
        now: () => performance.now(),
      },
    });
    const viewer = new Viewer({ connection, viewport: () => screen.viewport });
    const participants = new Participants();
    this.#layer.replaceChildren(document.createElement('canvas'));
    this.#layer.hidden = true;
    const warp = new Warp(this.#layer, screen);
    this.#parts = { connection, viewer, screen, participants, warp };
    /** @type {any} */
    const app = {
      connection, viewer, screen, participants, warp, report: (error) => this.#fail(error),
      storage: { recall: () => null, remember() {} }, formats: { wanted: async () => ({ format: ['jpeg'] }), keepGranted() {} },
    };
    frames.install(app);
    stream.install(app);
    app.warp.isOn = this.controls;
    follow(app);
    this.#follow(app);
    connection.start();
  }

  #follow({ connection, viewer, participants, frames: drawn }) {
    drawn.on('drawn', ({ frame, latency }) => {
      const { frame: number, seq, width, height, isFinal } = frame;
      this.#isDrawn = true;
      this.#say('');
      this.#tell('frame', { frame: number, seq, width, height, isFinal, latency });
    });
    connection.on('state', ({ state, reason, error }) => {
      if (state === 'live') {
        participants.reset();
        viewer.resume();
      } else if (state === 'lost' || state === 'refused') {
        viewer.suspend();
        this.#say(error?.message || reason || t('banner.lost.gone'));
        this.#tell('error', { error: error ?? new Error(reason) });
      } else if (!this.#isDrawn) {
        this.#say(t(state === 'waiting' ? 'banner.empty' : 'banner.connecting'));
      }
    });
    connection.on('session', (session) => {
      this.#known = { id: session.id, token: session.tokens?.control ?? session.token, isJoined: Boolean(session.isJoined) };
      viewer.adopt(session);
      this.#tell('ready', { session: session.id, view: this.view });
    });
    connection.on('fault', (error) => this.#fail(error));
    connection.on('notification', ({ method, params }) => {
      if (method === 'view.changed' && params.view && params.by !== participants.you) viewer.takeShared(params.view);
      if (method === 'session.participants') participants.takeParticipants(params);
      if (method === 'session.control') participants.takeControl(params);
      if (method.startsWith('session.')) viewer.allow(participants.mayChange);
      if (method === 'render.error') this.#fail(new Error(t('render.failed', { reason: params.message ?? t('render.noreason') })));
    });
    viewer.on('refused', (error) => this.#fail(error));
    viewer.on('view', () => this.#tell('viewchange', { view: this.view }));
    viewer.on('camera', () => this.#tell('viewchange', { view: this.view }));
  }

  #stop() {
    const parts = this.#parts;
    this.#parts = null;
    if (!parts) return;
    parts.screen.destroy();
    if (parts.connection.state !== 'stopped') parts.connection.stop();
  }

  // The controls work on the viewer of the moment.

  #attachControls() {
    const canvas = this.#canvas;
    const viewer = this.#forward();
    attachPointers(canvas, viewer, NO_MODES);
    attachWheel(canvas, viewer, NO_MODES);
    const keys = new Map(cameraKeys(viewer).flatMap(([names, act]) => names.map((name) => [name, act])));
    canvas.addEventListener('keydown', (event) => {
      const act = keys.get(event.key.length === 1 ? event.key.toLowerCase() : event.key);
      if (!this.controls || !act || event.altKey || event.ctrlKey || event.metaKey) return;
      act(event);
      event.preventDefault();
    });
    canvas.addEventListener('contextmenu', (event) => this.controls && event.preventDefault());
  }

  /** What the controls need of the viewer of the moment. Nothing happens without a connection. */
  #forward() {
    const now = () => this.#parts?.viewer;
    const act = (name) => (...values) => now()?.[name](...values);
    return {
      get viewport() { return now()?.viewport ?? { width: 1, height: 1 }; },
      get orientation() { return now()?.orientation ?? null; },
      turn: act('turn'), orbit: act('orbit'), pan: act('pan'), zoom: act('zoom'), fit: act('fit'), reset: act('reset'),
    };
  }

  #say(text) {
    this.#note.hidden = !text;
    if (this.#note.textContent !== text) this.#note.textContent = text;
  }

  #fail(error) {
    this.#tell('error', { error });
  }

  #tell(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}

if (!customElements.get('splat-view')) customElements.define('splat-view', SplatView);
