// SPDX-License-Identifier: Apache-2.0
// The tools that draw measurements: one mode per kind. In the 3-D picture points snap to the surface (pick), in a slice they lie in it.
// Points come by clicks or by one drag. Enter sets one at the middle of the picture, which the arrow keys turn, or in a slice at a cursor, which
// the arrow keys move from the crosshair.
import { namedValue } from '../../core/measure_text.js';
import { KINDS, pointsFromCorners, quickValue, unitOf } from '../../core/measures.js';
import { rangeOfPart } from '../../core/edits.js';
import { t } from '../../core/text.js';
import { pickAt } from '../rendering/pick.js';
import { TOOLS } from './measure_buttons.js';

const DRAG_PX = 6;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEP_PX = 8;
const FINE_PX = 1;

const modeOf = (kind) => `measure-${kind}`;

export function installTools(app, measures) {
  const { modes, toolbar, viewer, connection } = app;
  const tools = new Map(TOOLS.map(({ kind }) => [modeOf(kind), new Tool(app, measures, kind)]));
  const buttons = TOOLS.map(({ kind }) => {
    modes.add(modeOf(kind), tools.get(modeOf(kind)).mode);
    const button = toolbar.button({ id: `tool-${kind}`, press: () => measures.canEdit && modes.toggle(modeOf(kind)) });
    return { kind, button };
  });
  const show = () => {
    for (const { kind, button } of buttons) {
      button.disabled = !measures.canEdit;
      button.setAttribute('aria-pressed', String(modes.current === modeOf(kind)));
    }
    if (modes.current.startsWith('measure-') && !measures.canEdit) modes.leave();
  };
  const current = () => tools.get(modes.current);
  modes.on('change', () => {
    show();
    current()?.takeFocus(document.activeElement);
  });
  document.addEventListener('focusin', ({ target }) => current()?.takeFocus(target));
  measures.on('change', show);
  viewer.on('view', () => current()?.follow());
  connection.on('session', () => current()?.follow());
  show();
}

/** The surface below a point of the 3-D picture, or null. */
export const surfaceAt = async (app, at) => (await pickAt(app, at))?.position ?? null;

/** {position, value} at a place of a pane with slices. */
function foundIn(pane, at) {
  const position = pane.toWorld(...at);
  return { position, value: pane.valueAt(position) };
}

/** The panes with slices. */
export const panesOf = (app) => [...(app.slices?.panes.values() ?? [])];

/** The pane with slices whose canvas is this element; null = none. */
const paneWith = (app, element) => panesOf(app).find((pane) => pane.element === element) ?? null;

/** One kind of measurement while it is drawn. */
class Tool {
  #app; #measures; #kind; #hasPlane;
  #count; // points of a finished measurement
  #wanted; // points to set: two corners where the kind lies in a plane
  #draft = null; // {kind, points, pane, plane, volume, session, cursor: {at, pane, isKey}}; isKey: the keys move the cursor
  #from = null; // where the button was pressed
  #waiting = Promise.resolve(); // picks, one after the other

  constructor(app, measures, kind) {
    const { hasPlane, points } = KINDS[kind];
    this.#app = app;
    this.#measures = measures;
    this.#kind = kind;
    this.#hasPlane = hasPlane;
    this.#count = points;
    this.#wanted = hasPlane ? 2 : points;
  }

  /** The mode, see modes.js. Panes with slices call the same functions and pass themselves last. */
  get mode() {
    const pointer = {
      cursor: 'crosshair',
      down: (at, event, pane = null) => {
        this.#from = at;
        if (this.#draft) this.#draft.cursor = null;
        this.#place(at, pane);
      },
      move: (at, event, pane = null) => {
        if (this.#draft) this.#draft.cursor = { at, pane };
        this.#show();
      },
      up: (at, event, pane = null) => {
        if (this.#from && Math.hypot(at[0] - this.#from[0], at[1] - this.#from[1]) > DRAG_PX) this.#place(at, pane);
        this.#from = null;
      },
      hover: (at, event, pane = null) => {
        const isKey = this.#draft?.cursor?.isKey;
        if (!isKey && !this.#draft?.points.length) return;
        if (isKey && !event.movementX && !event.movementY) return; // the pictures moved, not the pointer
        this.#draft.cursor = this.#draft.points.length ? { at, pane } : null;
        this.#show();
      },
      double: () => {},
      cancel: () => { this.#waiting = this.#waiting.then(() => this.#removeLast()); },
    };
    return {
      label: t(`measure.tool.${this.#kind}`), hint: this.#hint, ...pointer, panes: pointer, isForPanes: this.#hasPlane,
      enter: () => this.#enter(), leave: () => this.#leave(), key: (event) => this.#press(event),
    };
  }

  #enter() {
    const { layout, slices } = this.#app;
    this.#begin();
    if (this.#hasPlane && layout.current === '3d' && slices) layout.set('four');
  }

  #begin() {
    const { viewer, connection } = this.#app;
    const [volume, session] = [viewer.view?.volume, connection.session?.id];
    this.#draft = { kind: this.#kind, points: [], pane: null, plane: null, volume, session, cursor: null };
    this.#show();
  }

  #leave() {
    this.#draft = null;
    this.#show();
  }

  /** Points of another volume or session mean nothing in this one: the draft begins again. */
  follow() {
    const { viewer, connection } = this.#app;
    if (this.#draft && (this.#draft.volume !== viewer.view?.volume || this.#draft.session !== connection.session?.id)) this.#begin();
  }

  /** The focus came to an element: the hint names its keys, and the cursor of the keys is visible where a user of the keyboard needs it. */
  takeFocus(element) {
    if (!this.#draft) return;
    const pane = paneWith(this.#app, element);
    const isPicture = element === this.#app.screen.element && !this.#hasPlane;
    if ((pane || isPicture) && element.matches(':focus-visible')) this.#draft.cursor = this.#keyCursor(pane);
    this.#show();
  }

  /** The cursor of the keys before they move it: in the middle of the 3-D picture, or at the crosshair of a pane if that is visible. */
  #keyCursor(pane) {
    const { screen, slices } = this.#app;
    return {
      pane, isKey: true,
      get at() {
        const size = pane?.size ?? [screen.viewport.width, screen.viewport.height];
        const { x, y } = pane?.plane ? pane.toPane(slices.position) : { x: -1, y: -1 };
        return x >= 0 && y >= 0 && x <= size[0] && y <= size[1] ? [x, y] : size.map((side) => side / 2);
      },
    };
  }

  #press({ key, shiftKey, target }) {
    if (key === 'Backspace' || key === 'Delete') {
      this.#removeLast();
      return true;
    }
    const pane = paneWith(this.#app, target);
    if (key in ARROWS && pane) {
      this.#moveCursor(pane, ARROWS[key], shiftKey ? FINE_PX : STEP_PX);
      return true;
    }
    const usesEnter = target.closest?.('button, summary, a');
    if (key !== 'Enter' || usesEnter) return false;
    if (this.#draft.cursor?.pane !== pane || !pane) this.#draft.cursor = this.#keyCursor(pane);
    const { at } = this.#draft.cursor;
    if (pane) this.#put(foundIn(pane, at), pane);
    else this.#place(at, null);
    return true;
  }

  #moveCursor(pane, direction, px) {
    const { cursor } = this.#draft;
    const { at } = cursor?.pane === pane ? cursor : this.#keyCursor(pane);
    const moved = at.map((part, i) => Math.min(Math.max(part + px * direction[i], 0), pane.size[i]));
    this.#draft.cursor = { pane, isKey: true, at: moved };
    this.#show();
  }

  /** Sets a point below a place of the 3-D picture, or of a pane with slices. */
  #place(at, pane) {
    if (this.#hasPlane && !pane) {
      this.#app.notice.show(t('measure.slice'));
      return;
    }
    const draft = this.#draft;
    this.#waiting = this.#waiting.then(async () => {
      const found = pane ? foundIn(pane, at) : await pickAt(this.#app, at);
      if (draft === this.#draft && found) this.#put(found, pane);
    });
  }

  #put({ position: world, value }, pane) {
    const draft = this.#draft;
    if (!draft || !world) return;
    const last = draft.points.at(-1);
    if (last && last.every((part, i) => part === world[i])) return;
    if (draft.points.length === 0 || (this.#hasPlane && draft.pane !== pane)) {
      Object.assign(draft, { points: [], value: null, pane, plane: pane?.plane ?? null });
    }
    draft.points.push(world);
    draft.value ??= value;
    if (draft.points.length >= this.#wanted) this.#finish();
    else this.#show();
  }

  /** The values of the part at the first point, from what is shown. */
  #rangeOf(value) {
    const { viewer, transfer } = this.#app;
    return rangeOfPart(viewer.view, Number.isFinite(value) ? value : transfer.range[0], transfer.range);
  }

  #removeLast() {
    this.#draft?.points.pop();
    this.#show();
  }

  #finish() {
    const { points, plane } = this.#draft;
    const all = this.#hasPlane ? pointsFromCorners(this.#kind, points[0], points[1], plane) : points;
    if (!all) {
      this.#removeLast(); // the corners are on one line
      return;
    }
    const range = KINDS[this.#kind].hasRange ? this.#rangeOf(this.#draft.value) : null;
    this.#draft = null;
    this.#app.modes.leave();
    const item = this.#measures.add(this.#kind, all, range);
    if (item && this.#kind === 'marker') this.#measures.emit('name', item.id);
  }

  #show() {
    this.#measures.draft = this.#draft;
    if (this.#draft) this.#app.modes.say(this.#valueText || t(`measure.tool.${this.#kind}`), this.#hint);
    this.#measures.emit('change');
  }

  /** What the pointer does, and the keys where there may be a keyboard. */
  get #hint() {
    const pointer = t(`measure.${this.#kind}.hint`);
    if (window.matchMedia('(hover: none)').matches) return pointer;
    const isSlice = this.#hasPlane || paneWith(this.#app, document.activeElement) !== null;
    return t('measure.hint', { pointer, keys: t(isSlice ? 'measure.keys.slice' : 'measure.keys.picture') });
  }

  /** The value of the points and of the place under the pointer; '' before there are enough. */
  get #valueText() {
    const { points: set, cursor } = this.#draft;
    const points = cursor?.pane?.plane && set.length < this.#wanted ? [...set, cursor.pane.toWorld(...cursor.at)] : set;
    if (points.length !== this.#count || this.#hasPlane) return '';
    const value = quickValue({ kind: this.#kind, points });
    return value === null ? '' : namedValue({ kind: this.#kind, value, unit: unitOf(this.#kind, this.#app.viewer.volume) });
  }
}
