// SPDX-License-Identifier: Apache-2.0
// Slices beside the picture: three panes with linked crosshairs, an oblique plane, and the section "Slices". The view's `slices` hold what
// all participants share; layout and zoom belong to this window.
//
// app.slices for other features: `panes` (by id), layer(draw) for all of them, `position`, setPosition(world), `grid`; event change.
import { Emitter } from '../core/emitter.js';
import { anatomyOf, frameOf } from '../core/orientation.js';
import { meetPlane, ray } from '../core/project.js';
import { defaultWindow } from '../core/slice_image.js';
import { SliceCache } from '../core/slice_loader.js';
import { Grid, cutLine, gridOfSlices, obliquePlane, orthogonalPlanes, turnNormal } from '../core/slices.js';
import { t } from '../core/text.js';
import { add, dot, normalize, rotate, scale, subtract } from '../core/vector.js';
import { svg } from './dom.js';
import { layoutButton } from './layout.js';
import { Pane } from './pane.js';
import { installSection } from './slices_panel.js';

const IDS = ['axial', 'coronal', 'sagittal'];
const HANDLE_PX = 12;
const LINE_PX = 5;
const GAP_PX = 7; // around the crosshair's centre

export function install(app) {
  app.slices = new Slices(app);
  app.slices.start();
  installSection(app);
}

class Slices extends Emitter {
  #app;
  #cache = new SliceCache();
  #volume = null; // id
  #home = null; // the volume's default camera, which tells what is up where the file does not
  #guest = null; // the grid that a guest without a list of volumes found out
  grid = null;
  panes = new Map();

  constructor(app) {
    super();
    this.#app = app;
  }

  start() {
    const { layout, modes, viewer, storage, connection, overlay, shortcuts } = this.#app;
    for (const id of IDS) this.panes.set(id, new Pane(id, layout.pane(id, t(`slices.${id}`)), { slices: this, modes, cache: this.#cache }));
    const kinds = [
      { name: '3d', icon: 'box', label: t('slices.layout.3d') },
      { name: 'four', icon: 'grid-2x2', label: t('slices.layout.four') },
      { name: 'slices', icon: 'columns-3', label: t('slices.layout.slices') },
    ];
    kinds.forEach((kind, order) => layoutButton(this.#app, { ...kind, order }));
    const names = kinds.map(({ name }) => name);
    shortcuts.add('l', () => layout.set(names[(names.indexOf(layout.current) + 1) % names.length]), t('slices.layout.next'));
    if (names.includes(storage.recall('layout'))) layout.set(storage.recall('layout'));
    layout.on('change', (name) => {
      storage.remember('layout', name);
      this.update();
    });
    viewer.on('view', () => this.#follow());
    connection.on('volumes', () => this.#follow());
    connection.on('session', () => this.#forget());
    modes.extend('window', { panes: this.#windowTool() });
    this.#addPicking();
    overlay.layer((project, { group }) => this.#drawIn3d(project, group));
  }

  // What the view says.

  get shared() { return this.#app.viewer.view?.slices ?? null; }
  get isOblique() { return this.shared?.mode === 'oblique'; }
  get position() { return this.shared.position; }
  get normal() { return this.shared.normal; }
  get window() { return this.shared.window; }
  get unit() { return this.#app.viewer.volume?.unit ?? ''; }
  get anatomy() { return anatomyOf(this.#app.viewer.volume); }
  get frame() { return frameOf(this.anatomy, this.#home); }
  get volumeKey() { return this.#volume; }
  /** True if the layout has panes with slices. */
  get areShown() { return ['four', 'slices'].includes(this.#app.layout.current); }

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

  load(query, signal) {
    const { connection } = this.#app;
    if (!connection.session) return Promise.reject(new Error(t('connection.lost')));
    return connection.api.slice(connection.session.id, connection.session.token, query, signal);
  }

  #forget() {
    this.#cache.clear();
    this.#volume = this.grid = this.#guest = null;
    for (const pane of this.panes.values()) pane.reset();
    this.#follow();
  }

  /** Takes the volume and the view. */
  #follow() {
    const { viewer } = this.#app;
    if (!this.shared || !viewer.isCurrent) return;
    const { volume } = viewer;
    const id = viewer.view.volume;
    if (id !== this.#volume) {
      this.#volume = id;
      this.grid = this.#home = null;
      for (const pane of this.panes.values()) pane.reset();
      this.#findHome(id);
    }
    if (!this.grid && volume?.dims) this.grid = new Grid(volume);
    if (!this.grid && !volume && this.areShown) this.#findGrid(id);
    this.update();
    this.emit('change');
  }

  async #findHome(id) {
    const { api, viewer, connection } = this.#app;
    // A guest does not get it: the camera now is a guess.
    const { camera } = connection.session?.isJoined ? viewer.view : await api.volumeView(id).catch(() => viewer.view);
    if (id !== this.#volume || !camera) return;
    this.#home = camera;
    this.update();
  }

  /** A guest does not get the list of volumes; two slices tell the grid. */
  async #findGrid(id) {
    if (this.#guest === id) return;
    this.#guest = id;
    try {
      const found = await Promise.all([2, 0].map((axis) => this.load({ axis, index: 0 }, null)));
      if (this.#volume !== id) return;
      this.grid = new Grid(gridOfSlices(...found.map(({ meta }) => meta)));
      this.update();
      this.emit('change');
    } catch (error) {
      this.#app.report(error);
    }
  }

  update() {
    if (this.areShown) {
      if (!this.grid) this.#findGridOnce();
      for (const pane of this.panes.values()) pane.update();
    }
    this.#app.overlay.update();
  }

  #findGridOnce() {
    const { viewer } = this.#app;
    if (viewer.isCurrent && !viewer.volume && this.#volume) this.#findGrid(this.#volume);
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

  nameOf({ kind, axis }) {
    if (kind === 'oblique' || this.anatomy) return t(`slices.${kind}`);
    return t('slices.across', { axis: 'xyz'[axis] });
  }

  scroll(plane, steps, time) {
    if (plane.axis === null) {
      this.setPosition(add(this.position, scale(plane.normal, steps * this.grid.smallest)), time);
      return;
    }
    const sign = dot(this.grid.axes[plane.axis], plane.normal) < 0 ? -1 : 1;
    this.goTo(plane.axis, this.grid.index(plane.axis, this.position) + sign * steps, time);
  }

  goTo(axis, index, time) {
    if (Number.isFinite(index)) this.change({ position: this.grid.moveTo(axis, this.position, index) }, time);
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

  // Lines in the panes.

  /** Where the lines of the other planes lie in a pane: [{plane, ends: two points in px}]. */
  #cuts(pane, toPane) {
    const reach = 2 * Math.hypot(...pane.size) / pane.view.zoom;
    return [...this.panes.values()].filter((other) => other !== pane).map((other) => {
      const plane = this.planeOf(other.id);
      const line = cutLine(pane.plane, plane, reach);
      return line && { plane, ends: line.map(toPane) };
    }).filter(Boolean);
  }

  /** The handles that turn the oblique plane in an orthogonal pane, px. */
  #handles(pane, toPane) {
    if (!this.isOblique || pane.plane.axis === null) return null;
    const cut = this.#cuts(pane, toPane).find(({ plane }) => plane.kind === 'oblique');
    if (!cut) return null;
    const [a, b] = cut.ends;
    const length = Math.hypot(b.x - a.x, b.y - a.y);
    const along = [(b.x - a.x) / length, (b.y - a.y) / length];
    const middle = toPane(this.position);
    const far = 0.36 * Math.min(...pane.size);
    return {
      middle: [middle.x, middle.y], along,
      places: [-far, far].map((way) => [middle.x + along[0] * way, middle.y + along[1] * way]),
    };
  }

  drawLines(pane, { group, toPane }) {
    const middle = toPane(this.position);
    const parts = this.#cuts(pane, toPane).flatMap(({ plane, ends }) => ends.map((end) => {
      const length = Math.hypot(end.x - middle.x, end.y - middle.y);
      const share = Math.min(1, GAP_PX / length);
      return svg('line', {
        class: 'slice-line', 'data-kind': plane.kind, x1: middle.x + (end.x - middle.x) * share, y1: middle.y + (end.y - middle.y) * share,
        x2: end.x, y2: end.y,
      });
    }));
    const handles = this.#handles(pane, toPane);
    for (const [x, y] of handles?.places ?? []) parts.push(svg('circle', { class: 'slice-handle', cx: x, cy: y, r: 6 }));
    group.replaceChildren(...parts);
  }

  /** What a drag at a place of a pane takes: a handle or the line of the oblique plane; null = the crosshair. */
  grab(pane, at) {
    const handles = this.#handles(pane, (world) => pane.toPane(world));
    if (!handles) return null;
    const away = (place) => Math.hypot(place[0] - at[0], place[1] - at[1]);
    const { middle, along, places } = handles;
    if (places.some((place) => away(place) < HANDLE_PX)) {
      return { kind: 'turn', normal: this.normal, from: Math.atan2(at[1] - middle[1], at[0] - middle[0]) };
    }
    const beside = Math.abs((at[0] - middle[0]) * along[1] - (at[1] - middle[1]) * along[0]);
    return beside < LINE_PX && away(middle) > 2 * GAP_PX ? { kind: 'shift', position: this.position, from: pane.toWorld(...at) } : null;
  }

  cursor(pane, at) {
    const grabbed = this.grid && pane.plane ? this.grab(pane, at) : null;
    return { turn: 'grab', shift: 'move' }[grabbed?.kind] ?? 'crosshair';
  }

  drag(pane, gesture, at, time) {
    if (gesture.kind === 'turn') {
      const { x, y } = pane.toPane(this.position);
      const angle = Math.atan2(at[1] - y, at[0] - x) - gesture.from;
      this.change({ normal: turnNormal(gesture.normal, pane.plane, angle) }, time);
    } else if (gesture.kind === 'shift') {
      const normal = normalize(this.normal);
      const moved = dot(subtract(pane.toWorld(...at), gesture.from), normal);
      this.setPosition(add(gesture.position, scale(normal, moved)), time);
    } else {
      this.setPosition(pane.toWorld(...at), time);
    }
  }

  /** Window and level by dragging in a pane, while that mode is on. */
  #windowTool() {
    let from = null;
    let before = null;
    const say = () => this.#app.modes.say(t('slices.window.text', { center: this.window.center.toPrecision(4), width: this.window.width.toPrecision(4) }));
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

  // In the 3-D picture.

  /** The mode in which a click or a drag in the picture moves the crosshair to what is seen there. */
  #addPicking() {
    const { modes, toolbar, connection, screen, notice, viewer } = this.#app;
    let wanted = null; // {at, time}
    let isAsking = false;
    const pick = async () => {
      if (isAsking || !wanted) return;
      const { at, time } = wanted;
      const { width, height } = screen.viewport;
      wanted = null;
      isAsking = true;
      try {
        const { position } = await connection.call('pick', { at: [at[0] * screen.size[0] / width, at[1] * screen.size[1] / height] });
        const nearest = this.#nearest(at, position);
        if (nearest) this.setPosition(nearest, time);
      } catch (error) {
        notice.show(error.message, 'error');
      } finally {
        isAsking = false;
        pick();
      }
    };
    const want = (at, { timeStamp }) => {
      wanted = { at, time: timeStamp };
      pick();
    };
    modes.add('crosshair', { label: t('slices.crosshair'), hint: t('slices.crosshair.hint'), cursor: 'crosshair', down: want, move: want });
    const button = toolbar.button({
      id: 'tool-crosshair', icon: 'crosshair', label: t('slices.crosshair'), group: 'tools', isToggle: true, press: () => modes.toggle('crosshair'),
    });
    modes.on('change', (name) => button.setAttribute('aria-pressed', String(name === 'crosshair')));
    viewer.on('view', () => { button.disabled = !viewer.canControl; });
  }

  /** The point seen at a place of the picture: of a slice in it, or of the volume (`position`) if that lies in front. */
  #nearest(at, position) {
    const { viewer, screen } = this.#app;
    const { in_3d: isDrawn, mode } = this.shared;
    if (!isDrawn || mode === 'none' || !this.grid) return position;
    const sight = ray(viewer.rig, at, screen.viewport);
    const planes = this.isOblique ? [this.planeOf('sagittal')] : orthogonalPlanes(this.grid, this.frame, this.position);
    const points = planes.map((plane) => meetPlane(sight, plane.origin, plane.normal)).filter((point) => point && this.grid.has(point));
    const way = (point) => dot(subtract(point, sight.origin), sight.direction);
    return [...points, ...(position ? [position] : [])].sort((a, b) => way(a) - way(b))[0] ?? null;
  }

  /** Outlines of the slices, and the crosshair, above the picture. A comparison hides them: they would mark A alone. */
  #drawIn3d(project, group) {
    const isOn = this.grid && this.shared && !this.#app.compare?.isOn && (this.areShown || this.shared.mode !== 'none');
    group.toggleAttribute('hidden', !isOn);
    if (!isOn) return group.replaceChildren();
    const parts = [];
    const line = (from, to, kind, name) => {
      const [a, b] = [project(from), project(to)];
      if ([a.x, a.y, b.x, b.y].every(Number.isFinite)) {
        parts.push(svg('line', { class: name, 'data-kind': kind, x1: a.x, y1: a.y, x2: b.x, y2: b.y }));
      }
    };
    const { grid, position } = this;
    const distances = grid.distances(position);
    for (const { kind, axis } of orthogonalPlanes(grid, this.frame, position)) {
      if (this.isOblique) break;
      const [u, v] = [0, 1, 2].filter((a) => a !== axis);
      const corner = (i, j) => add(position, add(scale(grid.axes[u], grid.extent(u)[i] - distances[u]), scale(grid.axes[v], grid.extent(v)[j] - distances[v])));
      const corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
      corners.forEach((from, i) => line(from, corners[(i + 1) % 4], kind, 'slice-outline'));
    }
    for (const a of [0, 1, 2]) {
      const reach = 0.04 * (grid.extent(a)[1] - grid.extent(a)[0]);
      line(add(position, scale(grid.axes[a], -reach)), add(position, scale(grid.axes[a], reach)), 'cross', 'slice-cross');
    }
    return group.replaceChildren(...parts);
  }
}
