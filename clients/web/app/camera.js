// SPDX-License-Identifier: Apache-2.0
// The section "Camera": the camera in numbers.
import { sphereAround, zoomLimits } from '../core/camera.js';
import { roundCoordinate } from '../core/lengths.js';
import { heightAtTarget, withFieldOfView } from '../core/movement.js';
import { anglesOf, orientationOf } from '../core/orientation.js';
import { t } from '../core/text.js';
import { make } from './dom.js';

const ORDER = 95;
const round = (value) => Number(value.toFixed(1)) + 0;

/** name, limits, and whether a projection has it. */
const FIELDS = [
  { name: 'azimuth', min: -360, max: 360, unit: '°' },
  { name: 'elevation', min: -90, max: 90, unit: '°' },
  { name: 'roll', min: -360, max: 360, unit: '°' },
  { name: 'distance', min: 0, of: 'perspective' },
  { name: 'fov', min: 1, max: 170, unit: '°', of: 'perspective' },
  { name: 'height', min: 0, of: 'orthographic' },
];

export function install(app) {
  const { viewer, orientation, panel } = app;
  const body = panel.section({ id: 'camera', title: t('camera.section'), order: ORDER });
  const rows = FIELDS.map((field) => {
    const id = `camera-${field.name}`;
    const input = make('input', { id, type: 'number', step: 'any', min: field.min, ...(field.max ? { max: field.max } : {}) });
    const unit = make('span', { class: 'unit', text: field.unit ?? '' });
    const row = make('div', { class: 'row', title: t(`camera.${field.name}.title`) },
      make('label', { for: id, text: t(`camera.${field.name}`) }), make('span', { class: 'number' }, input, unit));
    body.append(row);
    input.addEventListener('change', (event) => {
      if (input.value !== '' && input.validity.valid) set(field.name, input.valueAsNumber, event.timeStamp);
      show();
    });
    return { ...field, input, unit, row };
  });

  const set = (name, value, time) => {
    if (!viewer.isReady) return;
    const { rig } = viewer;
    const { nearest, farthest } = zoomLimits(sphereAround(viewer.box));
    const limited = Math.min(farthest, Math.max(nearest, value));
    switch (name) {
      case 'distance': case 'height': orientation.glide.to({ ...rig, [name]: limited }, time); break;
      case 'fov': viewer.place(withFieldOfView(rig, value), time); break;
      default: {
        const angles = { ...anglesOf(orientation.frame, rig.orientation), [name]: value };
        orientation.glide.to({ ...rig, orientation: orientationOf(orientation.frame, angles) }, time);
      }
    }
  };

  /** Shows the numbers of the camera; a field that has the focus stays as the user writes it. */
  const show = () => {
    const { rig, volume } = viewer;
    body.toggleAttribute('inert', !viewer.canControl || !rig);
    if (!rig) return;
    const angles = anglesOf(orientation.frame, rig.orientation);
    const extent = heightAtTarget(rig);
    for (const { name, input, unit, row, of } of rows) {
      row.hidden = Boolean(of) && of !== rig.projection;
      if (!row.matches('[hidden]') && document.activeElement !== input) {
        const value = name in angles ? round(angles[name]) : name === 'fov' ? round(rig.fovY) : roundCoordinate(rig[name], extent);
        input.value = String(value);
      }
      if (name === 'distance' || name === 'height') unit.textContent = volume?.unit ?? '';
    }
  };
  let isPlanned = false;
  const plan = () => {
    if (isPlanned) return;
    isPlanned = true;
    requestAnimationFrame(() => {
      isPlanned = false;
      show();
    });
  };
  viewer.on('view', plan);
  viewer.on('camera', plan);
  orientation.on('change', plan);
}
