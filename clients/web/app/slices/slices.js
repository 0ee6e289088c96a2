// SPDX-License-Identifier: Apache-2.0
// Slices beside the picture: three panes with linked crosshairs, an oblique plane, and the section "Slices". The view's `slices` hold what
// all participants share; layout and zoom belong to this window.
//
// app.slices for other features: `panes` (by id), layer(draw) for all of them, `position`, setPosition(world), `grid`; event change.
import { Emitter } from '../../core/emitter.js';
import { dataText, numberText, roundValue, unitName } from '../../core/lengths.js';
import { anatomyOf, frameOf } from '../../core/orientation.js';
import { defaultWindow, lookOf } from '../../core/slice_image.js';
import { SliceCache, askUntil } from '../../core/slice_loader.js';
import { finestGrid, mainAxis, moveAlong, obliquePlane, orthogonalPlanes } from '../../core/slices.js';
import { t } from '../../core/text.js';
import { add, dot, length, normalize, rotate, scale, subtract } from '../../core/vector.js';
import { placeOf, roundedAlong, unitAlong, worldFrom } from '../../core/vertical.js';
import { Pane } from './pane.js';
import { SliceLines } from './slice_lines.js';
import { PANES } from './slices_layouts.js';
import { installSection } from './slices_panel.js';
import { SlicesPicture } from './slices_picture.js';

const BEGUN = 'slices-first'; // key in storage: a volume has chosen this layout, not the user
const FLAGS = ['i', 'j', 'k']; // of view.slices.planes, by axis of the grid

export function install(app) {
  app.slices = new Slices(app);
  app.slices.start();
  installSection(app);
}

class Slices extends Emitter {
  #app;
  #cache = new SliceCache();
  #volume = null; // id
  #begun = true; // the layout follows what the volume wants, once
  #home = null; // the volume's default camera, which tells what is up where the file does not
  #line = null; // {normal, from, to}: where moves along a normal began, and the position that the last one set
  #look = null;
  grid = null;
  panes = new Map();
  lines = new SliceLines(this);

  constructor(app) {
    super();
    this.#app = app;
  }

  start() {
    const { layout, modes, viewer, connection } = this.#app;
    for (const id of PANES) this.panes.set(id, new Pane(id, layout.body(id), { slices: this, modes, cache: this.#cache }));
    this.#app.transfer.onShow(() => this.update());
    layout.on('change', () => this.update());
    viewer.on('view', () => this.#follow());
    connection.on('volumes', () => this.#follow());
    connection.on('session', () => this.#forget());
    modes.extend('window', { panes: this.#windowTool() });
    new SlicesPicture(this.#app, this);
  }

  // What the view says.

  get shared() { return this.#app.viewer.view?.slices ?? null; }
  get isOblique() { return this.shared?.mode === 'oblique'; }
  get position() { return this.shared.position; }
  get normal() { return this.shared.normal; }
  get window() { return this.shared.window; }
  get unit() { return unitName(this.#app.viewer.volume?.unit); }
  /** The coordinate along a world axis as the file gives it, rounded, and back; its unit; a position as {place, unit}. */
  along(axis, world) { return roundedAlong(this.#app.viewer.volume, axis, world, this.grid.precision); }
  back(axis, own) { return worldFrom(this.#app.viewer.volume, axis, own); }
  unitAlong(axis) { return unitAlong(this.#app.viewer.volume, axis); }
  placeOf(position) { return placeOf(this.#app.viewer.volume, position, this.grid.precision); }
  /** How slices show values: 'grey', 'transfer_function' or the name of a colour map. */
  get colors() { return this.shared.colors ?? 'grey'; }
  /** The visible channels [{id ('' = the volume), points}, …]; empty without channels. */
  get channels() {
    const list = this.#app.channels?.list ?? [];
    return list.length < 2 ? [] : list.filter(({ isVisible, points }) => isVisible && points).map(({ key, index, points }) => ({ id: index < 0 ? '' : key, points }));
  }
  /** {key, window, shades}, see lookOf(); the key changes with them. */
  get look() {
    const { colors, window } = this;
    const points = this.#app.viewer.view.transfer_function?.points ?? [];
    const known = points.length || colors !== 'transfer_function' ? colors : 'grey';
    const key = JSON.stringify([known, known === 'transfer_function' ? points : window]);
    if (key !== this.#look?.key) this.#look = { key, ...lookOf(known, window, points) };
    return this.#look;
  }
  /** Tells the value under the pointer to the status line; '' = none. */
  tellValue(text) { this.#app.status.setValue(text); }
  /** A value of the data with its unit. */
  valueText(value) { return dataText(value, this.#app.transfer.range, this.#app.transfer.unit); }
  /** The same as a number, for a field. */
  round(value) { return roundValue(value, this.#app.transfer.range); }
  get anatomy() { return anatomyOf(this.#app.viewer.volume); }
  get frame() { return frameOf(this.anatomy, this.#home); }
  get volumeKey() { return this.#volume; }
  /** False while the view changes to another volume: the daemon has no slices of this one any more. */
  get isOfView() { return this.#app.viewer.view?.volume === this.#volume; }
  /** The part of a query that names the time step of the view. */
  get stepQuery() {
    const step = this.#app.viewer.view?.time?.step;
    return step === undefined ? {} : { step };
  }
  /** True if the layout has panes with slices. */
  get areShown() { return this.#app.layout.showsSlices; }

  change(patch, time) {
    const { viewer } = this.#app;
    if (viewer.mayChange()) viewer.change({ slices: patch }, time);
  }

  setPosition(world, time) {
    this.change({ position: this.grid.clamp(world) }, time);
  }

  /** An oblique plane that would look like another slice begins as the slice that it replaces. */
  setMode(mode, time) {
    const [axial, coronal, sagittal] = this.grid ? orthogonalPlanes(this.grid, this.frame, this.position) : [];
    const isTwice = [axial, coronal].some((plane) => plane && Math.abs(dot(plane.normal, normalize(this.normal))) > 0.999);
    this.change({ mode, ...(mode === 'oblique' && isTwice ? { normal: sagittal.normal } : {}) }, time);
  }

  /** A slice of the volume, or of the channel that the query names. */
  load(query, signal) {
    const { connection } = this.#app;
    return askUntil(query.channel ?? this.#volume, async () => {
      if (!connection.session) throw new Error(t('connection.lost'));
      return connection.api.slice(connection.session.id, connection.session.token, query, signal);
    }, signal);
  }

  #forget() {
    this.#cache.clear();
    this.#volume = this.grid = this.#line = null;
    for (const pane of this.panes.values()) pane.reset();
    this.#follow();
  }

  /** Takes the volume and the view. */
  #follow() {
    const { viewer } = this.#app;
    if (!this.isOfView) for (const pane of this.panes.values()) pane.stop();
    if (!this.shared || !viewer.isCurrent) return;
    const { volume } = viewer;
    const id = viewer.view.volume;
    if (id !== this.#volume) {
      this.#volume = id;
      this.#cache.clear();
      this.grid = this.#home = null;
      for (const pane of this.panes.values()) pane.reset();
      this.#findHome(id);
      this.#begun = false;
    }
    if (!this.#begun && volume) this.#begin(volume);
    if (!this.grid && volume?.dims && viewer.kind === 'grid') this.grid = finestGrid(volume);
    this.update();
    this.emit('change');
  }

  /** Shows slices first where the volume wants that, unless this tab has shown it before; a later volume goes back to the picture. */
  #begin({ id, first_layout: first }) {
    const { layout, storage } = this.#app;
    const key = `begun:${id}`;
    this.#begun = true;
    if (first === 'slices') {
      if (storage.recall(key) || layout.current !== '3d') return;
      storage.remember(key, '1');
      storage.remember(BEGUN, '1');
      layout.set('slices');
    } else if (storage.recall(BEGUN)) {
      storage.remember(BEGUN, '');
      if (layout.current === 'slices') layout.set('3d');
    }
  }

  async #findHome(id) {
    const camera = await this.#app.viewer.home();
    if (id !== this.#volume || !camera) return;
    this.#home = camera;
    this.update();
  }

  update() {
    if (this.areShown) {
      for (const pane of this.panes.values()) pane.update();
    }
    this.#app.overlay.update();
  }

  /** Adds a layer to all panes; see Pane.layer(). */
  layer(draw) {
    const layers = [...this.panes.values()].map((pane) => pane.layer(draw));
    return { update: () => layers.forEach((layer) => layer.update()), remove: () => layers.forEach((layer) => layer.remove()) };
  }

  // Planes.

  /** The plane that a pane shows: the third one shows the oblique plane instead if there is one. */
  planeOf(id) {
    if (this.isOblique && id === 'sagittal') return obliquePlane(this.position, this.normal, this.frame.up, this.frame.front);
    return orthogonalPlanes(this.grid, this.frame, this.position).find(({ kind }) => kind === id);
  }

  /** The orthogonal planes that the picture shows. */
  get planesIn3d() {
    const { planes = {} } = this.shared;
    return orthogonalPlanes(this.grid, this.frame, this.position).filter(({ axis }) => planes[FLAGS[axis]] !== false);
  }

  /** Shows or hides one of the orthogonal planes in the picture. */
  showIn3d(kind, isShown, time) {
    const plane = this.grid && orthogonalPlanes(this.grid, this.frame, this.position).find((other) => other.kind === kind);
    if (plane) this.change({ planes: { [FLAGS[plane.axis]]: isShown } }, time);
  }

  /** The anatomical name of a plane, or the world axis that it lies across. */
  nameOf({ kind, normal }) {
    if (kind === 'oblique' || this.anatomy) return t(`slices.${kind}`);
    return t('slices.across', { axis: 'xyz'[mainAxis(normal)] });
  }

  scroll(plane, steps, time) {
    if (plane.axis === null) {
      this.goAlong(plane.normal, dot(this.position, plane.normal) + steps * this.grid.smallest, time);
      return;
    }
    const sign = dot(this.grid.axes[plane.axis], plane.normal) < 0 ? -1 : 1;
    this.goTo(plane.axis, this.grid.index(plane.axis, this.position) + sign * steps, time);
  }

  goTo(axis, index, time) {
    if (Number.isFinite(index)) this.change({ position: this.grid.moveTo(axis, this.position, index) }, time);
  }

  /** Moves the oblique plane along its normal, to a distance from the origin. A way to the end and back leads to where it began. */
  goAlong(normal, offset, time) {
    if (!Number.isFinite(offset)) return;
    const goesOn = this.#line && dot(normal, this.#line.normal) > 1 - 1e-9 && length(subtract(this.position, this.#line.to)) < 1e-3 * this.grid.smallest;
    const from = goesOn ? this.#line.from : this.position;
    this.#line = { normal, from, to: moveAlong(this.grid, from, normal, offset) };
    this.change({ position: this.#line.to }, time);
  }

  /** Turns the oblique plane so that it faces the viewer of the picture. */
  alignWithView(time) {
    const { rig } = this.#app.viewer;
    if (rig) this.change({ mode: 'oblique', normal: rotate(rig.orientation, [0, 0, 1]).map((part) => Number(part.toFixed(9)) + 0) }, time);
  }

  /** Back to the middle of the volume, upright. */
  reset(time) {
    const { histogram } = this.#app.transfer;
    if (!this.grid) return;
    const corners = this.grid.corners();
    const position = scale(add(corners[0], corners[7]), 0.5);
    this.change({ position, normal: [0, 0, 1], ...(histogram ? { window: defaultWindow(histogram) } : {}) }, time);
  }

  /** Window and level by dragging in a pane, while that mode is on. */
  #windowTool() {
    let from = null;
    let before = null;
    const say = () => this.#app.modes.say(t('slices.window.text', { center: numberText(this.round(this.window.center)), width: numberText(this.round(this.window.width)) }));
    return {
      cursor: 'move',
      down: (at) => {
        from = at;
        before = { ...this.window };
        say();
      },
      move: (at, { timeStamp }) => {
        const factor = Math.exp((at[0] - from[0]) / 200);
        const center = before.center - (at[1] - from[1]) * before.width / 300;
        this.change({ window: { center, width: Math.max(before.width * factor, Number.MIN_VALUE) } }, timeStamp);
        say();
      },
      cancel: () => this.change({ window: before }),
    };
  }
}
