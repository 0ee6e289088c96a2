// SPDX-License-Identifier: Apache-2.0
// One pane with a slice: its picture, an SVG above it, and pointer, wheel and keys on it. slices.js says what it shows.
//
// For tools: toWorld(x, y) and toPane(world) convert between CSS px of the pane and the world; `plane` is {origin, right, down, normal};
// layer(draw) adds lines above the picture. A mode (modes.js) with `panes: {down, move, up, hover, double, cancel, key, cursor}` gets the
// pointer of all panes; its functions are called as (at, event, pane).
import { OPACITY, windowOf } from '../../core/channels.js';
import { colorOfStops } from '../../core/color_maps.js';
import { numberText } from '../../core/lengths.js';
import { paintChannels, paintSlice, shadesOf, valueAt } from '../../core/slice_image.js';
import { SliceLoader } from '../../core/slice_loader.js';
import { directionName, fitPane, imageTransform, mainAxis, paneOf, pixelAt, reachAlong, sliceQuery } from '../../core/slices.js';
import { t } from '../../core/text.js';
import { dot, scale, add } from '../../core/vector.js';
import { nextFrame } from '../frames/animation.js';
import { make, setText, svg } from '../controls/dom.js';

const ZOOM_STEP = 1.15;
const WHEEL_STEP = 0.0015;
const NOTCH = 40; // px of wheel per slice
const EDGES = ['left', 'right', 'top', 'bottom'];

/** The light that a channel adds to a slice: its colours, as bright as its points are opaque. */
function lightOf({ points, slice }) {
  const [low, high] = windowOf(points);
  const stops = points.map(({ value, color, opacity }) => [value, color.map((part) => part * Math.min(1, opacity / OPACITY))]);
  const width = Math.max(high - low, Number.MIN_VALUE);
  return { values: slice.values, window: { center: (low + high) / 2, width }, shades: shadesOf((at) => colorOfStops(stops, low + at * width)) };
}

const keyOfChannel = (key, id) => `${key}&channel=${id}`;

export class Pane {
  #slices; #modes; #canvas; #context; #svg; #lines; #letters; #read; #slider; #number; #total; #place; #problem;
  #layers = new Set();
  #view = null; // {center, zoom}; null = fit
  #size = [1, 1];
  #own; // the source of the volume, see #makeSource()
  #channels = new Map(); // by id: the sources of the channels beside it
  #painted = null; // {canvas, slice, key}
  #load;
  #isPlanned = false;
  #hovered = null;
  #step = 1;
  plane = null;

  /** slices: the state of slices.js; body: the element to fill. */
  constructor(id, body, { slices, modes, cache }) {
    this.id = id;
    this.body = body;
    this.#slices = slices;
    this.#modes = modes;
    this.#canvas = make('canvas', { class: 'slice', tabindex: '0', role: 'img' });
    this.#context = this.#canvas.getContext('2d', { alpha: false });
    this.#svg = svg('svg', { class: 'slice-lines', 'aria-hidden': 'true' });
    this.#lines = svg('g');
    this.#svg.append(this.#lines);
    this.#letters = Object.fromEntries(EDGES.map((edge) => [edge, make('span', { class: 'slice-letter', 'data-edge': edge, 'aria-hidden': 'true' })]));
    this.#read = make('output', { class: 'slice-read' });
    this.#slider = make('input', { class: 'slice-slider', type: 'range', min: 0, step: 1 });
    this.#number = make('input', { type: 'number', min: 1, step: 1 });
    this.#total = make('span', { class: 'slice-total' });
    this.#place = make('span', { class: 'slice-place' });
    this.#problem = make('p', { class: 'slice-problem', role: 'alert', hidden: true });
    const foot = make('div', { class: 'slice-foot' }, this.#number, this.#total, this.#place);
    body.append(this.#canvas, this.#svg, ...Object.values(this.#letters), this.#read, foot, this.#slider, this.#problem);
    body.dataset.kind = id;
    this.#load = { cache, load: (query, signal) => slices.load(query, signal) };
    this.#own = this.#makeSource();
    new ResizeObserver(() => this.#measure()).observe(body);
    this.#listen();
  }

  get size() { return this.#size; }
  get isShown() { return !this.body.parentElement.hidden; }
  get slice() { return this.#own.slice; }
  get element() { return this.#canvas; }
  /** {center, zoom}: the world point in the middle, and px per world unit. */
  get view() { return this.#view ?? fitPane(this.#slices.grid, this.plane, this.#size); }
  get #map() { return paneOf(this.plane, { ...this.view, size: this.#size }); }

  toPane(world) { return this.#map.toPane(world); }
  toWorld(x, y) { return this.#map.toWorld(x, y); }

  /** The value at a world point in the slice that is shown; null outside of it. */
  valueAt(world) {
    const pixel = this.slice && pixelAt(this.slice.meta, world);
    const value = pixel ? valueAt(this.slice, pixel) : NaN;
    return Number.isNaN(value) ? null : value;
  }

  /** draw({group, pane, toPane, plane, zoom, width, height}) fills the layer's <g> after each change. Returns {group, update(), remove()}. */
  layer(draw) {
    const layer = { group: svg('g'), draw };
    this.#layers.add(layer);
    this.#svg.append(layer.group);
    this.update();
    return { group: layer.group, update: () => this.update(), remove: () => { this.#layers.delete(layer); layer.group.remove(); } };
  }

  /** Fits the volume into the pane. */
  fit() {
    this.#view = null;
    this.update();
  }

  zoom(factor, at = this.#size.map((side) => side / 2)) {
    if (!this.plane) return;
    const { center, zoom } = this.view;
    const fitted = fitPane(this.#slices.grid, this.plane, this.#size).zoom;
    const next = Math.min(Math.max(zoom * factor, fitted / 4), fitted * 200);
    const fixed = this.toWorld(...at);
    this.#view = { center, zoom: next };
    const moved = this.toWorld(...at);
    this.#view.center = center.map((part, i) => part + fixed[i] - moved[i]);
    this.update();
  }

  pan(dx, dy) {
    if (!this.plane) return;
    const { center, zoom } = this.view;
    this.#view = { zoom, center: add(center, add(scale(this.plane.right, -dx / zoom), scale(this.plane.down, -dy / zoom))) };
    this.update();
  }

  /** Goes `steps` slices on, towards the viewer if positive. */
  scroll(steps, time) {
    if (!this.plane) return;
    this.#step = Math.sign(steps) || 1;
    this.#slices.scroll(this.plane, steps, time);
  }

  /** Draws again at the next animation frame. */
  update() {
    this.body.dataset.state = 'waiting';
    if (this.#isPlanned) return;
    this.#isPlanned = true;
    nextFrame(() => {
      this.#isPlanned = false;
      if (this.isShown && this.#slices.grid && this.#slices.isOfView) this.#show();
    });
  }

  /** Loads nothing until the next update(), which asks again for what is not shown yet. */
  stop() {
    for (const source of this.#sources) {
      source.loader.stop();
      source.key = source.shownKey;
    }
  }

  /** Forgets the picture, because there is another volume. */
  reset() {
    for (const { loader } of this.#sources) loader.stop();
    this.#channels.clear();
    this.#own = this.#makeSource();
    this.#painted = this.#view = null;
    this.plane = null; // the next volume may have no grid
    this.#tellProblem();
    this.update();
  }

  #measure() {
    const box = this.body.getBoundingClientRect();
    if (box.width < 1 || box.height < 1) return;
    this.#size = [box.width, box.height];
    const ratio = window.devicePixelRatio || 1;
    [this.#canvas.width, this.#canvas.height] = this.#size.map((side) => Math.round(side * ratio));
    this.#svg.setAttribute('viewBox', `0 0 ${box.width} ${box.height}`);
    this.update();
  }

  #show() {
    this.plane = this.#slices.planeOf(this.id);
    this.#want();
    this.#paint();
    this.#drawLines();
    this.#label();
    if (!this.#isPlanned && this.#sources.every(({ key, shownKey }) => key === shownKey)) this.body.dataset.state = 'newest';
  }

  #request(plane) {
    const query = { ...sliceQuery(this.#slices.grid, plane, { ...this.view, size: this.#size }), ...this.#slices.stepQuery };
    return { query, key: `${this.#slices.volumeKey}?${new URLSearchParams(query)}` };
  }

  /** Loads slices of one volume. Holds the slice on the screen and its key, the key of the newest request, and the reason if this request failed. */
  #makeSource() {
    const source = { slice: null, shownKey: null, key: '', error: null, loader: null };
    const take = (change) => {
      Object.assign(source, change);
      this.#tellProblem();
    };
    source.loader = new SliceLoader({
      ...this.#load,
      show: (slice, shownKey) => {
        take({ slice, shownKey, error: null });
        this.update();
      },
      fail: (error) => take({ key: '', error }), // the next change asks again
    });
    return source;
  }

  get #sources() { return [this.#own, ...this.#channels.values()]; }

  /** Wants the slices of the channels beside the volume. */
  #wantChannels(channels) {
    for (const [id, { loader }] of this.#channels) {
      if (channels.some((channel) => channel.id === id)) continue;
      loader.stop();
      this.#channels.delete(id);
      this.#tellProblem();
    }
    for (const { id } of channels) {
      if (!id) continue;
      if (!this.#channels.has(id)) this.#channels.set(id, this.#makeSource());
      const channel = this.#channels.get(id);
      const { query, key } = this.#request(this.plane);
      const wanted = { query: { ...query, channel: id }, key: keyOfChannel(key, id) };
      if (wanted.key === channel.key) continue;
      channel.key = wanted.key;
      channel.loader.want(wanted);
    }
  }

  /** The slice of a channel ('' = the volume) at the place of the slice that is shown; null while it is on its way. */
  #sliceOf(id) {
    if (!id) return this.slice;
    const channel = this.#channels.get(id);
    return channel?.shownKey === keyOfChannel(this.#own.shownKey, id) ? channel.slice : null;
  }

  #want() {
    this.#wantChannels(this.#slices.channels);
    const wanted = this.#request(this.plane);
    if (wanted.key === this.#own.key) return;
    this.#own.key = wanted.key;
    const { grid } = this.#slices;
    const { axis, origin } = this.plane;
    const ahead = [];
    if (axis !== null) {
      const index = grid.index(axis, origin);
      const towards = dot(grid.axes[axis], this.plane.normal) < 0 ? -this.#step : this.#step;
      for (const next of [index + towards, index + 2 * towards, index - towards]) {
        if (next >= 0 && next < grid.count(axis)) ahead.push(this.#request({ ...this.plane, origin: grid.moveTo(axis, origin, next) }));
      }
    }
    this.#own.loader.want(wanted, ahead);
  }

  #tellProblem() {
    const reason = this.#sources.find(({ error }) => error)?.error.message;
    if (reason !== undefined) setText(this.#problem, t('slices.failed', { reason }));
    this.#problem.hidden = reason === undefined;
  }

  #paint() {
    const context = this.#context;
    const { width, height } = this.#canvas;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = '#000';
    context.fillRect(0, 0, width, height);
    if (!this.slice) return;
    const { meta, values } = this.slice;
    const known = this.#painted;
    const channels = this.#slices.channels.map(({ id, points }) => ({ points, slice: this.#sliceOf(id) }));
    const key = channels.length ? JSON.stringify(channels.map(({ points, slice }) => [points, slice?.meta])) : this.#slices.look.key;
    const isMixed = channels.some(({ slice }, i) => slice && known?.channels?.[i] !== slice);
    if (known?.slice !== this.slice || known.key !== key || isMixed) {
      const canvas = known?.canvas ?? new OffscreenCanvas(1, 1);
      if (canvas.width !== meta.shape[0] || canvas.height !== meta.shape[1]) [canvas.width, canvas.height] = meta.shape;
      const image = new ImageData(...meta.shape);
      const pixels = new Uint32Array(image.data.buffer);
      if (channels.length) paintChannels(channels.filter(({ slice }) => String(slice?.meta.shape) === String(meta.shape)).map(lightOf), pixels);
      else paintSlice(values, this.#slices.look.window, pixels, this.#slices.look.shades);
      canvas.getContext('2d').putImageData(image, 0, 0);
      this.#painted = { canvas, slice: this.slice, key, channels: channels.map(({ slice }) => slice) };
    }
    const { zoom } = this.view;
    const ratio = width / this.#size[0];
    const transform = imageTransform(meta, this.plane, this.#map, zoom).map((part) => part * ratio);
    context.setTransform(...transform);
    // A voxel is shown as a square once it is large, because a blur would look like data.
    context.imageSmoothingEnabled = Math.hypot(transform[0], transform[1]) < 12;
    context.imageSmoothingQuality = 'high';
    context.drawImage(this.#painted.canvas, 0, 0);
  }

  #drawLines() {
    const { toPane } = this.#map;
    const [width, height] = this.#size;
    const { zoom } = this.view;
    this.#slices.lines.draw(this, { group: this.#lines, toPane, width, height, zoom });
    for (const { group, draw } of this.#layers) draw({ group, pane: this, toPane, plane: this.plane, zoom, width, height });
  }

  #label() {
    const { anatomy } = this.#slices;
    const { axis, kind, right, down } = this.plane;
    const name = this.#slices.nameOf(this.plane);
    const title = this.body.parentElement.querySelector('.pane-title');
    setText(title, name);
    this.body.parentElement.setAttribute('aria-label', name);
    this.body.dataset.kind = kind;
    const letters = { left: scale(right, -1), right, top: scale(down, -1), bottom: down };
    for (const edge of EDGES) setText(this.#letters[edge], anatomy ? directionName(anatomy, letters[edge]) : '');
    const text = axis === null ? this.#labelOblique(name) : this.#labelOrthogonal(name);
    this.#slider.setAttribute('aria-label', t('slices.slider', { name }));
    this.#canvas.setAttribute('aria-label', t('slices.canvas', { name, place: text }));
    this.#tell();
  }

  /** Slider, number and place of a slice across an axis; returns the place. */
  #labelOrthogonal(name) {
    const { grid, position } = this.#slices;
    const { axis } = this.plane;
    const index = grid.index(axis, position);
    const world = mainAxis(grid.axes[axis]);
    const text = t('slices.place', { axis: 'xyz'[world], place: numberText(this.#slices.along(world, grid.nearest(position)[world])), unit: this.#slices.unitAlong(world) }).trim();
    const all = grid.count(axis);
    this.#setRange({ steps: all - 1, at: index, text: t('slices.slice', { index: index + 1, count: all, place: text }) });
    this.#setNumber({ value: index + 1, min: 1, max: all, step: 1, label: t('slices.number', { name }) });
    setText(this.#total, t('slices.of', { count: all }));
    setText(this.#place, text);
    return text;
  }

  /** The same for an oblique slice: its distance from the origin along the normal. */
  #labelOblique(name) {
    const { grid, unit, position } = this.#slices;
    const { normal } = this.plane;
    const offset = dot(position, normal);
    const { low, high } = reachAlong(grid, normal);
    const text = t('slices.place.oblique', { place: numberText(grid.round(offset)), unit }).trim();
    this.#setRange({ steps: Math.floor((high - low) / grid.smallest), at: Math.round((offset - low) / grid.smallest), text });
    this.#setNumber({ value: grid.round(offset), min: '', max: '', step: 'any', label: t('slices.offset', { name }) });
    setText(this.#total, '');
    setText(this.#place, t('slices.place.normal', { unit }).trim());
    return text;
  }

  #setRange({ steps, at, text }) {
    this.#slider.max = steps;
    this.#slider.value = at;
    this.#slider.setAttribute('aria-valuetext', text);
  }

  #setNumber({ value, label, ...limits }) {
    Object.assign(this.#number, limits);
    if (document.activeElement !== this.#number) this.#number.value = value;
    this.#number.setAttribute('aria-label', label);
  }

  /** Shows the value under the cursor, or at the crosshair, and where it is. */
  #tell() {
    if (!this.plane) return;
    const world = this.#hovered ? this.toWorld(...this.#hovered) : this.#slices.position;
    // An orthogonal slice has no values between samples, so the place is the nearest sample. All panes then tell the same.
    const isInside = this.valueAt(world) !== null;
    const place = this.plane.axis !== null && isInside ? this.#slices.grid.nearest(world) : world;
    const value = this.valueAt(place);
    if (this.#hovered) this.#slices.tellValue(value === null ? '' : this.#slices.valueText(value));
    setText(this.#read, value === null ? t('slices.outside') : t('slices.value', {
      value: this.#slices.valueText(value), ...this.#slices.placeOf(place) }).trim());
  }

  #listen() {
    const canvas = this.#canvas;
    this.#slider.addEventListener('input', ({ timeStamp }) => {
      if (this.plane) this.#goTo(this.#slider.valueAsNumber, timeStamp);
    });
    this.#number.addEventListener('change', ({ timeStamp }) => {
      if (!this.plane) return;
      const { axis, normal } = this.plane;
      if (axis === null) this.#slices.goAlong(normal, this.#number.valueAsNumber, timeStamp);
      else this.#slices.goTo(axis, this.#number.valueAsNumber - 1, timeStamp);
    });
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('pointermove', (event) => {
      this.#hovered = this.place(event);
      this.#tell();
    });
    canvas.addEventListener('pointerleave', () => {
      this.#hovered = null;
      this.#tell();
      this.#slices.tellValue('');
    });
    let rest = 0;
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      const px = event.deltaY * ([1, 32, 400][event.deltaMode] ?? 1);
      if (event.ctrlKey || event.metaKey) {
        this.zoom(Math.exp(-px * WHEEL_STEP * (event.ctrlKey && Math.abs(px) < 40 ? 6 : 1)), this.place(event));
        return;
      }
      rest += px / (Math.abs(px) >= 100 ? Math.abs(px) : NOTCH); // a notch of a mouse wheel is one slice
      const steps = Math.trunc(rest);
      rest -= steps;
      if (steps) this.scroll(-steps, event.timeStamp);
    }, { passive: false });
    canvas.addEventListener('keydown', (event) => this.#press(event));
    this.#drags();
  }

  /** Goes to a place of the slider. */
  #goTo(index, time) {
    const { grid, position } = this.#slices;
    const { axis, normal } = this.plane;
    if (axis === null) {
      this.#slices.goAlong(normal, reachAlong(grid, normal).low + index * grid.smallest, time);
      return;
    }
    this.#step = index < grid.index(axis, position) ? -1 : 1;
    this.#slices.goTo(axis, index, time);
  }

  #press(event) {
    if (event.altKey || event.ctrlKey || event.metaKey || !this.plane) return;
    if (this.#modes.key(event)) {
      event.preventDefault();
      return;
    }
    const steps = { PageUp: 1, PageDown: -1, ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
    const pans = { ArrowUp: [0, 24], ArrowDown: [0, -24], ArrowLeft: [24, 0], ArrowRight: [-24, 0] }[event.key];
    if (event.shiftKey && pans) this.pan(...pans);
    else if (steps) this.scroll(event.shiftKey ? 10 * steps : steps, event.timeStamp);
    else if (event.key === '+' || event.key === '=') this.zoom(ZOOM_STEP);
    else if (event.key === '-' || event.key === '_') this.zoom(1 / ZOOM_STEP);
    else if (event.key === '0' || event.key === 'f') this.fit();
    else return;
    event.preventDefault();
  }

  /** The place of a pointer event in CSS px of the pane. */
  place({ clientX, clientY }) {
    const box = this.#canvas.getBoundingClientRect();
    return [clientX - box.left, clientY - box.top];
  }

  #drags() {
    const canvas = this.#canvas;
    const pointers = new Map();
    let gesture = null; // tool, cross, pan or pinch
    let last = null;
    let before = null; // the crosshair before the drag
    const pinch = () => {
      const [a, b] = [...pointers.values()];
      return { middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], spread: Math.max(1, Math.hypot(a[0] - b[0], a[1] - b[1])) };
    };
    canvas.addEventListener('pointerdown', (event) => {
      if (!this.plane) return;
      canvas.setPointerCapture(event.pointerId);
      const at = this.place(event);
      pointers.set(event.pointerId, at);
      if (gesture === 'tool') this.#modes.cancel();
      if (pointers.size === 2) {
        if (before) this.#slices.setPosition(before, event.timeStamp); // the first finger has moved the crosshair
        gesture = 'pinch';
        last = pinch();
      } else if (pointers.size > 2 || event.button !== 0 || event.shiftKey) {
        gesture = 'pan';
        last = at;
      } else if (this.#modes.down(at, event, this)) {
        gesture = 'tool';
      } else {
        gesture = this.#slices.lines.grab(this, at, event.pointerType) ?? 'cross';
        before = gesture === 'cross' ? this.#slices.position : null;
        this.#slices.lines.drag(this, gesture, at, event.timeStamp);
      }
    });
    canvas.addEventListener('pointermove', (event) => {
      if (!this.plane) return;
      const at = this.place(event);
      if (!pointers.has(event.pointerId)) {
        this.#modes.hover(at, event, this);
        canvas.style.cursor = this.#modes.cursorIn(this) || this.#slices.lines.cursor(this, at, event.pointerType);
        return;
      }
      pointers.set(event.pointerId, at);
      if (gesture === 'tool') {
        this.#modes.move(at, event, this);
      } else if (gesture === 'pan') {
        this.pan(at[0] - last[0], at[1] - last[1]);
        last = at;
      } else if (gesture === 'pinch') {
        const now = pinch();
        this.zoom(now.spread / last.spread, last.middle);
        this.pan(now.middle[0] - last.middle[0], now.middle[1] - last.middle[1]);
        last = now;
      } else if (gesture) {
        this.#slices.lines.drag(this, gesture, at, event.timeStamp);
      }
    });
    const end = (event) => {
      if (!pointers.delete(event.pointerId)) return;
      if (gesture === 'tool') {
        if (event.type === 'pointerup') this.#modes.up(this.place(event), event, this);
        else this.#modes.cancel();
      }
      gesture = before = null;
      if (pointers.size === 1) {
        gesture = 'pan';
        [last] = pointers.values();
      }
    };
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) canvas.addEventListener(name, end);
    canvas.addEventListener('dblclick', (event) => {
      if (!this.#modes.double(this.place(event), event, this)) this.fit();
    });
  }
}
