// SPDX-License-Identifier: Apache-2.0
// The section "Layers": what the picture shows in one image: the volume, surfaces, a shell and vectors, and elements of this volume or of
// other ones (layers_elements.js, layers_add.js). The list is part of the state that the transfer function edits, so both share undo and
// redo. The marks of surfaces in the histogram are in layers_markers.js.
import { sphereAround, volumeBox } from '../../core/camera.js';
import { addChannels, patchForChannels } from '../../core/channels.js';
import { isSamePlace } from '../../core/compare.js';
import { hidesStreaks } from '../../core/hiding.js';
import { countText, kindOf, layerTypeOf } from '../../core/kinds.js';
import {
  FLATNESS_MAX, MAGNITUDE, addElements, addShell, addSurface, addVectors, canAdd, changeLayer, hasChannels, hasVectors, isChannel, isOfElements, layersOf, moveThreshold, numberOf,
  removeLayer, showOwn, showVolume, showsOthers, showsVolume, surfaceValue,
} from '../../core/layers.js';
import { numberText, roundValue } from '../../core/lengths.js';
import { SHEETS, isProjection } from '../../core/projection.js';
import { fitPlacement, matrixOf } from '../../core/placement.js';
import { logarithmic, quadratic } from '../../core/slider.js';
import { t } from '../../core/text.js';
import { showsValues } from '../../core/transfer.js';
import { fullNameOf } from '../../core/volume_names.js';
import { byId, make, setAttribute, setText } from '../controls/dom.js';
import { showNumber, showValue } from '../controls/fields.js';
import { LayerAdder } from './layers_add.js';
import { GaussiansDetails, GeometryDetails, PointsDetails } from './layers_elements.js';
import { LayerMarkers } from './layers_markers.js';
import { digits, hexOf, makeEye, makeRemover, onColor, onSlide, showEye, sliderRow } from './layers_rows.js';
import { VectorsDetails, createPlaying } from './layers_vectors.js';
import { ORDER } from '../shell/panel.js';

const MODE = 'surface-value';
const DISCS = 'inf';
const ENDS = ['low', 'high'];
const OFFER_MS = 12000;
const flatnessScale = logarithmic(1, FLATNESS_MAX);
const opacityScale = quadratic(1);

export const cssColor = (color) => `rgb(${color.map((part) => Math.round(part * 255)).join(' ')})`;

export function install(app) {
  const layers = new Layers(app);
  app.layers = layers;
  app.playing = createPlaying(app);
  const section = new LayersSection(app, layers);
  const markers = new LayerMarkers(byId('layer-markers'), layers);
  app.transfer.onShow(() => section.show());
  app.connection.on('volumes', () => app.transfer.plan());
  app.transfer.onPaint((xs) => markers.show(xs));
}

/** The list of layers and the selected one: an index, or -1 for none. */
export class Layers {
  #app; #gestures = 0; #gesture = null;
  selected = -1;

  constructor(app) { this.#app = app; }

  get list() { return this.#app.transfer.state?.layers ?? []; }
  get range() { return this.#app.transfer.range; }
  get isEditable() { return this.#app.transfer.isEditable; }

  /** Rounds a value to a fine step of a range: the range of all values, or the visible range. */
  round(value, range = this.range) { return roundValue(value, range); }

  /** What is called "Surface 2". */
  nameOf(index) {
    const { type, id } = this.list[index];
    if (id) return this.volumeName(id);
    return type === 'surface' ? t('layers.surface', { number: numberOf(this.list, index) }) : t(`layers.${type}`);
  }

  /** The volume of the list whose elements a layer shows; null = it is closed, or the list is not known. */
  volumeOf({ id }) { return id ? this.#app.connection.volumes.find((volume) => volume.id === id) ?? null : this.#app.viewer.volume; }

  volumeName(id) {
    const { volumes } = this.#app.connection;
    const volume = volumes.find((other) => other.id === id);
    return volume ? fullNameOf(volume, volumes) : id;
  }

  /** The id of a volume that the layer needs and that is not loaded; '' = there is none. */
  closedOf({ id, color_by: colors = '' }) {
    const isOpen = (needed) => ['ready', 'loading'].includes(this.volumeOf({ id: needed })?.state);
    return [id, colors === MAGNITUDE ? '' : colors].find((needed) => needed && !isOpen(needed)) ?? '';
  }

  isClosed(layer) { return Boolean(layer.id) && this.closedOf(layer) === layer.id; }

  get mayOpen() { return this.#app.mayOpen; }

  /** The name of the values of a volume; if they have no name, the name of the volume. */
  fieldName(id) { return this.volumeOf({ id })?.fields?.[0]?.name || this.volumeName(id); }

  /** Loads another field of the volume that a layer shows; use(id) gets the volume of the field as soon as it is ready. */
  async loadField(index, field, use) {
    const { api, notice, openVolume, viewer } = this.#app;
    const { id } = this.list[index];
    const shown = viewer.view.volume;
    try {
      openVolume(await api.openVolume({ volume: id || shown, field }), (volume) => {
        if (viewer.view?.volume === shown && this.isEditable) use(volume.id);
      });
    } catch (error) {
      notice.show(t('volumes.field.failed', { field, reason: error.message }), 'error', 'open');
    }
  }

  /** The sphere around the elements of a layer, or around the view's volume; null = not known. */
  sphereOf(layer) {
    const volume = this.volumeOf(layer);
    return volume?.dims ? sphereAround(volumeBox(volume)) : null;
  }

  /** The placement that shows a layer where the view's volume is, and as large; null = not known. */
  fitOf(layer) {
    const [from, into] = [this.sphereOf(layer), this.sphereOf({ id: '' })];
    return from && into ? fitPlacement(from, into) : null;
  }

  select(index) {
    this.selected = index;
    this.#app.transfer.plan();
  }

  /** A projection shows the volume and its channels alone, so a layer beside them returns to sheets. So do channels of single splats. */
  #edit(layers, time, gesture = null, more = {}) {
    const { notice, transfer, viewer } = this.#app;
    if (!this.isEditable) return;
    const { view } = viewer;
    const isBeside = isProjection(view) && showsOthers(layers);
    const isSplat = view.compositing?.mode === 'splat' && hasChannels(layers);
    const patch = patchForChannels(view, this.list, layers);
    transfer.edit({ layers, ...(isBeside || isSplat ? { shown: SHEETS } : {}), ...more }, { gesture, time });
    if (patch) viewer.change(patch, time);
    if (isBeside) notice.show(t('layers.sheets'));
  }

  /** The drag that goes on, as one step for undo; null = none. */
  get gesture() { return this.#gesture; }

  /** Adds channels {id, points}. points: the new ones of the volume, or null. */
  addChannels(channels, points, time) {
    this.#edit(addChannels(this.list, channels), time, null, points ? { points, map: null, gradient: [] } : {});
  }

  /** Begins a drag: its changes count as one for undo. */
  begin() {
    this.#gestures += 1;
    this.#gesture = `layer ${this.#gestures}`;
  }

  end() {
    this.#gesture = null;
    this.#app.transfer.seal();
  }

  change(index, change, time) {
    if (!this.list[index]) return;
    this.#edit(changeLayer(this.list, index, change), time, this.#gesture);
  }

  showVolume(visible, time) { this.#edit(showVolume(this.list, visible), time); }

  /** Hides the volume, or the elements of it. */
  hideOwn(time) { this.#edit(showOwn(showVolume(this.list, false), false), time); }

  /** Adds a surface; without a value, where it shows the object. */
  addSurface(time, value = this.round(surfaceValue(this.list, this.#app.transfer.points, this.#app.transfer.histogram, this.range))) {
    if (!this.isEditable || !canAdd(this.list, 'surface')) return;
    this.selected = this.list.length;
    this.#edit(addSurface(this.list, value), time);
    this.selected = this.list.length - 1;
  }

  addShell(time) {
    if (!this.isEditable || !canAdd(this.list, 'shell')) return;
    this.#edit(addShell(this.list, this.#app.transfer.points), time);
    this.selected = this.list.length - 1;
  }

  /** True if the volume has vectors that no layer shows. */
  get canAddVectors() { return hasVectors(this.#app.viewer.volume) && canAdd(this.list, 'vectors'); }

  addVectors(time) {
    if (!this.isEditable || !this.canAddVectors) return;
    this.#edit(addVectors(this.list, this.#app.viewer.volume), time);
    this.selected = this.list.length - 1;
  }

  /** The volumes whose elements a layer can show. */
  get sources() { return this.#app.connection.volumes.filter((volume) => volume.state === 'ready' && kindOf(volume) !== 'grid'); }

  /** Shows the elements of a volume in a new layer or, with `index`, in an existing one. Moves them into the picture if their coordinates are
   * elsewhere. */
  addVolume(volume, time, index = null) {
    const { viewer, notice } = this.#app;
    const type = layerTypeOf(kindOf(volume));
    if (!this.isEditable) return;
    if (type === 'volume') {
      notice.show(t('layers.add.grid', { name: this.volumeName(volume.id) }), 'warning');
      return;
    }
    if (this.list[index]?.type === type) {
      this.change(index, { id: volume.id }, time);
      return;
    }
    const list = this.list[index] ? this.list.filter((_, i) => i !== index) : this.list;
    if (!canAdd(list, type)) return;
    const layer = { id: volume.id === viewer.view.volume ? '' : volume.id };
    const sphere = this.sphereOf(layer);
    const isElsewhere = Boolean(layer.id) && !isSamePlace(sphere, this.sphereOf({ id: '' }));
    const fit = isElsewhere ? this.fitOf(layer) : null;
    this.#edit(addElements(list, type, layer.id, fit ? matrixOf(fit, sphere.center) : undefined), time);
    this.selected = this.list.length - 1;
    const name = this.volumeName(volume.id);
    const isHidden = type === 'points' && !showsValues(this.#app.transfer.points, volume.range);
    if (isHidden) notice.show(t('layers.add.hidden', { name, low: showNumber(volume.range[0]), high: showNumber(volume.range[1]) }), 'warning');
    else if (fit) notice.show(t('layers.add.fitted', { name }));
  }

  /** True if the layer may be removed: a volume without a grid has no other picture. */
  canRemove() { return this.#app.viewer.kind === 'grid' || this.list.length > 1; }

  remove(index, time) {
    this.#edit(removeLayer(this.list, index, layerTypeOf(this.#app.viewer.kind)), time);
    if (this.selected >= index) this.selected = Math.max(-1, Math.min(this.selected - 1, this.list.length - 1));
  }
}

class LayersSection {
  #app; #layers; #body; #list; #add; #adder; #undo; #redo;
  #details;
  #key = '';
  #offered = new Set(); // volumes whose vectors were offered
  #isHidingTold = false;

  constructor(app, layers) {
    this.#app = app;
    this.#layers = layers;
    this.#body = app.panel.section({ id: 'layers', title: t('layers.section'), order: ORDER.layers, isOpen: true });
    this.#list = make('ol', { id: 'layer-list', 'aria-label': t('layers.section') });
    this.#adder = new LayerAdder(app, layers, (add) => this.#added(add));
    const choose = (index) => this.#adder.show(index);
    this.#details = {
      surface: new SurfaceDetails(app, layers), shell: new ShellDetails(layers), vectors: new VectorsDetails(layers, app.playing),
      points: new PointsDetails(layers, choose), gaussians: new GaussiansDetails(layers, choose), geometry: new GeometryDetails(layers, choose),
    };
    this.#add = {
      surface: make('button', { id: 'layer-add-surface', text: t('layers.add.surface'), title: t('layers.add.surface.title'), 'data-needs': 'grid', press: ({ timeStamp }) => this.#added(() => layers.addSurface(timeStamp)) }),
      shell: make('button', { id: 'layer-add-shell', text: t('layers.add.shell'), title: t('layers.add.shell.title'), 'data-needs': 'grid', press: ({ timeStamp }) => this.#added(() => layers.addShell(timeStamp)) }),
      vectors: make('button', { id: 'layer-add-vectors', text: t('layers.add.vectors'), title: t('layers.add.vectors.title'), press: ({ timeStamp }) => this.#added(() => layers.addVectors(timeStamp)) }),
    };
    this.#body.dataset.pointer = '/layers';
    this.#undo = make('button', { id: 'layers-undo', text: t('layers.undo'), title: t('layers.undo.title'), press: ({ timeStamp }) => app.transfer.undo(timeStamp) });
    this.#redo = make('button', { id: 'layers-redo', text: t('layers.redo'), title: t('layers.redo.title'), press: ({ timeStamp }) => app.transfer.redo(timeStamp) });
    this.#body.append(this.#list, make('div', { class: 'buttons' }, ...Object.values(this.#add)), make('div', { class: 'buttons' }, this.#adder.button, this.#undo, this.#redo));
  }

  #added(add) {
    add();
    this.show();
    this.#list.querySelector('li:has(.layer-details)')?.scrollIntoView?.({ block: 'nearest' });
  }

  #volumeRow() {
    const layers = this.#layers;
    return make('li', { 'data-type': 'volume' }, make('div', { class: 'row' },
      makeEye(t('layers.volume'), ({ timeStamp }) => layers.showVolume(!showsVolume(layers.list), timeStamp)),
      make('span', { class: 'layer-name', text: t('layers.volume') })));
  }

  #row(index) {
    const layers = this.#layers;
    const { type } = layers.list[index];
    const name = layers.nameOf(index);
    const remove = makeRemover(name, ({ timeStamp }) => {
      layers.remove(index, timeStamp);
      this.show();
      (this.#list.querySelector('.layer-pick[aria-expanded="true"]') ?? this.#add[type] ?? this.#adder.button).focus();
    });
    return make('li', { 'data-type': type, 'data-index': index }, make('div', { class: 'row' },
      makeEye(name, ({ timeStamp }) => layers.change(index, { visible: !layers.list[index].visible }, timeStamp)),
      make('button', { class: 'layer-pick', press: () => layers.select(layers.selected === index ? -1 : index) },
        make('span', { class: 'swatch', 'aria-hidden': 'true' }), make('span', { class: 'layer-name', text: name }), make('span', { class: 'layer-value' })),
      remove));
  }

  show() {
    const layers = this.#layers;
    const { list, isEditable } = layers;
    this.#body.toggleAttribute('inert', !isEditable);
    const indices = list.map((_, i) => i).filter((i) => list[i].type in this.#details);
    const isGrid = this.#app.viewer.kind === 'grid';
    const key = JSON.stringify([isGrid, list.map(({ type }, i) => [type, type in this.#details && layers.nameOf(i)])]);
    if (key !== this.#key) {
      this.#key = key;
      for (const { root } of Object.values(this.#details)) root.remove();
      this.#list.replaceChildren(...(isGrid ? [this.#volumeRow()] : []), ...indices.map((i) => this.#row(i)));
    }
    if (isGrid) showEye(this.#list.firstElementChild, showsVolume(list));
    indices.forEach((i, at) => this.#showRow(this.#list.children[at + Number(isGrid)], i));
    for (const [type, button] of Object.entries(this.#add)) button.disabled = !canAdd(list, type);
    this.#add.vectors.hidden = !hasVectors(this.#app.viewer.volume);
    this.#adder.follow();
    this.#undo.disabled = !this.#app.transfer.canUndo;
    this.#redo.disabled = !this.#app.transfer.canRedo;
    this.#offerVectors();
    this.#tellClosed();
    this.#tellHidden();
  }

  /** Says that the volume hides the streaks inside of it. */
  #tellHidden() {
    const { prompts, transfer, viewer } = this.#app;
    const layers = this.#layers;
    if (!layers.isEditable || !hidesStreaks(viewer.view ?? {}, transfer.histogram, viewer.volume)) {
      prompts.hide('streaks');
      this.#isHidingTold = false;
    } else if (!this.#isHidingTold) {
      this.#isHidingTold = true;
      prompts.show('streaks', { text: t('layers.vectors.inside'), actions: [{ label: t('layers.vectors.alone'), press: () => layers.hideOwn(performance.now()) }], ms: OFFER_MS });
    }
  }

  /** Says that the volume of a visible layer is not loaded, because then there is no picture. */
  #tellClosed() {
    const { prompts } = this.#app;
    const layers = this.#layers;
    const index = layers.isEditable ? layers.list.findIndex((layer) => layer.visible && layers.closedOf(layer)) : -1;
    if (index < 0) {
      prompts.hide('closed');
      return;
    }
    const hide = { label: t('layers.closed.hide'), press: () => layers.change(index, { visible: false }, performance.now()) };
    if (isChannel(layers.list[index])) {
      prompts.show('closed', { text: t('layers.closed.told', { name: layers.nameOf(index) }), actions: [hide] });
      return;
    }
    if (!layers.isClosed(layers.list[index])) {
      prompts.show('closed', {
        text: t('layers.color_by.closed', { name: layers.nameOf(index), id: layers.closedOf(layers.list[index]) }),
        actions: [{ label: t('layers.color_by.reset'), press: () => layers.change(index, { color_by: '' }, performance.now()) }],
      });
      return;
    }
    prompts.show('closed', {
      text: t('layers.closed.told', { name: layers.nameOf(index) }), actions: [
        { label: t('layers.closed.choose'), press: () => this.#adder.show(index) },
        hide,
      ],
    });
  }

  /** Says once that a volume has vectors, because its first picture does not show them. */
  #offerVectors() {
    const { prompts, viewer } = this.#app;
    const layers = this.#layers;
    if (!layers.isEditable || !layers.canAddVectors) {
      prompts.hide('vectors');
    } else if (!this.#offered.has(viewer.volume.id)) {
      this.#offered.add(viewer.volume.id);
      const press = () => this.#added(() => layers.addVectors(performance.now()));
      prompts.show('vectors', { text: t('layers.vectors.offer'), actions: [{ label: t('layers.add.vectors'), press }], ms: OFFER_MS });
    }
  }

  /** What is written at the end of the row of a layer. */
  #describe(layer) {
    if (layer.type === 'surface') return numberText(this.#layers.round(layer.value));
    if (layer.type === 'shell') return t('layers.thresholds', { low: showNumber(layer.low), high: showNumber(layer.high) });
    if (layer.type === 'vectors') return t(`layers.style.${layer.style}`);
    if (this.#layers.isClosed(layer)) return t('layers.closed');
    return layer.id ? t(`layers.${layer.type}`) : countText(this.#layers.volumeOf(layer));
  }

  #showRow(item, index) {
    const layer = this.#layers.list[index];
    const isSelected = index === this.#layers.selected;
    const isColored = layer.type === 'surface' || layer.type === 'geometry' || layer.style === 'blend';
    item.toggleAttribute('data-closed', this.#layers.isClosed(layer));
    item.querySelector('.small').disabled = !this.#layers.canRemove();
    showEye(item, layer.visible);
    setAttribute(item.querySelector('.layer-pick'), 'aria-expanded', isSelected);
    item.querySelector('.swatch').style.backgroundColor = isColored ? cssColor(layer.color) : '';
    setText(item.querySelector('.layer-value'), this.#describe(layer));
    const details = this.#details[layer.type];
    if (isSelected) {
      if (details.root.parentElement !== item) item.append(details.root);
      details.show(index);
    } else if (details.root.parentElement === item) {
      details.root.remove();
    }
  }
}

class SurfaceDetails {
  #layers; #app;
  #index = -1;
  #value; #number; #color; #opacity; #flatness; #pick;

  constructor(app, layers) {
    this.#app = app;
    this.#layers = layers;
    this.#value = make('input', { id: 'surface-slider', type: 'range', min: 0, max: 1, step: 0.001 });
    this.#number = make('input', { id: 'surface-value', type: 'number', step: 'any', 'aria-label': t('layers.value') });
    this.#color = make('input', { id: 'surface-color', type: 'color' });
    this.#opacity = make('input', { id: 'surface-opacity', type: 'range', min: 0, max: 1, step: 0.01 });
    this.#flatness = make('input', { id: 'surface-flatness', type: 'range', min: 0, max: 1, step: 0.01 });
    this.#pick = make('button', { id: 'surface-pick', text: t('layers.pick'), title: t('layers.pick.title'), 'aria-pressed': 'false', press: () => app.modes.toggle(MODE) });
    const set = (change, time) => layers.change(this.#index, change, time);
    onSlide(layers, this.#value, (share, time) => set({ value: this.#valueAt(share) }, time));
    this.#number.addEventListener('change', ({ timeStamp }) => {
      if (Number.isFinite(this.#number.valueAsNumber)) set({ value: this.#number.valueAsNumber }, timeStamp);
      app.transfer.plan();
    });
    onSlide(layers, this.#opacity, (opacity, time) => set({ opacity }, time));
    onSlide(layers, this.#flatness, (at, time) => set({ flatness: at >= 1 ? DISCS : flatnessScale.at(at) }, time));
    onColor(layers, this.#color, (color, time) => set({ color }, time));
    this.root = make('div', { class: 'layer-details' },
      sliderRow({ id: 'surface-slider', label: t('layers.value'), title: t('layers.value.title'), slider: this.#value, value: this.#number }),
      make('div', { class: 'row' }, make('label', { for: 'surface-color', text: t('layers.color') }), this.#color, this.#pick),
      sliderRow({ id: 'surface-opacity', label: t('layers.opacity'), slider: this.#opacity }),
      make('details', { class: 'fold' }, make('summary', {}, make('h3', { text: t('layers.advanced') })),
        sliderRow({ id: 'surface-flatness', label: t('layers.flatness'), title: t('layers.flatness.title'), slider: this.#flatness })));
    this.#addMode();
  }

  /** The mode in which a click or a drag in a slice takes the value there. */
  #addMode() {
    const { modes, viewer } = this.#app;
    const layers = this.#layers;
    const take = (at, { timeStamp }, pane) => {
      const value = pane.valueAt(pane.toWorld(...at));
      if (value !== null && Number.isFinite(value)) layers.change(this.#index, { value: digits(value) }, timeStamp);
    };
    modes.add(MODE, {
      label: t('layers.pick'), hint: t('layers.pick.hint'), isForPanes: true,
      enter: () => this.#app.layout.current === '3d' && this.#app.layout.set('four'),
      panes: {
        cursor: 'crosshair',
        down: (at, event, pane) => {
          layers.begin();
          take(at, event, pane);
        },
        move: take, up: () => layers.end(), cancel: () => layers.end(),
      },
    });
    modes.on('change', (name) => setAttribute(this.#pick, 'aria-pressed', name === MODE));
    viewer.on('view', () => {
      if (modes.current === MODE && (!layers.isEditable || layersOf(viewer.view)[this.#index]?.type !== 'surface')) modes.leave(MODE);
    });
  }

  #valueAt(share) {
    const [low, high] = this.#layers.range;
    return this.#layers.round(low + (high - low) * share);
  }

  show(index) {
    this.#index = index;
    const { value, color, opacity, flatness } = this.#layers.list[index];
    const [low, high] = this.#layers.range;
    this.#value.value = String((value - low) / (high - low));
    this.#value.setAttribute('aria-valuetext', numberText(this.#layers.round(value)));
    if (document.activeElement !== this.#number || this.#number.valueAsNumber === value) this.#number.value = String(digits(value));
    this.#color.value = hexOf(color);
    this.#opacity.value = String(opacity);
    showValue(this.#opacity, showNumber(opacity));
    this.#flatness.value = String(flatness === DISCS ? 1 : Math.min(flatnessScale.of(flatness), 0.99));
    showValue(this.#flatness, flatness === DISCS ? t('layers.flatness.discs') : t('layers.times', { factor: showNumber(flatness) }));
  }
}

class ShellDetails {
  #layers;
  #index = -1;
  #sliders; #numbers; #detail;

  constructor(layers) {
    this.#layers = layers;
    const inputs = (attributes) => ENDS.map((name) => make('input', { ...attributes, 'data-end': name, 'aria-label': t(`layers.${name}`) }));
    this.#sliders = inputs({ type: 'range', min: 0, max: 1, step: 0.005 });
    this.#numbers = inputs({ type: 'number', min: 0, max: 1, step: 'any' });
    this.#detail = make('select', { id: 'shell-detail' }, ...['high', 'fast'].map((name) => new Option(t(`layers.detail.${name}`), name)));
    ENDS.forEach((name, i) => {
      const move = (value, time) => layers.change(this.#index, moveThreshold(layers.list[this.#index], name, value), time);
      onSlide(layers, this.#sliders[i], (at, time) => move(opacityScale.at(at), time));
      this.#numbers[i].addEventListener('change', ({ timeStamp }) => {
        if (Number.isFinite(this.#numbers[i].valueAsNumber)) move(this.#numbers[i].valueAsNumber, timeStamp);
        this.show(this.#index);
      });
    });
    this.#detail.addEventListener('change', ({ timeStamp }) => layers.change(this.#index, { detail: this.#detail.value }, timeStamp));
    this.root = make('div', { class: 'layer-details' },
      make('div', { role: 'group', 'aria-label': t('layers.thresholds.label'), title: t('layers.thresholds.title') },
        make('div', { class: 'row' }, make('span', { text: t('layers.opacity') }), make('span', { class: 'range' }, this.#numbers[0], '–', this.#numbers[1])),
        make('span', { class: 'pair' }, ...this.#sliders)),
      make('div', { class: 'row', title: t('layers.detail.title') }, make('label', { for: 'shell-detail', text: t('layers.detail') }), this.#detail));
  }

  show(index) {
    this.#index = index;
    const layer = this.#layers.list[index];
    ENDS.forEach((name, i) => {
      const [slider, number] = [this.#sliders[i], this.#numbers[i]];
      slider.value = String(opacityScale.of(layer[name]));
      slider.setAttribute('aria-valuetext', showNumber(layer[name]));
      slider.parentElement.style.setProperty(`--${name}`, slider.value);
      if (document.activeElement !== number || number.valueAsNumber === layer[name]) number.value = String(digits(layer[name]));
    });
    this.#detail.value = layer.detail;
  }
}
