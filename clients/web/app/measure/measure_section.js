// SPDX-License-Identifier: Apache-2.0
// The section "Measure" of the panel: the list, the selected measurement with its points for the keyboard, and export.
import { cameraFromRig } from '../../core/camera.js';
import { lacksUnit, namedValue, outsideText, tableText } from '../../core/measure_text.js';
import { centerOf, handlesOf, moveHandle, shortNumber } from '../../core/measures.js';
import { t } from '../../core/text.js';
import { add, cross, normalize, rotate, scale, subtract } from '../../core/vector.js';
import { icon, make, setText } from '../controls/dom.js';
import { histogramPlot, numbersTable, profilePlot } from './measure_plot.js';
import { panesOf } from './measure_tools.js';

const ICONS = {
  distance: () => icon('ruler'), angle: () => icon('triangle-right'), profile: () => icon('chart-line'), rectangle: () => icon('square-dashed'),
  ellipse: () => icon('circle-dashed'), marker: () => icon('map-pin'), part: () => icon('cuboid'), path: () => icon('spline'),
};
const ARROWS = { ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, -1, 0], ArrowDown: [0, 1, 0], PageUp: [0, 0, 1], PageDown: [0, 0, -1] };
const FINE = 0.1;
const TEXT_BYTES = 200;
const PLOT_SAMPLES = 256;
const PLOT_WAIT_MS = 150;
const SAVE_MS = 10000;

export function installSection(app, measures) {
  new Section(app, measures);
}

/** The text cut to what the daemon takes. */
function fit(text) {
  let cut = text;
  while (new TextEncoder().encode(cut).length > TEXT_BYTES) cut = [...cut].slice(0, -1).join('');
  return cut;
}

class Section {
  #app; #measures; #list; #detail; #empty; #noUnit; #elsewhere; #undo; #redo; #exports; #fields; #plot;
  #shownList = '';
  #shownDetail = '';
  #plotKey = '';
  #plotTimer = null;

  constructor(app, measures) {
    this.#app = app;
    this.#measures = measures;
    const body = app.panel.section({ id: 'measure' });
    this.#empty = make('p', { class: 'about', text: t('measure.empty') });
    this.#list = make('ul', { id: 'measures', 'aria-label': t('measure.list') });
    this.#noUnit = make('p', { class: 'about', id: 'measure-nounit', text: t('measure.nounit'), hidden: true });
    this.#elsewhere = make('p', { class: 'about', hidden: true });
    this.#detail = make('div', { id: 'measure-detail', hidden: true });
    this.#undo = make('button', { id: 'measure-undo', text: t('measure.undo'), title: t('measure.undo.title'), press: () => measures.undo() });
    this.#redo = make('button', { id: 'measure-redo', text: t('measure.redo'), title: t('measure.redo.title'), press: () => measures.redo() });
    this.#exports = ['csv', 'json'].map((format) => make('button', {
      id: `measure-${format}`, text: format.toUpperCase(), title: t(`measure.${format}.title`), press: () => this.#save(format),
    }));
    this.#exports.push(make('button', { id: 'measure-copy', text: t('measure.copy'), title: t('measure.copy.title'), press: () => this.#copy() }));
    body.append(this.#empty, this.#list, this.#noUnit, this.#elsewhere, this.#detail, make('div', { class: 'buttons' }, this.#undo, this.#redo, ...this.#exports));
    measures.on('change', () => this.#show());
    measures.on('name', (id) => {
      app.panel.reveal('measure');
      measures.select(id);
      this.#show();
      setTimeout(() => this.#fields?.text.focus()); // after the press, which focuses the picture
    });
    window.addEventListener('keydown', (event) => this.#undoKey(event), true);
    let { steps } = app.transfer;
    app.transfer.onShow(() => {
      if (app.transfer.steps !== steps) measures.isNewest = false;
      steps = app.transfer.steps;
    });
    this.#show();
  }

  /** Ctrl+Z is of this section while the focus is here, or a measurement is selected and nothing else changed since; a text field keeps its own. */
  #undoKey(event) {
    const key = event.key.toLowerCase();
    if (!(event.ctrlKey || event.metaKey) || event.altKey || (key !== 'z' && key !== 'y')) return;
    const { target } = event;
    const isHere = target.closest?.('#measure') || (this.#measures.selected && this.#measures.isNewest && !target.closest?.('#panel'));
    if (!isHere || target.closest?.('input[type="text"]')) return;
    if (key === 'y' || event.shiftKey) this.#measures.redo();
    else this.#measures.undo();
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  #show() {
    const measures = this.#measures;
    const { items, canEdit, elsewhere } = measures;
    this.#undo.disabled = !measures.canUndo;
    this.#redo.disabled = !measures.canRedo;
    for (const button of this.#exports) button.disabled = items.length + elsewhere === 0;
    this.#empty.hidden = items.length > 0;
    this.#noUnit.hidden = !items.some(lacksUnit);
    this.#elsewhere.hidden = elsewhere === 0;
    setText(this.#elsewhere, t('measure.elsewhere', { count: elsewhere }));
    const key = JSON.stringify([items.map((m) => [m.id, measures.nameOf(m), m.value, m.unit, m.note, m.outside, m.color, m.hidden]), measures.selected?.id, canEdit]);
    if (key !== this.#shownList) {
      this.#shownList = key;
      this.#showList(items, canEdit);
    }
    this.#showDetail(measures.selected, canEdit);
  }

  #showList(items, canEdit) {
    const focused = document.activeElement?.closest?.('#measures [data-act]');
    const place = focused && [focused.closest('li').dataset.id, focused.dataset.act];
    this.#list.replaceChildren(...items.map((item) => this.#entry(item, canEdit)));
    if (!place) return;
    const entry = [...this.#list.children].find(({ dataset }) => dataset.id === place[0]);
    (entry?.querySelector(`[data-act="${place[1]}"]`) ?? this.#list.querySelector('[data-act="select"]') ?? this.#undo).focus();
  }

  #entry(item, canEdit) {
    const measures = this.#measures;
    const name = measures.nameOf(item);
    const outside = outsideText(item);
    const dot = make('span', { class: 'dot', 'aria-hidden': 'true' });
    dot.style.backgroundColor = item.color;
    const tool = (act, sign, label, press, more = {}) => {
      const button = make('button', { class: 'measure-tool', 'data-act': act, 'aria-label': label, title: label, press, ...more });
      button.append(sign);
      return button;
    };
    const select = make('button', {
      class: 'measure-name', 'data-act': 'select', 'aria-pressed': String(measures.selected === item),
      press: () => measures.select(measures.selected === item ? null : item.id),
    }, dot, ICONS[item.kind]?.() ?? '', make('span', { class: 'measure-about' }, make('span', { class: 'name', text: name }),
      make('span', { class: 'measure-value', text: namedValue(item) }), ...(outside ? [make('span', { class: 'measure-outside', text: outside })] : [])));
    return make('li', { 'data-id': item.id, 'data-hidden': item.hidden },
      select,
      tool('hide', item.hidden ? icon('eye-off') : icon('eye'), t(item.hidden ? 'measure.unhide' : 'measure.hide', { name }),
        () => measures.edit(item.id, { hidden: !item.hidden }), { disabled: !canEdit }),
      tool('go', icon('locate'), t('measure.go', { name }), ({ timeStamp }) => this.#go(item, timeStamp)),
      tool('remove', icon('trash-2'), t('measure.remove', { name }), () => measures.remove(item.id), { disabled: !canEdit }));
  }

  #showDetail(item, canEdit) {
    this.#detail.hidden = !item;
    if (!item) {
      this.#shownDetail = this.#plotKey = '';
      return;
    }
    const key = `${item.id} ${canEdit}`;
    if (key !== this.#shownDetail) {
      this.#shownDetail = key;
      this.#plotKey = '';
      this.#buildDetail(item, canEdit);
    }
    const { text, color, points, about } = this.#fields;
    if (document.activeElement !== text) text.value = item.text;
    if (document.activeElement !== color) color.value = item.color;
    setText(about, item.author ? t('measure.author', { name: item.author }) : '');
    handlesOf(item).forEach((point, i) => {
      points[i]?.setAttribute('aria-label', t('measure.point', { number: i + 1, place: point.map((part) => shortNumber(part)).join(', ') }));
      points[i]?.toggleAttribute('data-focus', this.#measures.handle === i);
    });
    this.#showPlot(item);
  }

  #buildDetail(item, canEdit) {
    const measures = this.#measures;
    const text = make('input', { type: 'text', id: 'measure-text', maxlength: TEXT_BYTES, disabled: !canEdit, autocomplete: 'off', placeholder: measures.nameOf({ ...item, text: '' }) });
    const color = make('input', { type: 'color', id: 'measure-color', disabled: !canEdit });
    const points = handlesOf(item).map((_, i) => this.#pointButton(item.id, i, canEdit));
    const about = make('p', { class: 'about' });
    text.addEventListener('change', () => measures.edit(item.id, { text: fit(text.value.trim()) }));
    text.addEventListener('keydown', ({ key }) => key === 'Enter' && text.blur());
    color.addEventListener('input', () => measures.edit(item.id, { color: color.value }, { isDrag: true }));
    color.addEventListener('change', () => measures.end());
    this.#plot = make('div', { id: 'measure-plot' });
    this.#fields = { text, color, points, about };
    this.#detail.replaceChildren(
      make('div', { class: 'row' }, make('label', { for: 'measure-text', text: t('measure.text') }), text, make('label', { class: 'unseen', for: 'measure-color', text: t('measure.color') }), color),
      make('div', { class: 'row', role: 'group', 'aria-label': t('measure.points.label') }, make('span', { text: t('measure.points'), title: t('measure.points.title') }), make('span', { class: 'steps' }, ...points)),
      about, this.#plot);
  }

  /** A button for a handle: the arrow keys move it. */
  #pointButton(id, handle, canEdit) {
    const measures = this.#measures;
    const button = make('button', { text: String(handle + 1), title: t('measure.points.title'), disabled: !canEdit });
    button.addEventListener('focus', () => measures.focusHandle(handle));
    button.addEventListener('blur', () => {
      measures.end();
      measures.focusHandle(null);
    });
    button.addEventListener('keydown', (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (event.key === 'Delete') {
        measures.remove(id);
      } else if (ARROWS[event.key]) {
        this.#move(id, handle, ARROWS[event.key], event.shiftKey ? FINE : 1);
      } else {
        return;
      }
      event.preventDefault();
      event.stopPropagation();
    });
    return button;
  }

  /** Directions of the arrow keys: in the region's plane, in the slice that holds the point, or on the screen. */
  #directions(item) {
    const { viewer } = this.#app;
    const pane = panesOf(this.#app).find(({ isShown, plane }) => isShown && plane?.kind !== 'oblique' && plane);
    if (item.kind === 'rectangle' || item.kind === 'ellipse') {
      const [u, v] = [1, 2].map((i) => normalize(subtract(item.points[i], item.points[0])));
      return [u, v, normalize(cross(u, v))];
    }
    if (pane) return [pane.plane.right, pane.plane.down, pane.plane.normal];
    const { orientation } = viewer.rig;
    return [[1, 0, 0], [0, -1, 0], [0, 0, 1]].map((axis) => rotate(orientation, axis));
  }

  #move(id, handle, [x, y, z], factor) {
    const item = this.#measures.selected;
    const { viewer } = this.#app;
    if (item?.id !== id || !viewer.rig) return;
    const step = factor * (viewer.volume?.spacing ? Math.min(...viewer.volume.spacing) : viewer.rig.distance / 200);
    const [right, down, normal] = this.#directions(item);
    const by = scale(add(add(scale(right, x), scale(down, y)), scale(normal, z)), step);
    // Across its plane a region moves as a whole.
    const points = z && item.kind !== 'angle' && item.points.length === 3 ? item.points.map((point) => add(point, by))
      : moveHandle(item, handle, add(handlesOf(item)[handle], by));
    if (points) this.#measures.edit(id, { points }, { isDrag: true });
  }

  /** The numbers at once; the plot after the points have rested. */
  #showPlot(item) {
    const { kind, points, statistics, value, unit, data_unit: dataUnit, outside, note, area, straight } = item;
    const key = JSON.stringify([item.id, points, statistics, value, unit, dataUnit, outside, note, area, straight]);
    if (key === this.#plotKey) return;
    this.#plotKey = key;
    clearTimeout(this.#plotTimer);
    const words = outsideText(item);
    const numbers = make('div', {}, numbersTable(item),
      ...(words ? [make('p', { class: 'measure-outside', text: statistics && outside < 1 ? t('measure.outside.statistics', { outside: words }) : words })] : []));
    if (this.#plot.firstElementChild) this.#plot.firstElementChild.replaceWith(numbers);
    else this.#plot.append(numbers);
    const hasPlot = kind === 'profile' || kind === 'rectangle' || kind === 'ellipse';
    if (hasPlot && statistics) this.#plotTimer = setTimeout(() => this.#loadPlot(item, key), PLOT_WAIT_MS);
  }

  async #loadPlot({ kind, points }, key) {
    const { connection, report } = this.#app;
    const { session } = connection;
    if (!session) return;
    try {
      const answer = await this.#app.api.measure(session.id, session.tokens?.view ?? session.token, {
        kind, points, ...(kind === 'profile' ? { samples: PLOT_SAMPLES } : {}),
      });
      if (key !== this.#plotKey) return;
      const plot = kind === 'profile' ? profilePlot(answer, (world) => this.#measures.pointAt(world)) : answer.histogram && histogramPlot(answer);
      this.#plot.replaceChildren(this.#plot.firstElementChild, ...(plot ? [plot] : []));
    } catch (error) {
      if (connection.isLive) report(error);
    }
  }

  /** Moves the crosshair to a measurement, and the picture without turning it. */
  #go(item, time) {
    const { viewer, slices } = this.#app;
    const center = centerOf(item);
    this.#measures.select(item.id);
    if (slices?.grid) slices.setPosition(center, time);
    if (!viewer.isReady) return;
    const rig = { ...viewer.rig, target: center };
    const camera = { ...viewer.camera, ...cameraFromRig(rig) };
    viewer.show({ ...viewer.view, camera }, time);
  }

  async #save(format) {
    const { connection, api, report, viewer } = this.#app;
    const { session } = connection;
    try {
      const text = await api.measures(session.id, session.tokens?.view ?? session.token, format);
      const link = make('a', { href: URL.createObjectURL(new Blob([text], { type: format === 'csv' ? 'text/csv' : 'application/json' })) });
      link.download = `${viewer.view?.volume ?? 'splatd'}-measures.${format}`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), SAVE_MS);
    } catch (error) {
      report(error);
    }
  }

  async #copy() {
    const { notice } = this.#app;
    const text = tableText(this.#measures.items, (item) => this.#measures.nameOf(item));
    const isCopied = await navigator.clipboard?.writeText(text).then(() => true, () => false);
    notice.show(t(isCopied ? 'measure.copied' : 'measure.copy.failed', { count: this.#measures.items.length }), isCopied ? 'success' : 'error');
  }
}
