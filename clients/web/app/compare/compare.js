// SPDX-License-Identifier: Apache-2.0
// Comparison of the session's picture (A) with a second one (B) under the same camera: side by side, or split by a divider. B is a session
// of its own (companion.js), so that the daemon renders both halves in full quality, and only this page sees B.
import { rigFromCamera, sphereAround, volumeBox } from '../../core/camera.js';
import { isInSight, isSamePlace, linkedCamera, settingsOf } from '../../core/compare.js';
import { anatomyOf, frameOf, turnBetween } from '../../core/orientation.js';
import { t } from '../../core/text.js';
import { fullNameOf } from '../../core/volume_names.js';
import { Companion } from './companion.js';
import { Divider } from './compare_divider.js';
import { byId, make, setText } from '../controls/dom.js';
import { Cube, namesOf } from '../camera/orientation.js';
import { attachPointers, attachWheel } from '../camera/pointer.js';

const COPY = 'copy';

export function install(app) {
  const body = app.panel.section({ id: 'compare' });
  app.layout.add('compare');
  const compare = new Compare(app, body);
  const button = app.toolbar.button({ id: 'tool-compare', press: () => compare.toggle() });
  compare.onChange(() => button.setAttribute('aria-pressed', String(compare.isOn)));
  app.compare = compare;
}

class Compare {
  #app; #source; #start; #running; #fit; #fitRow; #note; #mode; #swap;
  #canvas; #layer; #pane; #stage; #divider; #badges; #lost;
  #companion = null;
  #isStarting = false;
  #told = new Set();
  #listed = null; // the volume of A that the list of sources leaves out
  #cube; // the directions of B
  #directions = { anatomy: null, frame: frameOf(null), ...namesOf(null) };
  #pair = ''; // the volumes for which "Fit B to A" was chosen

  constructor(app, body) {
    this.#app = app;
    this.#stage = byId('pane-3d');
    this.#canvas = make('canvas', { id: 'screen-b', role: 'img', 'aria-label': t('compare.label.b') });
    this.#layer = make('div', { id: 'warp-b', 'aria-hidden': 'true', 'data-kind': 'depth', hidden: true });
    this.#pane = app.layout.pane('compare', t('compare.b'), { layouts: ['compare'] });
    this.#lost = make('div', { id: 'compare-lost', class: 'prompt', role: 'status', hidden: true }, make('p'),
      make('div', { class: 'buttons' }, make('button', { id: 'compare-lost-fit', text: t('compare.fit'), press: () => this.#setFit(true) })));
    this.#divider = new Divider(this.#stage, (percent) => {
      for (const part of [this.#canvas, this.#layer]) part.style.clipPath = `inset(0 0 0 ${percent}%)`;
      this.#lost.style.setProperty('--split', `${percent}%`);
      this.#app.overlay.update();
    });
    this.#badges = ['a', 'b'].map((name) => make('p', { class: 'compare-badge', 'data-side': name, hidden: true }, make('strong', { text: t(`compare.${name}`) }), make('span')));
    this.#stage.append(this.#divider.element, ...this.#badges);
    this.#cube = new Cube({ viewer: { orientation: null }, orientation: this.#directions }, { id: 'cube-b', pane: this.#pane, isQuiet: true });
    this.#build(body);
    this.#follow();
    this.#show();
  }

  #build(body) {
    this.#source = make('select', { id: 'compare-source' });
    this.#source.addEventListener('change', () => this.#companion && this.#run(() => this.#load(this.#source.value)));
    this.#mode = make('select', { id: 'compare-mode' }, make('option', { value: 'divider', text: t('compare.mode.divider') }), make('option', { value: 'side', text: t('compare.mode.side') }));
    this.#mode.value = this.#app.storage.recall('compare') === 'side' ? 'side' : 'divider';
    this.#mode.addEventListener('change', () => {
      this.#app.storage.remember('compare', this.#mode.value);
      this.#show();
    });
    this.#fit = make('input', { id: 'compare-fit', type: 'checkbox', role: 'switch' });
    this.#fit.addEventListener('change', () => this.#look());
    this.#fitRow = make('div', { class: 'row', title: t('compare.fit.title') }, make('label', { for: 'compare-fit', text: t('compare.fit') }), this.#fit);
    this.#start = make('button', { id: 'compare-start', text: t('compare.start'), press: () => this.start() });
    this.#swap = make('button', { id: 'compare-swap', text: t('compare.swap'), title: t('compare.swap.title'), press: () => this.#run(() => this.#exchange()) });
    this.#running = make('div', { hidden: true }, this.#fitRow,
      make('div', { class: 'buttons' }, this.#swap,
        make('button', { id: 'compare-copy', text: t('compare.copy'), title: t('compare.copy.title'), press: () => this.#copy() }),
        make('button', { id: 'compare-end', text: t('compare.end'), press: () => this.stop() })));
    this.#note = make('p', { class: 'about', id: 'compare-note', role: 'status' });
    body.append(
      make('div', { class: 'row' }, make('label', { for: 'compare-source', text: t('compare.source') }), this.#source),
      make('div', { class: 'row' }, make('label', { for: 'compare-mode', text: t('compare.mode') }), this.#mode),
      make('div', { class: 'buttons' }, this.#start), this.#running, this.#note);
  }

  #follow() {
    const { viewer, connection, layout } = this.#app;
    viewer.on('camera', () => this.#look());
    viewer.on('view', (view) => {
      if (view.volume !== this.#listed) this.listSources();
      this.#look();
      this.#label();
    });
    connection.on('volumes', () => this.listSources());
    // The daemon gives a session whose volume is closed another one, which is not what B is for.
    connection.on('notification', ({ method, params }) => {
      if (method === 'volume.progress' && params.state === 'unloaded' && params.volume === this.#companion?.view.volume) this.#ended();
    });
    layout.on('change', (name) => {
      if (!this.#companion || name === 'compare' || this.#mode.value !== 'side') return;
      this.#mode.value = 'divider';
      this.#show();
    });
    window.addEventListener('pagehide', () => this.#companion?.stop());
    const nothing = () => false;
    const noTool = { down: nothing, move: nothing, up: nothing, hover: nothing, cancel: nothing, double: nothing, wheel: nothing };
    attachPointers(this.#canvas, viewer, noTool);
    attachWheel(this.#canvas, viewer, noTool);
    this.#canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  }

  get isOn() { return this.#companion !== null; }
  /** True while a part of the 3-D picture is B. */
  get splitsPicture() { return !this.#divider.element.hidden; }
  /** For tests: B, or null. */
  get companion() { return this.#companion; }
  /** Id of the volume that B shows; null = there is none. */
  get volume() { return this.#companion?.view?.volume ?? null; }
  /** The share of the 3-D picture, from the left, that no other volume covers. */
  get freeShare() {
    return this.#divider.element.hidden || this.volume === this.#app.viewer.view.volume ? 1 : this.#divider.percent / 100;
  }

  onChange(told) { this.#told.add(told); }

  toggle() {
    if (this.isOn) this.stop();
    else this.start();
  }

  /** Lists what B can be. */
  listSources() {
    const { connection, viewer, saved } = this.#app;
    const before = this.#source.value || COPY;
    this.#listed = viewer.view?.volume ?? null;
    const volumes = connection.volumes.filter((v) => v.state === 'ready' && v.id !== viewer.view?.volume);
    const views = saved?.views ?? [];
    const group = (label, options) => (options.length ? [make('optgroup', { label }, ...options)] : []);
    this.#source.replaceChildren(
      make('option', { value: COPY, text: t('compare.source.copy') }),
      ...group(t('saved.section'), views.map((view) => make('option', { value: `view:${view.id}`, text: saved.nameOf(view) }))),
      ...group(t('compare.source.volumes'), volumes.map((v) => make('option', { value: `volume:${v.id}`, text: fullNameOf(v, connection.volumes) }))));
    this.#source.value = before;
    if (!this.#source.value) this.#source.value = COPY;
  }

  /** The view that B starts with. */
  async #viewOf(source) {
    const { api, viewer } = this.#app;
    const [kind, id] = source.split(/:(.*)/s);
    if (kind === 'view') return api.savedView(id);
    if (kind === 'volume') return { ...await api.volumeView(id), background: viewer.view.background };
    return viewer.view;
  }

  async #run(act) {
    try {
      setText(this.#note, '');
      await act();
    } catch (error) {
      setText(this.#note, error.status === 429 || error.status === 503 ? t('compare.limit', { reason: error.message }) : error.message);
      this.#app.panel.reveal('compare');
    }
  }

  async start(source = this.#source.value || COPY) {
    const { connection, viewer, participants } = this.#app;
    if (this.#companion || this.#isStarting || !viewer.view || !connection.isLive) return;
    if (connection.session.isJoined && !participants.hasControlRole) {
      setText(this.#note, t('compare.watching'));
      this.#app.panel.reveal('compare');
      return;
    }
    this.#isStarting = true;
    await this.#run(async () => this.#begin(await this.#viewOf(source)));
    this.#isStarting = false;
    this.#show();
  }

  async #begin(view) {
    const { api, connection, viewer, screen, base } = this.#app;
    const { session } = connection;
    const size = screen.size;
    const made = session.isJoined ? await api.sessionFrom(session.id, session.token)
      : await api.createSession({ ...view, camera: this.#linked(view.volume), size });
    this.#layer.replaceChildren(make('canvas', {})); // a canvas keeps its first kind of context
    this.#companion = new Companion({
      base, env: connection.env, api, made, canvas: this.#canvas, layer: this.#layer, isGuests: Boolean(session.isJoined),
      isPredicted: () => this.#app.warp.isOn,
    });
    this.#companion.on('view', () => this.#label());
    this.#companion.on('failed', (error) => setText(this.#note, error.message));
    this.#companion.on('ended', () => this.#ended());
    this.#label();
    if (this.#divider.percent === 50) this.#divider.set(50);
    this.#look();
    this.#app.panel.unfold('compare');
  }

  /** B is gone. */
  #ended() {
    this.stop();
    setText(this.#note, t('compare.ended'));
    this.#app.panel.reveal('compare');
  }

  stop() {
    this.#companion?.stop();
    this.#companion = null;
    this.#pair = '';
    setText(this.#note, '');
    this.#show();
  }

  /** Shows other settings as B. */
  async #load(source) {
    const view = await this.#viewOf(source);
    this.#companion?.change(settingsOf(view));
    this.#look();
  }

  #copy() {
    this.#companion.change(settingsOf(this.#app.viewer.view));
    this.#look();
  }

  #exchange() {
    const { viewer } = this.#app;
    const { volume } = viewer.view;
    const [a, b] = [viewer.view, this.#companion.view].map((view) => ({ ...settingsOf(view), camera: linkedCamera(view.camera) }));
    viewer.restore({ ...viewer.view, ...b });
    this.#companion.change(a);
    this.#source.value = `volume:${volume}`;
    if (!this.#source.value) this.#source.value = COPY; // both show one volume
  }

  #volume(id) {
    return this.#app.connection.volumes.find((v) => v.id === id) ?? null;
  }

  #sphere(id) {
    const volume = this.#volume(id);
    return volume?.dims ? sphereAround(volumeBox(volume)) : null;
  }

  /** The turn from the world of A's volume to the world of B's volume. */
  #turn([a, b]) {
    return turnBetween(anatomyOf(this.#volume(a)), anatomyOf(this.#volume(b)));
  }

  #setFit(isFitted) {
    this.#fit.checked = isFitted;
    this.#look();
  }

  /** Fits two volumes that were not compared before, if world units do not show both. */
  #chooseFit(volumes) {
    const pair = [...volumes].sort().join(' ');
    if (pair === this.#pair || volumes[0] === volumes[1]) return;
    this.#pair = pair;
    this.#setFit(!isSamePlace(...volumes.map((id) => this.#sphere(id)), this.#turn(volumes)));
  }

  /** Says that the camera shows nothing of B. */
  #tellLost() {
    const { volume } = this;
    const sphere = this.#sphere(volume);
    const box = this.#canvas.getBoundingClientRect();
    const isLost = this.isOn && sphere !== null && box.height > 0 && !isInSight(this.#companion.view.camera, sphere, box);
    this.#lost.hidden = !isLost;
    if (isLost) setText(this.#lost.firstChild, t('compare.lost', { name: this.#nameOf(volume) }));
  }

  /** The camera of A for B, which shows the volume `id`. */
  #linked(id) {
    const { camera, view } = this.#app.viewer;
    const volumes = [view.volume, id];
    return linkedCamera(camera, this.#turn(volumes), ...(this.#fit.checked ? volumes.map((volume) => this.#sphere(volume)) : []));
  }

  /** B gets the camera of A. */
  #look(time) {
    const { viewer } = this.#app;
    if (!this.#companion || !viewer.isSettled) return;
    this.#companion.look(this.#linked(this.#companion.view.volume), time);
    this.#drawCube();
    this.#tellLost();
  }

  #nameOf(id) {
    const volume = this.#volume(id);
    return volume ? fullNameOf(volume, this.#app.connection.volumes) : id;
  }

  #label() {
    this.#app.overlay.update(); // B may cover more or less of it
    if (!this.#companion) return;
    const { viewer } = this.#app;
    const volumes = [viewer.view.volume, this.#companion.view.volume];
    this.#badges.forEach((badge, i) => setText(badge.lastChild, this.#nameOf(volumes[i])));
    this.#nameCube(this.#volume(volumes[1]));
    this.#chooseFit(volumes);
    this.#fitRow.hidden = volumes[0] === volumes[1];
    this.#swap.disabled = !viewer.canControl;
  }

  #nameCube(volume) {
    const anatomy = anatomyOf(volume);
    Object.assign(this.#directions, { anatomy, frame: anatomy ? frameOf(anatomy) : this.#app.orientation.frame, ...namesOf(anatomy) });
    this.#cube.name();
    this.#drawCube();
  }

  #drawCube() { this.#cube.draw(rigFromCamera(this.#companion.view.camera).orientation); }

  #show() {
    const { layout } = this.#app;
    const isSide = this.isOn && this.#mode.value === 'side';
    const isSplit = this.isOn && !isSide;
    this.#start.hidden = this.isOn;
    this.#running.hidden = !this.isOn;
    this.#divider.element.hidden = !isSplit;
    this.#stage.toggleAttribute('data-compare', isSplit);
    for (const badge of this.#badges) badge.hidden = !this.isOn;
    if (isSide) {
      this.#pane.append(this.#canvas, this.#layer, this.#cube.root, this.#badges[1], this.#lost);
      for (const part of [this.#canvas, this.#layer]) part.style.clipPath = 'none';
      this.#lost.style.setProperty('--split', '0%');
      layout.set('compare');
    } else {
      if (layout.current === 'compare') layout.set('3d');
      if (isSplit) {
        for (const part of [this.#canvas, this.#layer]) this.#stage.insertBefore(part, byId('overlay'));
        this.#divider.element.append(...this.#badges);
        this.#stage.append(this.#lost);
        this.#divider.set(this.#divider.percent);
      } else {
        for (const part of [this.#canvas, this.#layer]) part.remove();
      }
    }
    if (isSide) this.#stage.append(this.#badges[0]);
    this.#label();
    this.#tellLost();
    for (const told of this.#told) told();
  }
}
