// SPDX-License-Identifier: Apache-2.0
// A second picture of the same daemon: a session of its own whose view this page alone changes. It ends with the page or with stop().
import { Connection } from '../../core/connection.js';
import { Emitter } from '../../core/emitter.js';
import { FrameOrder } from '../../core/order.js';
import { UpdateQueue } from '../../core/update_queue.js';
import { rigFromCamera } from '../../core/camera.js';
import { applyPatch } from '../../core/merge.js';
import { cameraOf } from '../../core/warp.js';
import { nextFrame } from '../frames/animation.js';
import { decodeImage } from '../frames/decoder.js';
import { Screen } from '../frames/screen.js';
import { depthSettings, Warp } from '../frames/warp.js';

const RESIZE_MS = 120;

/** Events: view, drawn, failed Error (the picture stays), ended Error (the session is gone). */
export class Companion extends Emitter {
  #api; #isGuests; #isPredicted; #connection = null; #screen; #warp; #updates; #order;
  #view;
  #rig = null; // the camera of the view, as the page moves it
  #rigs = new Map(); // by seq: the cameras of updates that no frame shows yet
  #drawn = { seq: 0, isFinal: false, width: 0, count: 0 };
  #timer = null;
  #isBehind = false; // a view of the daemon was not taken, because changes were on their way
  #isStopped = false;

  /** api: of the page; made: {id, tokens, view}; isGuests: a join token made it; canvas: where it draws; layer: above it, for the frames as the
   * newest camera sees them; isPredicted(): whether they are shown. */
  constructor({ base, env, api, made, canvas, layer, isGuests, isPredicted }) {
    super();
    this.#isGuests = isGuests;
    this.#api = api;
    this.#view = made.view;
    this.#screen = new Screen(canvas);
    this.#warp = new Warp(layer, this.#screen);
    this.#isPredicted = isPredicted;
    this.#warp.isOn = isPredicted();
    this.#warp.onSwitch = () => this.#configure(depthSettings(this.#wantsDepth));
    this.#connection = new Connection({
      base, token: api.token, session: { id: made.id, token: made.tokens.control, isJoined: true }, env, size: () => this.#screen.size,
    });
    this.#updates = new UpdateQueue({
      send: (params) => {
        this.#rigs.set(params.seq, this.#rig);
        return this.#connection.call('view.update', params);
      },
      schedule: nextFrame, now: () => performance.now(),
      done: (patch) => (patch.volume || (this.#isBehind && this.#updates.isIdle)) && this.#reload(),
      fail: (error) => this.emit('failed', error),
    });
    this.#order = new FrameOrder({
      decode: async (frame) => {
        frame.map = this.#warp.depth?.decode(frame); // before the image: its decoder takes the bytes of the message
        const image = await decodeImage(frame);
        frame.map = await frame.map;
        return image;
      },
      schedule: nextFrame,
      draw: (image, frame) => this.#draw(image, frame),
      ack: ({ frame }) => this.#connection.notify('stream.ack', { frame }),
      fail: (error) => this.emit('failed', error),
    });
    this.#listen();
    this.#connection.start();
  }

  get id() { return this.#connection.session?.id ?? null; }
  get view() { return this.#view; }
  /** How many pictures were drawn from frames by their depth. */
  get warps() { return this.#warp.depth?.count ?? 0; }
  /** True if the newest change is drawn in full quality and in the wanted size. */
  get isAtRest() {
    return this.#updates.isIdle && this.#drawn.isFinal && this.#drawn.seq === this.#updates.sent && this.#drawn.size === String(this.#screen.size) && !this.#warp.fade?.isOn;
  }

  #listen() {
    this.#screen.onResize(() => this.#planResize());
    this.#connection.on('frame', (frame) => this.#order.put(frame));
    this.#connection.on('state', ({ state, error, reason }) => {
      if (this.#isStopped) return;
      if (state === 'live') {
        this.#order.reset();
        this.#warp.depth?.reset();
        this.#rigs.clear();
        this.#drawn = { seq: 0, isFinal: false, width: 0, count: 0 };
        this.#resize();
        this.#updates.open();
      } else if (state === 'lost' || state === 'refused') {
        this.#updates.close();
        this.#warp.hide();
      }
      if (state === 'refused') this.emit('ended', error ?? new Error(reason));
    });
    this.#connection.on('notification', ({ method, params }) => {
      if (method === 'render.error') this.emit('failed', new Error(params.message));
    });
  }

  /** True if frames should come with depth, by which they are drawn as the newest camera sees them. */
  get #wantsDepth() { return this.#warp.isOn && Boolean(this.#warp.depth); }

  #draw(image, frame) {
    const { seq, isFinal, width, height } = frame;
    const last = this.#drawn;
    const isSharper = last.count > 0 && seq === last.seq && !last.isFinal && (isFinal || width > last.width);
    const camera = cameraOf(frame, this.#rigs.get(seq) ?? null);
    const isNewest = seq === this.#updates.sent && !this.#updates.isWaiting;
    if (this.#warp.overshoots(camera, this.#rig, isNewest)) return;
    this.#warp.arrive(isSharper, isNewest && !camera.isAhead, isFinal ? Infinity : width / last.width);
    this.#screen.draw(image, { isMoving: !isFinal });
    this.#warp.depth?.take(image, frame);
    this.#warp.drew(camera.rig, camera.isAhead);
    for (const key of this.#rigs.keys()) if (key < seq) this.#rigs.delete(key);
    this.#updates.show(seq);
    this.#predict();
    if (this.#drawn.count === 0 && !this.#warp.depth) this.#warp.load().then(() => this.#warp.onSwitch(), () => {}); // without it, the last frame stays
    this.#drawn = { seq, isFinal, width, size: String([width, height]), count: this.#drawn.count + 1 };
    this.emit('drawn');
  }

  /** Shows the newest frame as the newest camera sees it. */
  #predict() {
    if (this.#warp.isOn !== this.#isPredicted()) this.#warp.isOn = this.#isPredicted();
    const ahead = this.#updates.sent - this.#updates.drawn + Number(this.#updates.isWaiting);
    this.#warp.show(this.#rig, ahead, this.#view.background);
  }

  #planResize() {
    this.#timer ??= setTimeout(() => {
      this.#timer = null;
      this.#resize();
    }, RESIZE_MS);
  }

  #resize() {
    this.#configure({ size: this.#screen.size, format: ['jpeg'], ...depthSettings(this.#wantsDepth) });
  }

  #configure(params) {
    if (!this.#connection.isLive) return;
    this.#connection.call('stream.configure', params).catch((error) => this.emit('failed', error));
  }

  async #reload() {
    try {
      const { view } = await this.#connection.call('view.get');
      this.#isBehind = !this.#updates.isIdle; // then again when the changes on their way have arrived
      if (this.#isBehind) return;
      this.#view = view;
      this.emit('view');
    } catch { /* the stream reports a lost daemon */ }
  }

  /** Changes fields of the view; `settings` may name another volume. */
  change(settings, time) {
    this.#view = applyPatch(this.#view, settings);
    this.#updates.put(settings, { time });
    this.emit('view');
  }

  /** Moves the camera. */
  look(camera, time) {
    this.#view = applyPatch(this.#view, { camera });
    this.#rig = rigFromCamera(this.#view.camera);
    this.#updates.put({ camera }, { time });
    this.#predict();
  }

  stop() {
    if (this.#isStopped) return;
    this.#isStopped = true;
    clearTimeout(this.#timer);
    const { session } = this.#connection;
    this.#warp.hide();
    this.#connection.stop();
    // The daemon permits it for the token that created the session; for a fork by a guest, that is its own control token.
    if (session) this.#api.deleteSession(session.id, this.#isGuests ? session.token : undefined).catch(() => {});
  }
}
