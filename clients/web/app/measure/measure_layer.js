// SPDX-License-Identifier: Apache-2.0
// Draws the measurements above the 3-D picture and above the slices: lines, handles of the selected one, and labels. Handles are dragged
// here; the keyboard moves them in the panel (measure_section.js).
import { placeLabels } from '../../core/labels.js';
import { labelLines } from '../../core/measure_text.js';
import { handlesOf, labelBeside, linesOf, moveHandle, placeIn, pointsFromCorners } from '../../core/measures.js';
import { meetPlane, pointAtDepth, ray } from '../../core/project.js';
import { add, cross, dot, scale, subtract } from '../../core/vector.js';
import { svg } from '../controls/dom.js';
import { coversOf, onCovers } from '../shell/margins.js';
import { panesOf, surfaceAt } from './measure_tools.js';

const FONT = '600 12px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';
const LINE_PX = 16;
const PADDING_PX = 6;
const DOT_PX = 5;
const HIT_PX = 14;
const AVOID_PX = 10; // between points of a line that labels avoid
const AVOID_MAX = 40; // points per line
const CURSOR_PX = [4, 13]; // from the middle
const context = new OffscreenCanvas(1, 1).getContext('2d');
context.font = FONT;
const widths = new Map();

/** The width of a text in px. */
function widthOf(text) {
  if (!widths.has(text)) {
    if (widths.size > 500) widths.clear();
    widths.set(text, context.measureText(text).width);
  }
  return widths.get(text);
}

/** The elements of one <g> by key. A drawing removes the elements that it does not use. Labels lie above all lines. */
class Sheet {
  #lines = svg('g'); #texts = svg('g'); #top = svg('g'); #known = new Map(); #used = new Set(); #labels = []; #dots = [];
  /** Of the picture, px. */
  size = [Infinity, Infinity];
  /** What hides parts of the picture (margins.js). */
  covers = [];
  constructor(group) { group.append(this.#lines, this.#texts, this.#top); }

  put(key, tag, attributes, text) {
    let element = this.#known.get(key);
    if (!element) {
      element = svg(tag);
      this.#known.set(key, element);
      const isLabel = tag === 'rect' || tag === 'text';
      (!isLabel ? this.#lines : key.startsWith('top:') ? this.#top : this.#texts).append(element);
    }
    for (const [name, value] of Object.entries(attributes)) if (element.getAttribute(name) !== String(value)) element.setAttribute(name, value);
    if (text !== undefined && element.textContent !== text) element.textContent = text;
    this.#used.add(key);
    return element;
  }

  /** Draws a label once all are known: label = {key, item, lines, wanted, size, anchors}; core/labels.js explains the last three. */
  label(label) {
    this.#labels.push(label);
  }

  /** Labels avoid this line of points. */
  avoid(points) {
    points.forEach((point, i) => {
      const before = points[i - 1] ?? point;
      if (!hasPlace(point) || !hasPlace(before)) return;
      const steps = Math.min(Math.ceil(Math.hypot(point.x - before.x, point.y - before.y) / AVOID_PX), AVOID_MAX) || 1;
      for (let step = 1; step <= steps; step += 1) {
        this.#dots.push({ x: before.x + (point.x - before.x) * step / steps, y: before.y + (point.y - before.y) * step / steps });
      }
    });
  }

  /** Draws the labels, and removes what this drawing did not use. A label without a free place appears above the others if it `isWanted`. */
  end(isWanted) {
    placeLabels(this.#labels, this.size, this.#dots, this.covers).forEach((place, i) => {
      const label = this.#labels[i];
      if (place) this.#putLabel(label, place, '');
      else if (isWanted(label.item)) this.#putLabel(label, { ...label.wanted, leader: null }, 'top:');
    });
    this.#labels = [];
    this.#dots = [];
    for (const [key, element] of this.#known) {
      if (this.#used.has(key)) continue;
      element.remove();
      this.#known.delete(key);
    }
    this.#used.clear();
  }

  #putLabel({ key, item, lines, size: [width, height] }, { x, y, leader }, above) {
    if (leader) {
      const d = pathOf([leader.from, leader.to]);
      this.put(`${key}:leader-halo`, 'path', { class: 'measure-leader-halo', d });
      this.put(`${key}:leader`, 'path', { class: 'measure-leader', d, stroke: item.color });
    }
    this.put(`${above}${key}:box`, 'rect', { class: 'measure-box', x: x - width / 2, y: y - height / 2, width, height, rx: 5, stroke: item.color });
    lines.forEach((line, i) => this.put(`${above}${key}:text${i}`, 'text', {
      class: 'measure-label', x, y: y - height / 2 + 2 + LINE_PX * (i + 0.5),
    }, line));
  }
}

const hasPlace = ({ x, y }) => Number.isFinite(x) && Number.isFinite(y) && Math.abs(x) < 1e5 && Math.abs(y) < 1e5;

/** The d of a path through points, with gaps where a point has no place. */
function pathOf(points) {
  let isDown = false;
  return points.map((point) => {
    if (!hasPlace(point)) {
      isDown = false;
      return '';
    }
    const step = `${isDown ? 'L' : 'M'}${point.x.toFixed(1)} ${point.y.toFixed(1)}`;
    isDown = true;
    return step;
  }).join('');
}

/** The middle of the label of `size` px, so that it covers no line. */
function labelPlace(item, points, size) {
  const [width, height] = size;
  if (item.kind === 'marker' || item.kind === 'part') return { x: points[0].x + DOT_PX + 7 + width / 2, y: points[0].y };
  if (item.kind === 'distance' || item.kind === 'profile' || item.kind === 'path') return labelBeside(points[0], points[1], width, height);
  if (item.kind === 'angle') {
    const [a, v, c] = points;
    const towards = { x: a.x + c.x - 2 * v.x, y: a.y + c.y - 2 * v.y };
    const far = Math.hypot(towards.x, towards.y) || 1;
    const [x, y] = [-towards.x / far, -towards.y / far];
    const reach = Math.abs(x) * width / 2 + Math.abs(y) * height / 2 + DOT_PX + 6;
    return { x: v.x + x * reach, y: v.y + y * reach };
  }
  const seen = points.filter(hasPlace);
  const [left, right] = [Math.min(...seen.map((p) => p.x)), Math.max(...seen.map((p) => p.x))];
  const [top, bottom] = [Math.min(...seen.map((p) => p.y)), Math.max(...seen.map((p) => p.y))];
  const reach = height / 2 + 8;
  return { x: (left + right) / 2, y: top - 2 * reach >= 0 ? top - reach : bottom + reach };
}

/** Two points around the middle of a path. */
const middleOf = (path) => [0.45, 0.55].map((share) => path[Math.round(share * (path.length - 1))]);

/** Where a line to a label that lies apart may begin. */
function anchorsOf({ kind }, points) {
  const middle = (a, b) => ({ x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 });
  const named = { distance: () => [middle(points[0], points[1])], profile: () => [middle(points[0], points[1])], path: () => [middle(points[0], points[1])], angle: () => [points[1]] }[kind];
  return (named ? named() : points).filter(hasPlace);
}

/** True if a part of the measurement is in the picture; otherwise its label would point at nothing. */
function isSeen(points, [width, height]) {
  const seen = points.filter(hasPlace);
  const [xs, ys] = [seen.map(({ x }) => x), seen.map(({ y }) => y)];
  return seen.length > 0 && Math.max(...xs) >= 0 && Math.min(...xs) <= width && Math.max(...ys) >= 0 && Math.min(...ys) <= height;
}

function drawLabel(sheet, key, item, points) {
  if (!isSeen(points, sheet.size)) return;
  const lines = labelLines(item);
  const size = [Math.max(...lines.map(widthOf)) + 2 * PADDING_PX, lines.length * LINE_PX + 4];
  const wanted = labelPlace(item, points, size);
  if (!hasPlace(wanted)) return;
  sheet.label({ key, item, lines, wanted, size, anchors: anchorsOf(item, points) });
}

function drawItem(sheet, item, { toScreen, isSelected, handle, isApart, path }) {
  const className = isApart ? 'measure-dim' : '';
  const key = item.id;
  linesOf(item, path).forEach((line, i) => {
    const points = line.map(toScreen);
    const d = pathOf(points);
    if (!isApart) sheet.avoid(points);
    sheet.put(`${key}:halo${i}`, 'path', { class: `measure-halo ${className}`, d });
    sheet.put(`${key}:line${i}`, 'path', { class: `measure-line ${className}`, d, stroke: item.color });
    sheet.put(`${key}:hit${i}`, 'path', { class: 'measure-hit', d, 'data-item': key });
  });
  const handles = handlesOf(item).map(toScreen);
  handles.forEach((point, i) => {
    if (!hasPlace(point) || !(isSelected || item.kind === 'marker' || item.kind === 'part' || (i < 3 && item.kind !== 'rectangle' && item.kind !== 'ellipse'))) return;
    sheet.put(`${key}:dot${i}`, 'circle', {
      class: `measure-dot ${className}`, cx: point.x, cy: point.y, r: isSelected ? DOT_PX : 3.5, fill: item.color,
      'data-focus': isSelected && handle === i,
    });
    sheet.put(`${key}:grip${i}`, 'circle', { class: 'measure-grip', cx: point.x, cy: point.y, r: HIT_PX, 'data-item': key, 'data-handle': i });
  });
  const ends = item.kind === 'rectangle' || item.kind === 'ellipse' ? linesOf(item)[0].map(toScreen) : path ? middleOf(path).map(toScreen) : handles;
  if (isApart) return; // lines alone, or labels would cover the slice
  if (item.kind !== 'distance' || handles.every(hasPlace)) drawLabel(sheet, key, item, ends);
}

/** The measurement that is being drawn, up to the cursor. */
function drawDraft(sheet, draft, pane, toScreen) {
  const points = draft.points.map(toScreen);
  const cursor = draft.cursor?.pane === pane ? { x: draft.cursor.at[0], y: draft.cursor.at[1] } : null;
  const isRegion = draft.kind === 'rectangle' || draft.kind === 'ellipse';
  let line = cursor ? [...points, cursor] : points;
  if (isRegion) {
    const to = cursor && pane ? pane.toWorld(cursor.x, cursor.y) : null;
    const made = to && draft.points[0] && draft.pane === pane ? pointsFromCorners(draft.kind, draft.points[0], to, draft.plane) : null;
    line = made ? linesOf({ kind: draft.kind, points: made })[0].map(toScreen) : [];
  }
  const d = pathOf(line);
  sheet.put('draft:halo', 'path', { class: 'measure-halo', d });
  sheet.put('draft:line', 'path', { class: 'measure-draft-line', d });
  points.forEach((point, i) => hasPlace(point) && sheet.put(`draft:dot${i}`, 'circle', { class: 'measure-draft-dot', cx: point.x, cy: point.y, r: DOT_PX }));
  if (cursor && draft.cursor.isKey) drawCursor(sheet, cursor);
}

/** The cursor that the keys move: a cross that leaves its middle free. */
function drawCursor(sheet, { x, y }) {
  const d = [[-1, 0], [1, 0], [0, -1], [0, 1]].map(([u, v]) => `M${x + u * CURSOR_PX[0]} ${y + v * CURSOR_PX[0]}L${x + u * CURSOR_PX[1]} ${y + v * CURSOR_PX[1]}`).join('');
  sheet.put('cursor:halo', 'path', { class: 'measure-halo', d });
  sheet.put('cursor:line', 'path', { class: 'measure-key-cursor', d });
}

function drawAll(sheet, app, measures, { canvas, toScreen, pane = null, near = 0 }) {
  sheet.covers = measures.items.length > 0 ? coversOf(canvas) : [];
  for (const item of measures.items) {
    if (item.hidden) continue;
    const place = pane ? placeIn(item, pane.plane, near) : 'in';
    if (place === 'apart') continue;
    drawItem(sheet, item, {
      toScreen, isSelected: measures.selected === item, handle: measures.handle,
      isApart: place === 'across', path: measures.pathOf(item),
    });
  }
  if (measures.draft) drawDraft(sheet, measures.draft, pane, toScreen);
  if (measures.probe) {
    const { x, y } = toScreen(measures.probe);
    if (hasPlace({ x, y })) sheet.put('probe', 'circle', { class: 'measure-probe', cx: x, cy: y, r: 4 });
  }
  sheet.end((item) => item === measures.selected || item.id === measures.hovered);
}

/**
 * Selects the measurement that is pressed, shows the label of the measurement under the pointer, and drags handles.
 * move(item, handle, at) returns the world point; settle(world, at) returns the final one.
 */
function listen(group, measures, { place, move, settle }) {
  group.addEventListener('pointerover', ({ target }) => measures.hover(target.dataset.item ?? null));
  group.addEventListener('pointerleave', () => measures.hover(null));
  group.addEventListener('pointerdown', (event) => {
    const { item: id, handle: grip } = event.target.dataset;
    if (!id || event.button !== 0) return;
    event.preventDefault();
    event.stopPropagation();
    measures.select(id);
    if (grip === undefined || !measures.canEdit) return;
    const handle = Number(grip);
    const { target } = event;
    let moved = null;
    const put = (world, isDrag) => {
      const item = measures.selected;
      const points = item && world ? moveHandle(item, handle, world) : null;
      if (points) measures.edit(id, { points }, { isDrag });
    };
    const drag = (next) => {
      const item = measures.selected;
      if (next.pointerId !== event.pointerId || !item) return;
      moved = place(next);
      put(move(handlesOf(item)[handle], item, moved), true);
    };
    const stop = async (last) => {
      if (last.pointerId !== event.pointerId) return;
      target.removeEventListener('pointermove', drag);
      for (const name of ['pointerup', 'pointercancel']) target.removeEventListener(name, stop);
      if (moved && settle && measures.selected) put(await settle(measures.selected, moved), true);
      measures.end();
    };
    target.setPointerCapture(event.pointerId);
    target.addEventListener('pointermove', drag);
    for (const name of ['pointerup', 'pointercancel']) target.addEventListener(name, stop);
  });
}

/** The normal of the plane of a region; null for other kinds. */
function normalOf({ kind, points }) {
  if (kind !== 'rectangle' && kind !== 'ellipse') return null;
  return cross(subtract(points[1], points[0]), subtract(points[2], points[0]));
}

export function installLayers(app, measures) {
  const { overlay, screen } = app;
  let sheet = null;
  const layer = overlay.layer((project, { group, width, height }) => {
    sheet ??= new Sheet(group);
    const share = app.compare?.freeShare ?? 1;
    group.style.clipPath = share < 1 ? `inset(0 ${100 * (1 - share)}% 0 0) view-box` : '';
    sheet.size = [width * share, height];
    drawAll(sheet, app, measures, { canvas: screen.element, toScreen: project });
  });
  layer.group.classList.add('measures');
  const layers = [layer];
  listen(layer.group, measures, {
    place: ({ clientX, clientY }) => {
      const box = screen.element.getBoundingClientRect();
      return [clientX - box.left, clientY - box.top];
    },
    move: (point, item, at) => {
      const normal = normalOf(item);
      return normal ? meetPlane(ray(overlay.rig, at, screen.viewport), item.points[0], normal) : pointAtDepth(overlay.rig, at, screen.viewport, point);
    },
    settle: (item, at) => (normalOf(item) ? null : surfaceAt(app, at)),
  });
  for (const pane of panesOf(app)) layers.push(paneLayer(app, measures, pane));
  const update = () => {
    for (const { group, update: redraw } of layers) {
      group.toggleAttribute('data-passive', !app.modes.isNavigating);
      redraw();
    }
  };
  for (const event of ['change', 'hover']) measures.on(event, update);
  app.modes.on('change', update);
  onCovers(update);
}

function paneLayer(app, measures, pane) {
  let sheet = null;
  const layer = pane.layer(({ group, toPane, width, height }) => {
    sheet ??= new Sheet(group);
    sheet.size = [width, height];
    const near = app.slices.grid ? app.slices.grid.smallest * 0.5 : 0;
    drawAll(sheet, app, measures, { canvas: pane.body, toScreen: toPane, pane, near: near * (1 + 1e-6) });
  });
  layer.group.classList.add('measures');
  listen(layer.group, measures, {
    place: (event) => pane.place(event),
    // A handle that does not lie in the slice keeps its distance from it.
    move: (point, item, at) => {
      const world = pane.toWorld(...at);
      return add(world, scale(pane.plane.normal, dot(subtract(point, world), pane.plane.normal)));
    },
  });
  return layer;
}

