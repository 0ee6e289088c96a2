// SPDX-License-Identifier: Apache-2.0
// The section "Slices" of the panel.
import { MAP_NAMES } from '../../core/color_maps.js';
import { mainAxis } from '../../core/slices.js';
import { t } from '../../core/text.js';
import { make, setText } from '../controls/dom.js';

const KINDS = ['axial', 'coronal', 'sagittal'];
const MODES = ['none', 'orthogonal', 'oblique'];
const FIELDS = [['center', 'slices.center'], ['width', 'slices.width']];

/** The buttons of the planes, in the order of the fields of the position: those across x, y and z. */
function showPlanes(slices, row, buttons) {
  const planes = KINDS.map((kind) => slices.planeOf(kind));
  const visible = slices.planesIn3d.map(({ kind }) => kind);
  buttons.forEach((button, i) => {
    setText(button, slices.nameOf(planes[i]));
    button.setAttribute('aria-pressed', String(visible.includes(KINDS[i])));
  });
  const order = [0, 1, 2].sort((a, b) => mainAxis(planes[a].normal) - mainAxis(planes[b].normal)).map((i) => buttons[i]);
  if (order.some((button, i) => button !== row.children[i])) row.append(...order);
}

/** The names of the fields of the position: where their axes point, if the file tells it. */
function namePlaces({ anatomy }, fields) {
  fields.forEach((input, i) => {
    const axis = 'xyz'[i];
    const name = anatomy ? t('slices.position.towards', { axis, letter: anatomy[i] }) : t('slices.position.axis', { axis });
    for (const attribute of ['aria-label', 'title']) input.setAttribute(attribute, name);
  });
}

export function installSection({ panel, slices, viewer, layout }) {
  const body = panel.section({ id: 'slices' });
  const mode = make('select', { id: 'slices-mode' }, ...MODES.map((name) => make('option', { value: name, text: t(`slices.mode.${name}`) })));
  const inPicture = make('input', { id: 'slices-in-3d', type: 'checkbox', role: 'switch' });
  const shown = KINDS.map((kind) => make('button', {
    'data-kind': kind, 'aria-pressed': 'true', press: ({ currentTarget, timeStamp }) => slices.showIn3d(kind, currentTarget.getAttribute('aria-pressed') !== 'true', timeStamp),
  }));
  const shownRow = make('div', { class: 'buttons', id: 'slices-planes', role: 'group', 'aria-label': t('slices.in3d.planes'), title: t('slices.in3d.planes'), 'data-pointer': '/slices/planes' }, ...shown);
  const places = [0, 1, 2].map(() => make('input', { type: 'number', step: 'any' }));
  const values = FIELDS.map(([name, label]) => make('input', { id: `slices-${name}`, type: 'number', step: 'any', 'aria-label': t(label) }));
  const colors = make('select', { id: 'slices-colors', title: t('slices.colors.title') }, ...['grey', 'transfer_function', ...MAP_NAMES.filter((name) => name !== 'grey')].map((value) => (
    make('option', { value, text: ['grey', 'transfer_function'].includes(value) ? t(`slices.colors.${value}`) : t(`map.${value}`) }))));
  colors.addEventListener('change', ({ timeStamp }) => slices.change({ colors: colors.value }, timeStamp));
  const align = make('button', { id: 'slices-align', text: t('slices.align'), title: t('slices.align.title'), press: ({ timeStamp }) => slices.alignWithView(timeStamp) });
  const reset = make('button', { id: 'slices-reset', text: t('slices.reset'), title: t('slices.reset.title'), press: ({ timeStamp }) => slices.reset(timeStamp) });
  const row = (label, pointer, ...controls) => make('div', { class: 'row', 'data-pointer': pointer },
    make('label', { text: label, ...(controls[0].id ? { for: controls[0].id } : {}) }), ...controls);
  const together = (inputs) => make('span', { class: 'slice-numbers' }, ...inputs);
  const controls = make('fieldset', { class: 'slice-fields' },
    row(t('slices.mode'), '/slices/mode', mode),
    row(t('slices.in3d'), '/slices/in_3d', inPicture), shownRow,
    row(t('slices.position'), '/slices/position', together(places)),
    row(t('slices.window'), '/slices/window', together(values)),
    row(t('slices.colors'), '/slices/colors', colors),
    make('div', { class: 'buttons', 'data-pointer': '/slices/normal' }, align, reset));
  body.append(controls);

  mode.addEventListener('change', ({ timeStamp }) => slices.setMode(mode.value, timeStamp));
  inPicture.addEventListener('change', ({ timeStamp }) => {
    const needsMode = inPicture.checked && slices.shared.mode === 'none';
    slices.change({ in_3d: inPicture.checked, ...(needsMode ? { mode: 'orthogonal' } : {}) }, timeStamp);
  });
  places.forEach((input, axis) => input.addEventListener('change', ({ timeStamp }) => {
    if (Number.isFinite(input.valueAsNumber) && slices.grid) slices.setPosition(slices.position.with(axis, slices.back(axis, input.valueAsNumber)), timeStamp);
  }));
  values.forEach((input, i) => input.addEventListener('change', ({ timeStamp }) => {
    if (Number.isFinite(input.valueAsNumber)) slices.change({ window: { [FIELDS[i][0]]: input.valueAsNumber } }, timeStamp);
  }));

  function show() {
    const { shared } = slices;
    controls.disabled = !shared || !viewer.canControl;
    if (!shared) return;
    // Panes show three slices where the session has none.
    mode.options[MODES.indexOf('none')].hidden = slices.areShown;
    mode.value = slices.areShown && shared.mode === 'none' ? 'orthogonal' : shared.mode;
    colors.value = slices.colors;
    inPicture.checked = shared.in_3d && shared.mode !== 'none';
    shownRow.hidden = shared.mode === 'oblique' || !slices.grid;
    if (!shownRow.hidden) showPlanes(slices, shownRow, shown);
    namePlaces(slices, places);
    align.hidden = shared.mode !== 'oblique';
    const set = (input, value) => {
      if (document.activeElement !== input) input.value = String(value);
    };
    places.forEach((input, axis) => set(input, slices.grid ? slices.along(axis, shared.position[axis]) : shared.position[axis]));
    values.forEach((input, i) => set(input, slices.round(shared.window[FIELDS[i][0]])));
  }
  slices.on('change', show);
  viewer.on('view', show);
  layout.on('change', show);
}
