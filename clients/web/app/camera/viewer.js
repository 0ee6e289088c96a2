// SPDX-License-Identifier: Apache-2.0
// The current view, the camera as a rig, and the actions on them. Every change is sent as a patch through the update queue.
// Events: view (the view changed), camera (the user moved it), refused Error, denied (the user tried to change the view without control).
import {
  cameraFromRig, fit, orbit, pan, rigFromCamera, sphereAround, volumeBox, widen, zoom, zoomLimits,
} from '../../core/camera.js';
import { Emitter } from '../../core/emitter.js';
import { kindOfView, offersOf } from '../../core/kinds.js';
import { hasChannels, layersOf } from '../../core/layers.js';
import { applyPatch, patchBetween } from '../../core/merge.js';
import { turnUpright } from '../../core/orientation.js';
import { UpdateQueue } from '../../core/update_queue.js';
import { BALL_RADIUS, drag } from '../../core/trackball.js';
import { length } from '../../core/vector.js';
import { nextFrame } from '../frames/animation.js';

/** The camera of a view as a rig; null if there is no view or its camera cannot be moved. */
function rigOfView(view) {
  try {
    return rigFromCamera(view.camera);
  } catch {
    return null;
  }
}

export class Viewer extends Emitter {
  #connection; #viewport; #margins;
  #view = null;
  #rig = null;
  #box = null;
  #sphere = null;
  #home = null; // {id, camera}: a promise of the default camera of the volume `id`
  #isKnown = false; // the description of the volume
  #part = null; // {key, part} of the newest answer of visiblePart()
  #isBehind = false; // a view of the daemon was not taken, because changes of this client were on their way
  #isSwitching = false;
  #isRestoring = false; // to a complete view, whose camera stays
  #canControl = true;
  #rigs = new Map(); // by seq: the cameras of updates that no frame shows yet; 0 = before the first one

  /** A frame (core/orientation.js) whose up axis stays upright while the camera turns, or null: it turns freely. */
  upright = null;

  /** viewport, margins: functions that return the size of the canvas and what covers its edges, in CSS px. */
  constructor({ connection, viewport, margins = () => undefined }) {
    super();
    this.#connection = connection;
    this.#viewport = viewport;
    this.#margins = margins;
    this.updates = new UpdateQueue({
      send: (params) => {
        this.#rigs.set(params.seq, this.#rig);
        return connection.call('view.update', params);
      },
      schedule: nextFrame,
      now: () => performance.now(),
      done: (patch) => (patch.volume || patch.camera === null || (this.#isBehind && this.updates.isIdle)) && this.#reload(),
      fail: (error, patch) => this.#refused(error, patch),
    });
    connection.on('volumes', () => this.#learn());
  }

  get view() { return this.#view; }
  get camera() { return this.#view?.camera ?? null; }
  /** True if the view belongs to its volume; false while the volume is being changed. */
  get isCurrent() { return Boolean(this.#view) && !this.#isSwitching; }
  /** True if the view belongs to its volume and has a camera; false while the volume is being changed. */
  get isSettled() { return Boolean(this.#rig) && !this.#isSwitching; }
  /** True if the camera can be moved. */
  get isReady() { return this.isSettled && this.#canControl; }
  /** The view for a new session after a lost connection: the whole view, unless the volume was being changed. */
  get lastView() {
    if (!this.#view || !this.#isSwitching) return this.#view;
    return { volume: this.#view.volume, background: this.#view.background };
  }
  /** The camera as the client moves it (core/camera.js); null without a view. */
  get rig() { return this.#rig; }
  /** How many updates no drawn frame shows yet, the waiting one included. */
  get ahead() { return this.updates.sent - this.updates.drawn + Number(this.updates.isWaiting); }
  get orientation() { return this.#rig?.orientation ?? null; }
  /** The daemon's description of the volume; null until the list of volumes tells it. */
  get volume() { return this.#connection.volumes.find((v) => v.id === this.#view?.volume) ?? null; }
  /** What the volume consists of: grid, points, gaussians or mesh. */
  get kind() { return kindOfView(this.#view, this.volume); }
  /** What has a meaning for the picture, see offersOf(). */
  get offers() { return offersOf(this.kind, this.#view); }
  /** The box {center, half} of the volume, from what is known of the volume so far; null without a view. */
  get box() { return this.#box; }
  /** The length of the diagonal of the volume. */
  get extent() { return 2 * length(this.#box?.half.map(length) ?? [1, 0, 0]); }
  /** The size of the canvas in CSS px; points in the functions below are relative to it. */
  get viewport() { return this.#viewport(); }
  /** What covers its edges, in CSS px: {left, right, top, bottom}. */
  get margins() { return this.#margins(); }
  get canControl() { return this.#canControl; }

  /** A frame that shows `seq` was drawn. Returns its camera, or null if it is unknown. */
  rigOf(seq) {
    const rig = this.#rigs.get(seq) ?? null;
    for (const key of this.#rigs.keys()) if (key < seq) this.#rigs.delete(key);
    return rig;
  }

  /** Takes a complete view from the daemon. A default view fits a square, so a narrow window needs more distance. */
  take(view, isDefault = this.#isSwitching && !this.#isRestoring) {
    this.#view = view;
    this.#isBehind = this.#isSwitching = this.#isRestoring = false;
    this.#rig = rigOfView(view);
    this.#rigs.set(this.updates.sent, this.#rig); // frames of this view carry the seq of this client's last update
    this.#measure();
    const rig = isDefault && this.isReady ? widen(this.#rig, this.#viewport(), this.#margins()) : this.#rig;
    if (rig !== this.#rig) this.#move(rig);
    this.emit('view', this.#view);
  }

  /** Sets whether this participant may change the view. */
  allow(canControl) {
    this.#canControl = canControl;
    if (this.#view) this.emit('view', this.#view);
  }

  /** The list of volumes may tell what the view's volume is: another participant may have opened it. */
  #learn() {
    if (!this.#view || this.#isKnown === Boolean(this.volume?.dims)) return;
    this.#measure();
    this.emit('view', this.#view);
  }

  /** Takes the extent of the current volume. */
  #measure() {
    this.#isKnown = Boolean(this.volume?.dims);
    try {
      this.#box = this.volume?.dims ? volumeBox(this.volume) : null;
    } catch {
      this.#box = null;
    }
    this.#sphere = this.#box && sphereAround(this.#box);
    // Until the list of volumes tells the extent, the camera tells the scale.
    if (!this.#box && this.#rig) {
      const radius = this.#rig.distance * Math.sin(this.#rig.fovY * Math.PI / 360);
      this.#sphere = { center: this.#rig.target, radius };
      this.#box = { center: this.#rig.target, half: [[radius, 0, 0], [0, radius, 0], [0, 0, radius]] };
    }
  }

  /** Takes the shared view after another participant changed it; while changes of this client are on their way, after them. */
  takeShared(view) {
    this.#isBehind = !this.updates.isIdle || this.#isSwitching;
    if (!this.#isBehind) this.take(view);
  }

  /** Takes the view of a session. For an existing session, changes that were not sent yet stay. */
  adopt({ view, isNew, isDefault }) {
    if (isNew) {
      this.updates.drop();
      this.#canControl = true;
    }
    if (view && (isNew || this.updates.isIdle || !this.#view)) this.take(view, isDefault);
    this.#rigs = new Map([[0, rigOfView(view)]]); // the next stream starts with the daemon's view
  }

  /** Call when the stream opens. */
  resume() {
    this.updates.open();
  }

  /** Call when the stream is lost. */
  suspend() {
    this.updates.close();
  }

  async #reload() {
    try {
      const answer = await this.#connection.call('view.get');
      const view = answer.view ?? answer;
      if (this.updates.isIdle) this.take(view);
      else this.#isBehind = true; // again when the changes on their way have arrived
    } catch (error) {
      if (this.#connection.isLive) this.emit('refused', error);
    }
  }

  #refused(error, patch) {
    if (error.code === -32004) this.allow(false);
    this.#isSwitching = this.#isRestoring = false;
    this.emit('refused', error);
    // The daemon refused the change, so the page returns to the daemon's view.
    if (this.#connection.isLive && patch) this.#reload();
  }

  /** Changes fields of the view other than the camera. */
  change(patch, time) {
    if (!this.#view || !this.#canControl) return;
    this.#view = applyPatch(this.#view, patch);
    this.updates.put(patch, { time });
    this.emit('view', this.#view);
  }

  /** Takes the time step to which the daemon has moved the view. */
  takeStep(step) {
    if (!this.#view || this.#isSwitching || !this.updates.isIdle || this.#view.time?.step === step) return;
    this.#view = { ...this.#view, time: { step } };
    this.emit('view', this.#view);
  }

  /** Goes to a complete view of the same volume; the size stays. */
  show(view, time) {
    if (!this.isReady || view.volume !== this.#view.volume) return;
    const wanted = { ...view, size: this.#view.size };
    this.updates.put(patchBetween(this.#view, wanted), { time });
    this.#view = wanted;
    this.#rig = rigFromCamera(view.camera);
    this.emit('view', this.#view);
  }

  /** Goes to a complete view, also of another volume; the size stays. */
  restore(view, time) {
    if (!this.#view || !this.#canControl) return;
    if (view.volume === this.#view.volume) {
      this.show(view, time);
      return;
    }
    const { size, ...wanted } = view;
    this.#isSwitching = true;
    this.#isRestoring = true;
    this.#view = { ...wanted, size: this.#view.size };
    this.#rig = rigOfView(view);
    this.updates.put(wanted, { alone: true, time });
    this.emit('view', this.#view);
  }

  selectVolume(id) {
    if (!this.#view || !this.#canControl || id === this.#view.volume) return;
    this.#isSwitching = true;
    this.#isRestoring = false;
    this.#view = { ...this.#view, volume: id };
    this.updates.put({ volume: id }, { alone: true });
    this.emit('view', this.#view);
  }

  /** True if the user may change the view; otherwise says why not. */
  mayChange() {
    if (this.isSettled && !this.#canControl) this.emit('denied');
    return this.isReady;
  }

  #move(rig, time, more = {}) {
    this.#rig = rig;
    const camera = { ...cameraFromRig(rig), ...more };
    this.#view = { ...this.#view, camera: { ...this.#view.camera, ...camera } };
    this.updates.put({ camera }, { time });
    this.emit('camera', rig);
  }

  /** Moves the camera to a rig, whose projection and field of view may be others. */
  place(rig, time) {
    if (!this.mayChange()) return;
    const { projection, fovY } = this.#rig;
    this.#move(rig, time, {
      ...(rig.projection === projection ? {} : { projection: rig.projection }), ...(rig.fovY === fovY ? {} : { fov_y: rig.fovY }),
    });
  }

  /** Orbits for a drag between two points of the viewport that started with orientation `start`. */
  turn(start, from, to, time) {
    if (!this.mayChange()) return;
    const viewport = this.#viewport();
    let orientation;
    if (this.upright) {
      const step = 2 / (BALL_RADIUS * Math.min(viewport.width, viewport.height)); // as fast as the arcball at its middle
      orientation = turnUpright(this.upright, start, (from[0] - to[0]) * step, (from[1] - to[1]) * step);
    } else {
      orientation = drag(start, from, to, viewport);
    }
    this.#move({ ...this.#rig, orientation }, time);
  }

  orbit(yaw, pitch, roll, time) {
    if (!this.mayChange()) return;
    const isLocked = this.upright !== null;
    this.#move(isLocked ? { ...this.#rig, orientation: turnUpright(this.upright, this.#rig.orientation, yaw, pitch) }
      : orbit(this.#rig, yaw, pitch, roll), time);
  }

  pan(delta, time) {
    if (this.mayChange()) this.#move(pan(this.#rig, delta, this.#viewport()), time);
  }

  zoom(factor, at, time) {
    if (!this.mayChange()) return;
    this.#move(zoom(this.#rig, factor, at, this.#viewport(), zoomLimits(this.#sphere)), time);
  }

  /** Keeps the direction and fits what is visible of the volume into the free part of the window; the whole volume if nothing is, or if
      channels show more than the volume itself. */
  async fit(time) {
    if (!this.mayChange()) return;
    const id = this.#view.volume;
    const part = (hasChannels(layersOf(this.#view)) ? null : await this.visiblePart()) ?? { ...this.#box, ...this.#sphere };
    if (this.isReady && this.#view.volume === id) this.#move(fit(this.#rig, part, this.#viewport(), this.#margins()), time);
  }

  /** The part {visible, center, half, radius} that the daemon finds visible, once for each transfer function, layers, clip and edits; null
      if it does not answer. */
  async visiblePart() {
    const { volume, transfer_function, layers, clip, edits, slices } = this.#view;
    const key = JSON.stringify([volume, transfer_function, layers, clip, edits, slices?.mode, slices?.in_3d, slices?.planes]);
    if (this.#part?.key === key) return this.#part.part;
    await this.updates.arrived();
    const { session, api } = this.#connection;
    try {
      const part = await api.visiblePart(session.id, session.token);
      if (part.volume !== volume) return null;
      this.#part = { key, part };
      return part;
    } catch {
      return null; // the caller then uses the whole volume
    }
  }

  /** The camera of the volume's default view; null if the daemon does not answer. */
  async home() {
    const id = this.#view?.volume;
    if (!id) return null;
    if (this.#home?.id !== id) {
      const camera = this.#connection.api.volumeView(id).then((view) => view.camera).catch(() => null);
      const home = { id, camera };
      this.#home = home;
      camera.then((found) => { if (!found && this.#home === home) this.#home = null; });
    }
    return this.#home.camera;
  }

  /** Returns to the camera of the volume's default view. */
  async reset(time) {
    if (!this.mayChange()) return;
    const id = this.#view.volume;
    const wanted = await this.home();
    if (!wanted) await this.fit(time); // the closest
    if (!wanted || !this.isReady || this.#view.volume !== id) return;
    const home = rigFromCamera(wanted);
    this.#rig = widen(home, this.#viewport(), this.#margins());
    const camera = this.#rig === home ? wanted : { ...wanted, ...cameraFromRig(this.#rig) };
    this.#view = { ...this.#view, camera };
    this.updates.put({ camera }, { time });
  }

  /** Returns to the default picture of the volume; the size stays. The daemon knows the defaults. */
  resetAll(time) {
    if (!this.mayChange()) return;
    const fields = Object.keys(this.#view).filter((name) => name !== 'volume' && name !== 'size');
    this.#isSwitching = true;
    this.updates.put(Object.fromEntries(fields.map((name) => [name, null])), { time, alone: true });
    this.emit('view', this.#view);
  }
}
