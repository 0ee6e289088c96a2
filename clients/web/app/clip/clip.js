// SPDX-License-Identifier: Apache-2.0
// The section "Clip": the box in coordinates of the volume, and a list of planes. The handles in the picture are in clip_handles.js.
import { depthOf, flipPlane, moveFace, planeAt, planeFrom, positionOf } from '../../core/clip.js';
import { length, scale } from '../../core/vector.js';
import { t } from '../../core/text.js';
import { installClipHandles } from './clip_handles.js';
import { ClipState } from './clip_state.js';
import { byId, icon, make, setText } from '../controls/dom.js';

const AXES = ['x', 'y', 'z'];

export function install(app) {
  const { viewer, panel, toolbar } = app;
  const state = new ClipState(app);
  app.clip = state;
  const body = panel.section({ id: 'clip' });
  const handles = switchRow('clip-handles-on', t('clip.handles'), t('clip.handles.title'));
  const box = new BoxRows(state, { id: 'clip-box', class: 'box-rows', 'data-pointer': '/clip/box' });
  const planes = new PlaneList(state);
  const reset = make('button', { id: 'clip-reset', text: t('clip.reset'), title: t('clip.reset.title'), press: ({ timeStamp }) => state.reset(timeStamp) });
  body.append(handles.row, box.root, planes.root, make('div', { class: 'buttons' }, reset));

  const toggle = (isOn = !state.hasHandles) => {
    if (isOn && !viewer.mayChange()) return;
    state.hasHandles = isOn;
    if (isOn && byId('panel').dataset.open === 'true') byId('clip').open = true;
  };
  handles.input.addEventListener('change', () => toggle(handles.input.checked));
  const button = toolbar.button({ id: 'clip-tool', press: () => toggle() });
  installClipHandles(app, state, () => toggle(false));

  state.on('change', () => {
    body.toggleAttribute('inert', !viewer.canControl);
    button.setAttribute('aria-pressed', String(state.hasHandles));
    handles.input.checked = state.hasHandles;
    box.show();
    planes.show();
  });
}

function switchRow(id, label, title) {
  const input = make('input', { id, type: 'checkbox', role: 'switch' });
  return { row: make('div', { class: 'row', title }, make('label', { for: id, text: label }), input), input };
}

/** Two numbers and two sliders per axis. state: see ClipState. */
export class BoxRows {
  #state;
  #rows;

  constructor(state, attributes) {
    this.#state = state;
    this.#rows = [0, 1, 2].map((axis) => this.#row(axis));
    this.root = make('div', attributes, ...this.#rows.map(({ row }) => row));
  }

  #row(axis) {
    const name = make('span', { class: 'name' });
    const unit = make('span', { class: 'unit' });
    const [numbers, sliders] = ['number', 'range'].map((type) => [0, 1].map((end) => make('input', {
      type, 'data-axis': axis, 'data-end': end, ...(type === 'range' ? { min: 0, max: 1, step: 0.01 } : { step: 'any' }),
    })));
    for (const end of [0, 1]) {
      const move = (fraction, time) => this.#state.setBox(moveFace(this.#state.box, this.#cornerAt(axis, end), axis, fraction), time);
      sliders[end].addEventListener('input', ({ timeStamp }) => move(this.#along(axis, sliders[end].valueAsNumber), timeStamp));
      numbers[end].addEventListener('change', ({ timeStamp }) => {
        const value = numbers[end].valueAsNumber;
        if (Number.isFinite(value)) move(this.#state.fraction(axis, value), timeStamp);
        this.show();
      });
    }
    const row = make('div', { class: 'clip-axis', role: 'group' },
      make('div', { class: 'row' }, name, make('span', { class: 'range' }, numbers[0], '–', numbers[1], unit)),
      make('span', { class: 'pair' }, ...sliders));
    return { row, name, unit, numbers, sliders, axis };
  }

  /** True if the coordinates of the world descend along one of the volume's axes. Fields and sliders show rising ranges all the same. */
  #isDown(axis) { return this.#state.coordinate(axis, 0) > this.#state.coordinate(axis, 1); }
  /** The corner of the box at the lower (0) or upper (1) end of the range. */
  #cornerAt(axis, end) { return this.#isDown(axis) ? 1 - end : end; }
  /** The fraction of the volume at a place of a slider, and the reverse. */
  #along(axis, fraction) { return this.#isDown(axis) ? 1 - fraction : fraction; }

  show() {
    const { box } = this.#state;
    for (const { row, name, unit, numbers, sliders, axis } of this.#rows) {
      const names = this.#state.axisNames(axis);
      row.setAttribute('aria-label', names.label);
      row.title = t('clip.axis.title', { name: names.label });
      setText(name, names.name);
      setText(unit, this.#state.unitAlong(axis));
      for (const end of [0, 1]) {
        const corner = this.#cornerAt(axis, end);
        const value = this.#state.coordinate(axis, box[corner][axis]);
        const place = this.#along(axis, box[corner][axis]);
        const label = t('clip.end', { name: names.label, end: corner === 0 ? names.low : names.high });
        for (const input of [numbers[end], sliders[end]]) input.setAttribute('aria-label', label);
        if (document.activeElement !== numbers[end]) numbers[end].value = String(value);
        sliders[end].value = place;
        sliders[end].setAttribute('aria-valuetext', this.#state.withUnit(value, axis));
        sliders[end].parentElement.style.setProperty(end === 0 ? '--low' : '--high', place);
      }
    }
  }
}

/** The list of planes, the details of the selected one, and the buttons that add planes. */
class PlaneList {
  #state; #list; #details; #presets; #sight;
  #count = -1;

  constructor(state) {
    this.#state = state;
    this.#list = make('ol', { id: 'planes', 'aria-label': t('clip.planes') });
    this.#details = new PlaneDetails(state);
    this.#presets = [0, 1, 2, null].map((axis) => make('button', {
      'data-across': axis ?? 'view', press: ({ timeStamp }) => state.addAcross(axis, timeStamp),
    }));
    this.#sight = make('button', {
      id: 'plane-sight', text: t('clip.sight'), title: t('clip.sight.title'), press: ({ timeStamp }) => state.faceViewer(timeStamp),
    });
    this.root = make('div', { id: 'clip-planes', 'data-pointer': '/clip/planes' },
      make('h3', { text: t('clip.planes') }), this.#list,
      make('p', { class: 'about', text: t('clip.add') }),
      make('div', { id: 'plane-add', class: 'buttons', role: 'group', 'aria-label': t('clip.add') }, ...this.#presets),
      make('div', { class: 'buttons' }, this.#sight));
  }

  #item(index) {
    const state = this.#state;
    const name = t('clip.plane', { number: index + 1 });
    const small = (sign, label, press) => make('button', { class: 'small', 'aria-label': label, title: label, press }, sign);
    const flip = small(icon('flip-horizontal-2'), t('clip.flip', { name }), ({ timeStamp }) => state.setPlane(index, flipPlane(state.entries[index].plane), timeStamp));
    const remove = small(icon('trash-2'), t('clip.remove', { name }), ({ timeStamp }) => {
      state.removePlane(index, timeStamp);
      (this.#list.querySelector('.plane-pick[aria-pressed="true"]') ?? this.#sight).focus();
    });
    const isOn = make('input', { type: 'checkbox', role: 'switch', 'aria-label': t('clip.on', { name }) });
    isOn.addEventListener('change', ({ timeStamp }) => state.switchPlane(index, isOn.checked, timeStamp));
    return make('li', {},
      make('div', { class: 'row' }, make('button', { class: 'plane-pick', press: () => state.select(index) },
        make('span', { class: 'badge', text: index + 1 }), make('span', { class: 'position' })), flip, remove, isOn));
  }

  show() {
    const { entries, selected } = this.#state;
    if (entries.length !== this.#count) {
      this.#count = entries.length;
      this.#list.replaceChildren(...entries.map((entry, i) => this.#item(i)));
    }
    entries.forEach(({ plane, isOn }, i) => {
      const item = this.#list.children[i];
      const pick = item.querySelector('.plane-pick');
      pick.setAttribute('aria-pressed', String(i === selected));
      pick.setAttribute('aria-label', t('clip.plane', { number: i + 1 }));
      setText(item.querySelector('.position'), this.#describe(plane));
      item.querySelector('input').checked = isOn;
      item.toggleAttribute('data-off', !isOn);
      if (i === selected && this.#details.root.parentElement !== item) item.append(this.#details.root);
    });
    if (entries[selected]) this.#details.show(entries[selected].plane);
    for (const [axis, button] of this.#presets.entries()) {
      setText(button, axis === 3 ? t('clip.across.view') : this.#state.acrossName(axis));
      button.disabled = this.#state.isFull;
    }
  }

  #describe(plane) {
    const normal = scale(plane.normal, 1 / length(plane.normal));
    const axis = normal.findIndex((part) => Math.abs(part) > 1 - 1e-6);
    const sign = axis < 0 ? 1 : Math.sign(normal[axis]);
    const place = this.#state.positionText(scale(normal, sign), sign * positionOf(plane));
    return axis < 0 ? t('clip.oblique', { place }) : t('clip.at', { name: AXES[axis], place });
  }
}

/** Position, depth and normal of the selected plane. */
class PlaneDetails {
  #state; #position; #unit; #depth; #normal;

  constructor(state) {
    this.#state = state;
    this.#position = make('input', { id: 'plane-position', type: 'number', step: 'any' });
    this.#unit = make('span', { class: 'unit' });
    this.#depth = make('input', { id: 'plane-depth', type: 'range', min: 0, max: 1, step: 0.005, 'aria-label': t('clip.depth') });
    this.#normal = AXES.map((name) => make('input', { type: 'number', step: 'any', 'aria-label': t('clip.normal.part', { name }) }));
    const current = () => state.entries[state.selected].plane;
    const set = (plane, time) => plane && state.setPlane(state.selected, plane, time);
    this.#depth.addEventListener('input', ({ timeStamp }) => set(planeAt(state.volumeBox, current().normal, this.#depth.valueAsNumber), timeStamp));
    this.#position.addEventListener('change', ({ timeStamp }) => {
      set(planeFrom(current().normal, state.distanceAlong(current().normal, this.#position.valueAsNumber)), timeStamp);
      this.show(current());
    });
    for (const input of this.#normal) {
      input.addEventListener('change', ({ timeStamp }) => {
        const normal = this.#normal.map((part) => part.valueAsNumber);
        const turned = planeFrom(normal, 0);
        const middle = state.anchor(current(), state.selected);
        if (turned) set({ ...turned, offset: turned.normal.reduce((sum, part, i) => sum + part * middle[i], 0) }, timeStamp);
        this.show(current());
      });
    }
    this.root = make('div', { class: 'plane-details' },
      make('div', { class: 'row', title: t('clip.position.title') }, make('label', { for: 'plane-position', text: t('clip.position') }),
        make('span', { class: 'number' }, this.#position, this.#unit)),
      make('div', { class: 'row', title: t('clip.depth.title') }, this.#depth),
      make('div', { class: 'row', title: t('clip.normal.title'), role: 'group', 'aria-label': t('clip.normal') },
        make('span', { text: t('clip.normal') }), make('span', { class: 'range' }, ...this.#normal)));
  }

  show(plane) {
    const set = (input, value) => {
      if (document.activeElement !== input) input.value = String(value);
    };
    const { value, unit } = this.#state.positionAlong(plane.normal, positionOf(plane));
    set(this.#position, value);
    setText(this.#unit, unit);
    const depth = this.#state.volumeBox ? depthOf(this.#state.volumeBox, plane) : 0;
    this.#depth.value = depth;
    this.#depth.setAttribute('aria-valuetext', t('clip.removed', { percent: Math.round(depth * 100) }));
    const size = length(plane.normal);
    this.#normal.forEach((input, i) => set(input, Number((plane.normal[i] / size).toFixed(3)) + 0));
  }
}
