// SPDX-License-Identifier: Apache-2.0
// The tools that draw measurements: one mode per kind. In the 3-D picture points snap to the surface (pick), in a slice they lie in it.
// Points come by clicks or by one drag; Enter sets one at the middle of the picture or at the crosshair of the slice.
import { namedValue } from '../core/measure_text.js';
import { KINDS, pointsFromCorners, quickValue, unitOf } from '../core/measures.js';
import { t } from '../core/text.js';

const TOOLS = [
  { kind: 'distance', icon: 'ruler', key: 'd' }, { kind: 'angle', icon: 'triangle-right', key: 'a' },
  { kind: 'profile', icon: 'chart-line', key: 'i' }, { kind: 'rectangle', icon: 'square-dashed', key: 'r' },
  { kind: 'ellipse', icon: 'circle-dashed', key: 'e' }, { kind: 'marker', icon: 'map-pin', key: 'm' },
];
const DRAG_PX = 6;

const modeOf = (kind) => `measure-${kind}`;

export function installTools(app, measures) {
  const { modes, toolbar } = app;
  const buttons = TOOLS.map(({ kind, icon, key }) => {
    modes.add(modeOf(kind), new Tool(app, measures, kind).mode);
    const button = toolbar.button({
      id: `tool-${kind}`, icon, key, label: t(`measure.${kind}`), group: 'measure', isToggle: true,
      press: () => measures.canEdit && modes.toggle(modeOf(kind)),
    });
    return { kind, button };
  });
  const show = () => {
    for (const { kind, button } of buttons) {
      button.disabled = !measures.canEdit;
      button.setAttribute('aria-pressed', String(modes.current === modeOf(kind)));
    }
    if (modes.current.startsWith('measure-') && !measures.canEdit) modes.leave();
  };
  modes.on('change', show);
  measures.on('change', show);
  show();
}

/** The surface below a point of the 3-D picture, or null. */
export async function surfaceAt({ connection, screen, notice }, at) {
  const { width, height } = screen.viewport;
  try {
    const { position } = await connection.call('pick', { at: [at[0] * screen.size[0] / width, at[1] * screen.size[1] / height] });
    if (!position) notice.show(t('measure.nothing'));
    return position;
  } catch (error) {
    notice.show(error.message, 'error');
    return null;
  }
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
  #draft = null; // {kind, points, pane, plane, cursor: {at, pane}}
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
        if (!this.#draft?.points.length) return;
        this.#draft.cursor = { at, pane };
        this.#show();
      },
      double: () => {},
      cancel: () => { this.#waiting = this.#waiting.then(() => this.#removeLast()); },
    };
    return {
      label: t(`measure.${this.#kind}`), hint: t(`measure.${this.#kind}.hint`), ...pointer, panes: pointer,
      enter: () => this.#enter(), leave: () => this.#leave(), key: (event) => this.#press(event),
    };
  }

  #enter() {
    const { layout, slices } = this.#app;
    this.#draft = { kind: this.#kind, points: [], pane: null, plane: null, cursor: null };
    this.#show();
    if (this.#hasPlane && layout.current === '3d' && slices) layout.set('four');
  }

  #leave() {
    this.#draft = null;
    this.#show();
  }

  #press({ key, target }) {
    if (key === 'Backspace' || key === 'Delete') {
      this.#removeLast();
      return true;
    }
    if (key !== 'Enter' || target.closest?.('button')) return false;
    const { width, height } = this.#app.screen.viewport;
    const pane = paneWith(this.#app, target);
    if (pane) this.#put(this.#app.slices.position, pane);
    else this.#place([width / 2, height / 2], null);
    return true;
  }

  /** Sets a point below a place of the 3-D picture, or of a pane with slices. */
  #place(at, pane) {
    if (this.#hasPlane && !pane) {
      this.#app.notice.show(t('measure.slice'));
      return;
    }
    this.#waiting = this.#waiting.then(async () => this.#put(pane ? pane.toWorld(...at) : await surfaceAt(this.#app, at), pane));
  }

  #put(world, pane) {
    const draft = this.#draft;
    if (!draft || !world) return;
    const last = draft.points.at(-1);
    if (last && last.every((part, i) => part === world[i])) return;
    if (draft.points.length === 0 || (this.#hasPlane && draft.pane !== pane)) {
      Object.assign(draft, { points: [], pane, plane: pane?.plane ?? null });
    }
    draft.points.push(world);
    if (draft.points.length >= this.#wanted) this.#finish();
    else this.#show();
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
    this.#draft = null;
    this.#app.modes.leave();
    const item = this.#measures.add(this.#kind, all);
    if (item && this.#kind === 'marker') this.#measures.emit('name', item.id);
  }

  #show() {
    this.#measures.draft = this.#draft;
    if (this.#draft) this.#app.modes.say(this.#valueText || t(`measure.${this.#kind}`), t(`measure.${this.#kind}.hint`));
    this.#measures.emit('change');
  }

  /** The value of the points and of the place under the pointer; '' before there are enough. */
  get #valueText() {
    const { points: set, cursor } = this.#draft;
    const points = cursor?.pane && set.length < this.#wanted ? [...set, cursor.pane.toWorld(...cursor.at)] : set;
    if (points.length !== this.#count || this.#hasPlane) return '';
    const value = quickValue({ kind: this.#kind, points });
    return value === null ? '' : namedValue({ kind: this.#kind, value, unit: unitOf(this.#kind, this.#app.viewer.volume?.unit) });
  }
}
