// SPDX-License-Identifier: Apache-2.0
// The tools that draw measurements: one mode per kind. In the 3-D picture points snap to the surface (pick), in a slice they lie in it.
// Points come by clicks or by one drag; Enter sets one at the middle of the picture or at the crosshair of the slice.
import { KINDS, pointsFromCorners, quickValue, valueText } from '../core/measures.js';
import { t } from '../core/text.js';

const TOOLS = [
  { kind: 'distance', icon: 'ruler', key: 'd' }, { kind: 'angle', icon: 'triangle-right', key: 'a' },
  { kind: 'profile', icon: 'chart-line', key: 'i' }, { kind: 'rectangle', icon: 'square-dashed', key: 'r' },
  { kind: 'ellipse', icon: 'circle-dashed', key: 'e' }, { kind: 'marker', icon: 'map-pin', key: 'm' },
];
const DRAG_PX = 6;

export const modeOf = (kind) => `measure-${kind}`;

export function installTools(app, measures) {
  const { modes, toolbar } = app;
  const buttons = TOOLS.map(({ kind, icon, key }) => {
    modes.add(modeOf(kind), toolMode(app, measures, kind));
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
    notice.show(error.message);
    return null;
  }
}

/** The panes with slices. */
export const panesOf = (app) => [...(app.slices?.panes.values() ?? [])];

/** The pane with slices whose canvas is this element; null = none. */
const paneWith = (app, element) => panesOf(app).find((pane) => pane.element === element) ?? null;

function toolMode(app, measures, kind) {
  const { modes, screen, notice } = app;
  const { hasPlane, points: count } = KINDS[kind];
  const wanted = hasPlane ? 2 : count;
  let draft = null; // {kind, points, pane, plane, cursor: {at, pane}}
  let from = null; // where the button was pressed
  let waiting = Promise.resolve(); // picks, one after the other

  const show = () => {
    measures.draft = draft;
    if (draft) {
      const { at, pane } = draft.cursor ?? {};
      const points = pane && draft.points.length < wanted ? [...draft.points, pane.toWorld(...at)] : draft.points;
      const unit = kind === 'angle' ? 'deg' : app.viewer.volume?.unit ?? '';
      const text = points.length === count && !hasPlane ? valueText({ value: quickValue({ kind, points }), unit }, '') : '';
      modes.say(text || t(`measure.${kind}`), t(`measure.${kind}.hint`));
    }
    measures.emit('change');
  };
  const reset = () => {
    draft = { kind, points: [], pane: null, plane: null, cursor: null };
    show();
  };
  const finish = () => {
    const points = hasPlane ? pointsFromCorners(kind, draft.points[0], draft.points[1], draft.plane) : draft.points;
    if (!points) {
      draft.points.pop();
      show();
      return;
    }
    draft = null;
    modes.leave();
    const item = measures.add(kind, points);
    if (item && kind === 'marker') measures.emit('name', item.id);
  };
  const put = (world, pane) => {
    if (!draft || !world) return;
    const last = draft.points.at(-1);
    if (last && last.every((part, i) => part === world[i])) return;
    if (draft.points.length === 0 || (hasPlane && draft.pane !== pane)) {
      draft.points = [];
      draft.pane = pane;
      draft.plane = pane?.plane ?? null;
    }
    draft.points.push(world);
    if (draft.points.length >= wanted) finish();
    else show();
  };
  const place = (at, pane) => {
    if (hasPlane && !pane) {
      notice.show(t('measure.slice'));
      return;
    }
    waiting = waiting.then(async () => put(pane ? pane.toWorld(...at) : await surfaceAt(app, at), pane));
  };
  const pointer = {
    cursor: 'crosshair',
    down: (at, event, pane = null) => {
      from = at;
      place(at, pane);
    },
    move: (at, event, pane = null) => {
      if (draft) draft.cursor = { at, pane };
      show();
    },
    up: (at, event, pane = null) => {
      if (from && Math.hypot(at[0] - from[0], at[1] - from[1]) > DRAG_PX) place(at, pane);
      from = null;
    },
    hover: (at, event, pane = null) => {
      if (!draft || draft.points.length === 0) return;
      draft.cursor = { at, pane };
      show();
    },
    double: () => {},
    cancel: () => {
      waiting = waiting.then(() => {
        draft?.points.pop();
        show();
      });
    },
  };
  return {
    label: t(`measure.${kind}`), hint: t(`measure.${kind}.hint`), ...pointer, panes: pointer,
    enter: () => {
      reset();
      if (hasPlane && app.layout.current === '3d' && app.slices) app.layout.set('four');
    },
    leave: () => {
      draft = null;
      show();
    },
    key: ({ key, target }) => {
      if (key === 'Backspace' || key === 'Delete') {
        draft?.points.pop();
        show();
        return true;
      }
      if (key !== 'Enter' || target.closest?.('button')) return false;
      const pane = paneWith(app, target);
      if (pane) put(app.slices.position, pane);
      else place([screen.viewport.width / 2, screen.viewport.height / 2], null);
      return true;
    },
  };
}
