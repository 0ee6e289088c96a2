// SPDX-License-Identifier: Apache-2.0
// What the user looks at: the view, the camera as a rig, and what may be done with them. Every change goes out as
// a patch through the pace. Events: view (the view changed), refused Error.
import {
  cameraFromRig, fit, orbit, pan, rigFromCamera, sphereAround, volumeBox, widen, zoom, zoomLimits,
} from '../core/camera.js';
import { Emitter } from '../core/emitter.js';
import { applyPatch, patchBetween } from '../core/merge.js';
import { Pace } from '../core/pace.js';
import { drag } from '../core/trackball.js';

/** At the next animation frame, or soon in a hidden tab, which has none. */
function schedule(then) {
  let isDone = false;
  const once = () => {
    if (isDone) return;
    isDone = true;
    then();
  };
  requestAnimationFrame(once);
  setTimeout(once, 100);
}

export class Viewer extends Emitter {
  #connection; #viewport;
  #view = null;
  #rig = null;
  #box = null;
  #sphere = null;
  #home = null;
  #isSwitching = false;
  #canControl = true;

  constructor({ connection, viewport }) {
    super();
    this.#connection = connection;
    this.#viewport = viewport;
    this.pace = new Pace({
      send: (params) => connection.call('view.update', params),
      schedule,
      now: () => performance.now(),
      done: (patch) => patch.volume && this.#reload(),
      fail: (error, patch) => this.#refused(error, patch),
    });
  }

  get view() { return this.#view; }
  get camera() { return this.#view?.camera ?? null; }
  /** Is the view that of its volume, with a camera? While the volume is being changed it is not. */
  get isSettled() { return Boolean(this.#rig) && !this.#isSwitching; }
  /** May the camera be moved? */
  get isReady() { return this.isSettled && this.#canControl; }
  /** What a new session begins with after a loss: all of the view, unless its volume was just being changed. */
  get lastView() {
    if (!this.#view || !this.#isSwitching) return this.#view;
    return { volume: this.#view.volume, background: this.#view.background };
  }
  get orientation() { return this.#rig?.orientation ?? null; }
  /** The volume as the daemon describes it, or null where there is no list of volumes. */
  get volume() { return this.#connection.volumes.find((v) => v.id === this.#view?.volume) ?? null; }
  /** The box {center, half} of the volume, as far as it is known; null without a view. */
  get box() { return this.#box; }
  /** The canvas in CSS px: what the points given to the functions below refer to. */
  get viewport() { return this.#viewport(); }
  get canControl() { return this.#canControl; }

  /** Takes a whole view from the daemon. A default one is framed for a square: a narrow window needs more distance. */
  take(view, isDefault = this.#isSwitching) {
    this.#view = view;
    this.#isSwitching = false;
    try {
      this.#rig = rigFromCamera(view.camera);
    } catch {
      this.#rig = null;
    }
    this.#measure();
    const rig = isDefault && this.isReady ? widen(this.#rig, this.#viewport()) : this.#rig;
    if (rig !== this.#rig) this.#move(rig);
    this.emit('view', this.#view);
  }

  /** May this participant change the view? */
  allow(canControl) {
    this.#canControl = canControl;
    if (this.#view) this.emit('view', this.#view);
  }

  /** The list of volumes was read (again): the extent of the current one may be known now. */
  #measure() {
    try {
      this.#box = this.volume?.dims ? volumeBox(this.volume) : null;
    } catch {
      this.#box = null;
    }
    this.#sphere = this.#box && sphereAround(this.#box);
    // In a session that was joined by its token alone there is no list: the camera says how large things are.
    if (!this.#box && this.#rig) {
      const radius = this.#rig.distance * Math.sin(this.#rig.fovY * Math.PI / 360);
      this.#sphere = { center: this.#rig.target, radius };
      this.#box = { center: this.#rig.target, half: [[radius, 0, 0], [0, radius, 0], [0, 0, radius]] };
    }
  }

  /** Somebody else changed the shared view. While we change it ourselves, ours is newer. */
  takeShared(view) {
    if (!this.pace.isIdle || this.#isSwitching) return;
    this.take(view);
  }

  /** A session was found, with its view: of a new one all counts; of an old one, what we could not tell it stays. */
  adopt({ view, isNew, isDefault }) {
    if (isNew) {
      this.pace.drop();
      this.#canControl = true;
    }
    if (view && (isNew || this.pace.isIdle || !this.#view)) this.take(view, isDefault);
  }

  /** The stream is open. */
  resume() {
    this.pace.open();
  }

  /** The stream is gone. */
  suspend() {
    this.pace.close();
  }

  async #reload() {
    try {
      const answer = await this.#connection.call('view.get');
      const view = answer.view ?? answer;
      if (this.pace.isIdle) this.take(view);
    } catch (error) {
      if (this.#connection.isLive) this.emit('refused', error);
    }
  }

  #refused(error, patch) {
    if (error.code === -32004) this.allow(false);
    this.#isSwitching = false;
    this.emit('refused', error);
    // What the daemon refused is not what it shows: go back to its view.
    if (this.#connection.isLive && patch) this.#reload();
  }

  /** Changes anything of the view but the camera. */
  change(patch, time) {
    if (!this.#view || !this.#canControl) return;
    this.#view = applyPatch(this.#view, patch);
    this.pace.put(patch, { time });
    this.emit('view', this.#view);
  }

  /** Goes to a whole view of the same volume, all of it but its size. */
  show(view, time) {
    if (!this.isReady || view.volume !== this.#view.volume) return;
    const wanted = { ...view, size: this.#view.size };
    this.pace.put(patchBetween(this.#view, wanted), { time });
    this.#view = wanted;
    this.#rig = rigFromCamera(view.camera);
    this.emit('view', this.#view);
  }

  selectVolume(id) {
    if (!this.#view || !this.#canControl || id === this.#view.volume) return;
    this.#isSwitching = true;
    this.#home = null;
    this.#view = { ...this.#view, volume: id };
    this.pace.put({ volume: id }, { alone: true });
    this.emit('view', this.#view);
  }

  #move(rig, time) {
    this.#rig = rig;
    const camera = cameraFromRig(rig);
    this.#view = { ...this.#view, camera: { ...this.#view.camera, ...camera } };
    this.pace.put({ camera }, { time });
  }

  /** Orbit: a drag that began with orientation `start`, between two points of the viewport. */
  turn(start, from, to, time) {
    if (!this.isReady) return;
    this.#move({ ...this.#rig, orientation: drag(start, from, to, this.#viewport()) }, time);
  }

  orbit(yaw, pitch, roll, time) {
    if (this.isReady) this.#move(orbit(this.#rig, yaw, pitch, roll), time);
  }

  pan(delta, time) {
    if (this.isReady) this.#move(pan(this.#rig, delta, this.#viewport()), time);
  }

  zoom(factor, at, time) {
    if (!this.isReady) return;
    this.#move(zoom(this.#rig, factor, at, this.#viewport(), zoomLimits(this.#sphere)), time);
  }

  /** The same direction, with the whole volume in the window. */
  fit(time) {
    if (this.isReady) this.#move(fit(this.#rig, this.#sphere, this.#viewport()), time);
  }

  /** The camera of the volume's default view. */
  async reset(time) {
    if (!this.isReady) return;
    const id = this.#view.volume;
    if (!this.#home) {
      try {
        this.#home = (await this.#connection.api.volumeView(id)).camera;
      } catch {
        // Joined by a session's own token: fit is the best that can be done.
        this.fit(time);
        return;
      }
    }
    if (!this.isReady || this.#view.volume !== id) return;
    const home = rigFromCamera(this.#home);
    this.#rig = widen(home, this.#viewport());
    const camera = this.#rig === home ? this.#home : { ...this.#home, ...cameraFromRig(this.#rig) };
    this.#view = { ...this.#view, camera };
    this.pace.put({ camera }, { time });
  }
}
