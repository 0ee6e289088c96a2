// SPDX-License-Identifier: Apache-2.0
// The section "Edit": cuts by planes, boxes and spheres, and connected parts that are removed or kept. The list is part of the state that
// the transfer function edits, so both share undo and redo. Points come from the picture or from a slice (tools below).
import { depthOf, flipPlane, planeAt, positionOf, sight } from '../../core/clip.js';
import { boxEdit, canAddEdits, changeEdit, editsOfClip, partEdit, planeEdit, rangeOfPart, removeEdit, sphereEdit } from '../../core/edits.js';
import { quadratic } from '../../core/slider.js';
import { t } from '../../core/text.js';
import { placeOf } from '../../core/vertical.js';
import { BoxRows } from '../clip/clip.js';
import { icon, make, setAttribute, setText } from '../controls/dom.js';
import { installEditHandles } from './edit_handles.js';
import { tellIfNothing } from '../rendering/nothing_visible.js';
import { pickAt } from '../rendering/pick.js';

const RADIUS = 0.08; // of a new sphere, in diagonals of the volume
const RADIUS_MAX = 0.5;
const CHECK_MS = 300; // without a change
const PARTS = { 'edit-remove': 'outside', 'edit-keep': 'inside' };
const MODES = [...Object.keys(PARTS), 'edit-sphere'];
const digits = (value) => Number(value.toPrecision(6));
const radiusScale = quadratic(RADIUS_MAX);

export function install(app) {
  const edits = new Edits(app);
  app.edits = edits;
  for (const name of MODES) app.modes.add(name, new PointMode(app, edits, name).mode);
  const section = new EditSection(app, edits);
  installEditHandles(app, edits, section.fold);
  app.transfer.onShow(() => {
    section.show();
    edits.check();
  });
  app.modes.on('change', () => section.show());
}

/** The list of edits and the selected one: an index, or -1 for none. */
class Edits {
  #app; #gestures = 0; #gesture = null;
  #checked = '[]'; // the newest edits that check() knows
  #timer = null; // until it asks the daemon
  selected = -1;

  constructor(app) { this.#app = app; }

  get list() { return this.#app.transfer.state?.edits ?? []; }
  get isEditable() { return this.#app.transfer.isEditable; }

  select(index) {
    this.selected = index;
    this.#app.transfer.plan();
  }

  #edit(edits, time, gesture = null) {
    this.#app.transfer.edit({ edits }, { gesture, time });
  }

  /** Begins a drag: its changes count as one for undo. */
  begin() {
    this.#gestures += 1;
    this.#gesture = `edit ${this.#gestures}`;
  }

  end() {
    this.#gesture = null;
    this.#app.transfer.seal();
  }

  /** Adds edits; false if there is no space or no control. */
  add(edits, time) {
    if (!this.isEditable || edits.length === 0 || !canAddEdits(this.list, edits.length)) return false;
    this.#edit([...this.list, ...edits], time);
    this.selected = this.list.length - 1;
    return true;
  }

  change(index, change, time) {
    if (this.list[index]) this.#edit(changeEdit(this.list, index, change), time, this.#gesture);
  }

  remove(index, time) {
    this.#edit(removeEdit(this.list, index), time);
    if (this.selected >= index) this.selected = Math.min(this.selected - 1, this.list.length - 1);
  }

  reset(time) {
    this.selected = -1;
    this.#edit([], time);
  }

  /** Says after a change of the edits, such as a drag, that they leave nothing visible. */
  check() {
    const key = JSON.stringify(this.list);
    if (key === this.#checked) return;
    this.#checked = key;
    this.#app.prompts.hide('edits');
    clearTimeout(this.#timer);
    if (this.isEditable && this.list.length > 0) this.#timer = setTimeout(() => tellIfNothing(this.#app, {
      id: 'edits', text: t('edits.all'), isLate: () => key !== JSON.stringify(this.list),
    }), CHECK_MS);
  }
}

/** A mode that takes one point: of a part, or the centre of a sphere. */
class PointMode {
  #app; #edits; #name;

  constructor(app, edits, name) {
    this.#app = app;
    this.#edits = edits;
    this.#name = name;
    app.transfer.onShow(() => edits.isEditable || app.modes.leave(name));
  }

  get mode() {
    const take = (at, { timeStamp }, pane = null) => this.#take(at, timeStamp, pane);
    const pointer = { cursor: 'crosshair', down: () => {}, up: take };
    return { label: t(`edits.${this.#name}`), hint: t(`edits.${this.#name}.hint`), ...pointer, panes: pointer, key: (event) => this.#key(event) };
  }

  /** Enter takes the middle of the picture, which the arrow keys turn. */
  #key({ key, target, timeStamp }) {
    if (key !== 'Enter' || target.closest?.('button, summary, a, .pane-body canvas.slice')) return false;
    const { width, height } = this.#app.screen.viewport;
    this.#take([width / 2, height / 2], timeStamp, null);
    return true;
  }

  async #take(at, time, pane) {
    const { modes, viewer, transfer, clip } = this.#app;
    const { view } = viewer;
    const world = pane?.toWorld(...at);
    const found = pane ? { position: world, value: pane.valueAt(world) } : await pickAt(this.#app, at);
    const isLate = viewer.view.volume !== view.volume || modes.current !== this.#name;
    if (!found || found.value === null || !Number.isFinite(found.value) || isLate) return;
    const edit = this.#name in PARTS ? partEdit(found.position, rangeOfPart(view, found.value, transfer.range), PARTS[this.#name])
      : sphereEdit(found.position, digits(clip.extent * RADIUS));
    modes.leave(this.#name);
    this.#edits.add([edit], time);
  }
}

class EditSection {
  #app; #edits; #body; #list; #empty; #tools; #adders; #undo; #redo; #reset; #details;
  #key = '';

  constructor(app, edits) {
    this.#app = app;
    this.#edits = edits;
    this.#body = app.panel.section({ id: 'edit' });
    this.#body.dataset.pointer = '/edits';
    this.#list = make('ol', { id: 'edit-list', 'aria-label': t('edits.list') });
    this.#empty = make('p', { class: 'about', text: t('edits.empty') });
    this.#tools = MODES.map((name) => make('button', {
      id: name, text: t(`edits.${name}`), title: t(`edits.${name}.title`), 'aria-pressed': 'false', press: () => edits.isEditable && app.modes.toggle(name),
    }));
    const add = (name, made) => make('button', { id: `edit-${name}`, text: t(`edits.${name}`), title: t(`edits.${name}.title`), press: ({ timeStamp }) => edits.add(made(), timeStamp) });
    this.#adders = [
      add('plane', () => [planeEdit(app.viewer.box.center, sight(app.viewer.camera))]),
      add('box', () => [boxEdit()]),
      add('clip', () => editsOfClip(app.viewer.view.clip)),
    ];
    this.#undo = make('button', { id: 'edit-undo', text: t('edits.undo'), title: t('edits.undo.title'), press: ({ timeStamp }) => app.transfer.undo(timeStamp) });
    this.#redo = make('button', { id: 'edit-redo', text: t('edits.redo'), title: t('edits.redo.title'), press: ({ timeStamp }) => app.transfer.redo(timeStamp) });
    this.#reset = make('button', { id: 'edit-reset', text: t('edits.reset'), title: t('edits.reset.title'), press: ({ timeStamp }) => edits.reset(timeStamp) });
    this.#details = { plane: new PlaneDetails(app, edits), box: new BoxDetails(app, edits), sphere: new SphereDetails(app, edits), part: new PartDetails(app, edits) };
    this.#body.append(
      make('div', { class: 'buttons', role: 'group', 'aria-label': t('edits.point') }, ...this.#tools),
      make('div', { class: 'buttons', role: 'group', 'aria-label': t('edits.cut') }, ...this.#adders),
      this.#list, this.#empty, make('div', { class: 'buttons' }, this.#undo, this.#redo, this.#reset));
  }

  get fold() { return this.#body.closest('details'); }

  #row(index) {
    const edits = this.#edits;
    const { type } = edits.list[index];
    const label = t('edits.remove', { number: index + 1 });
    const remove = make('button', { class: 'small', 'aria-label': label, title: label }, icon('trash-2'));
    remove.addEventListener('click', ({ timeStamp }) => {
      edits.remove(index, timeStamp);
      this.show();
      (this.#list.querySelector('.layer-pick[aria-expanded="true"]') ?? this.#tools[0]).focus();
    });
    return make('li', { 'data-type': type, 'data-index': index }, make('div', { class: 'row' },
      make('button', { class: 'layer-pick', press: () => edits.select(edits.selected === index ? -1 : index) },
        make('span', { class: 'badge', text: index + 1 }), make('span', { class: 'layer-name', text: t(`edits.name.${type}`) }), make('span', { class: 'layer-value' })),
      remove));
  }

  show() {
    const edits = this.#edits;
    const { list, isEditable } = edits;
    const { transfer, viewer, modes } = this.#app;
    this.#body.toggleAttribute('inert', !isEditable);
    const key = JSON.stringify(list.map(({ type }) => type));
    if (key !== this.#key) {
      this.#key = key;
      for (const { root } of Object.values(this.#details)) root.remove();
      this.#list.replaceChildren(...list.map((_, i) => this.#row(i)));
    }
    list.forEach((edit, i) => this.#showRow(this.#list.children[i], edit, i));
    for (const button of this.#tools) setAttribute(button, 'aria-pressed', modes.current === button.id);
    for (const button of [...this.#tools, ...this.#adders]) button.disabled = !canAddEdits(list);
    const cuts = editsOfClip(viewer.view?.clip);
    this.#adders[2].disabled = cuts.length === 0 || !canAddEdits(list, cuts.length);
    this.#undo.disabled = !transfer.canUndo;
    this.#redo.disabled = !transfer.canRedo;
    this.#reset.disabled = list.length === 0;
    this.#empty.hidden = list.length > 0;
  }

  #showRow(item, edit, index) {
    const isSelected = index === this.#edits.selected;
    const details = this.#details[edit.type];
    setAttribute(item.querySelector('.layer-pick'), 'aria-expanded', isSelected);
    setText(item.querySelector('.layer-value'), details.describe(edit));
    if (isSelected) {
      if (details.root.parentElement !== item) item.append(details.root);
      details.show(index);
    } else if (details.root.parentElement === item) {
      details.root.remove();
    }
  }
}

const keepText = (type, keep = 'outside') => t(`edits.keep.${type === 'part' ? 'part' : 'shape'}.${keep}`);
const removes = ({ type, keep }) => t('edits.removes', { what: keepText(type, keep) });

/** The controls of one edit; a drag of a slider is one step for undo. */
class Details {
  index = -1;
  #exact = new Map(); // the values of fields, which show them rounded

  constructor(app, edits, type) {
    this.app = app;
    this.edits = edits;
    this.keep = make('select', { 'aria-label': t('edits.keep') }, ...['outside', 'inside'].map((name) => new Option(keepText(type, name), name)));
    this.keep.addEventListener('change', ({ timeStamp }) => this.set({ keep: this.keep.value }, timeStamp));
    this.root = make('div', { class: 'layer-details' });
    this.root.classList.add('edit-details');
    this.root.addEventListener('pointerdown', ({ target }) => target.type === 'range' && edits.begin());
    this.root.addEventListener('keydown', ({ target, repeat }) => target.type === 'range' && !repeat && edits.begin());
    this.root.addEventListener('change', () => edits.end());
  }

  get edit() { return this.edits.list[this.index]; }

  set(change, time) { this.edits.change(this.index, change, time); }

  /** Shows a number in a field, rounded, unless a person types in it. */
  put(input, value, shown = this.app.clip.round(value)) {
    this.#exact.set(input, value);
    if (document.activeElement !== input || input.valueAsNumber === value) input.value = String(shown);
  }

  /** Number fields that take(values, time) together. */
  numbers(labels, take) {
    const inputs = labels.map((label) => make('input', { type: 'number', step: 'any', 'aria-label': label }));
    for (const input of inputs) {
      input.addEventListener('change', ({ timeStamp }) => {
        const values = inputs.map((other) => (other === input ? other.valueAsNumber : this.#exact.get(other)));
        if (values.every(Number.isFinite)) take(values, timeStamp);
        this.show(this.index);
      });
    }
    return inputs;
  }

  keepRow() { return make('div', { class: 'row' }, make('span', { text: t('edits.keep') }), this.keep); }

  show(index) {
    this.index = index;
    this.keep.value = this.edit.keep ?? 'outside';
  }
}

class PlaneDetails extends Details {
  #depth; #position;

  constructor(app, edits) {
    super(app, edits, 'plane');
    this.#depth = make('input', { id: 'edit-depth', type: 'range', min: 0, max: 1, step: 0.005, 'aria-label': t('clip.depth') });
    this.#position = this.numbers([t('clip.position')], ([position], time) => this.set({ offset: app.clip.distanceAlong(this.edit.normal, position) * Math.hypot(...this.edit.normal) }, time));
    this.#depth.addEventListener('input', ({ timeStamp }) => this.set({ offset: planeAt(app.viewer.box, this.edit.normal, this.#depth.valueAsNumber).offset }, timeStamp));
    const flip = make('button', { id: 'edit-flip', text: t('edits.flip'), title: t('edits.flip.title'), press: ({ timeStamp }) => this.set(flipPlane(this.edit), timeStamp) });
    this.root.append(make('div', { class: 'row' }, make('span', { text: t('clip.depth') }), this.#depth, ...this.#position), make('div', { class: 'buttons' }, flip));
  }

  describe(plane) { return this.app.clip.positionText(plane.normal, positionOf(plane)); }

  show(index) {
    super.show(index);
    const depth = this.app.viewer.box ? depthOf(this.app.viewer.box, this.edit) : 0;
    this.#depth.value = String(depth);
    this.#depth.setAttribute('aria-valuetext', t('clip.removed', { percent: Math.round(depth * 100) }));
    const { value } = this.app.clip.positionAlong(this.edit.normal, positionOf(this.edit));
    this.put(this.#position[0], value, value);
  }
}

class BoxDetails extends Details {
  #rows;

  constructor(app, edits) {
    super(app, edits, 'box');
    const { clip } = app;
    const own = () => this.edit.box;
    const set = (box, time) => this.set({ box }, time);
    this.#rows = new BoxRows({
      get box() { return own(); },
      setBox: set, fraction: (...of) => clip.fraction(...of), coordinate: (...of) => clip.coordinate(...of), axisNames: (axis) => clip.axisNames(axis),
      withUnit: (...of) => clip.withUnit(...of), unitAlong: (axis) => clip.unitAlong(axis),
    }, { id: 'edit-box-rows', class: 'box-rows' });
    this.root.append(this.keepRow(), this.#rows.root);
  }

  describe(edit) { return removes(edit); }

  show(index) {
    super.show(index);
    this.#rows.show();
  }
}

class SphereDetails extends Details {
  #radius; #number; #center;

  constructor(app, edits) {
    super(app, edits, 'sphere');
    const set = (radius, time) => radius > 0 && this.set({ radius: digits(radius) }, time);
    this.#radius = make('input', { id: 'edit-radius', type: 'range', min: 0.01, max: 1, step: 0.005, 'aria-label': t('edits.radius') });
    this.#radius.addEventListener('input', ({ timeStamp }) => set(radiusScale.at(this.#radius.valueAsNumber) * app.clip.extent, timeStamp));
    this.#number = this.numbers([t('edits.radius')], ([radius], time) => set(radius, time));
    this.#center = this.numbers(['x', 'y', 'z'].map((name) => t('edits.center.part', { name })), (center, time) => this.set({ center }, time));
    this.root.append(this.keepRow(), make('div', { class: 'row' }, make('span', { text: t('edits.radius') }), this.#radius, ...this.#number),
      make('div', { class: 'row', role: 'group', 'aria-label': t('edits.center') }, make('span', { text: t('edits.center') }), make('span', { class: 'range' }, ...this.#center)));
  }

  describe(edit) { return removes(edit); }

  show(index) {
    super.show(index);
    const { radius, center } = this.edit;
    this.#radius.value = String(radiusScale.of(Math.min(RADIUS_MAX, radius / this.app.clip.extent)));
    this.#radius.setAttribute('aria-valuetext', this.app.clip.withUnit(this.app.clip.round(radius)));
    this.put(this.#number[0], radius);
    this.#center.forEach((input, i) => this.put(input, center[i]));
  }
}

class PartDetails extends Details {
  #range; #place;

  constructor(app, edits) {
    super(app, edits, 'part');
    this.#range = this.numbers([t('edits.low'), t('edits.high')], (range, time) => this.set({ range: [Math.min(...range), Math.max(...range)] }, time));
    this.#place = make('p', { class: 'about' });
    this.root.append(this.keepRow(), make('div', { class: 'row', role: 'group', 'aria-label': t('edits.range'), title: t('edits.range.title') },
      make('span', { text: t('edits.range') }), make('span', { class: 'range' }, this.#range[0], '–', this.#range[1])), this.#place);
  }

  describe(edit) { return removes(edit); }

  show(index) {
    super.show(index);
    const { range, point } = this.edit;
    this.#range.forEach((input, i) => this.put(input, range[i], this.app.layers.round(range[i])));
    setText(this.#place, t('edits.place', placeOf(this.app.viewer.volume, point, this.app.clip.extent)).trim());
  }
}
