// SPDX-License-Identifier: Apache-2.0
// The section "Camera": the camera in numbers.
import { sphereAround, zoomLimits } from '../../core/camera.js';
import { roundCoordinate, unitName } from '../../core/lengths.js';
import { heightAtTarget, withFieldOfView } from '../../core/movement.js';
import { anglesOf, orientationOf } from '../../core/orientation.js';
import { t } from '../../core/text.js';
import { make } from '../controls/dom.js';

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

class CameraNumbers {
  #viewer; #orientation; #body; #rows;
  #isPlanned = false;

  constructor({ viewer, orientation, panel }) {
    this.#viewer = viewer;
    this.#orientation = orientation;
    this.#body = panel.section({ id: 'camera', title: t('camera.section'), order: ORDER });
    this.#rows = FIELDS.map((field) => this.#row(field));
  }

  #row(field) {
    const id = `camera-${field.name}`;
    const input = make('input', { id, type: 'number', step: 'any', min: field.min, ...(field.max ? { max: field.max } : {}) });
    const unit = make('span', { class: 'unit', text: field.unit ?? '' });
    const row = make('div', { class: 'row', title: t(`camera.${field.name}.title`) },
      make('label', { for: id, text: t(`camera.${field.name}`) }), make('span', { class: 'number' }, input, unit));
    this.#body.append(row);
    input.addEventListener('change', ({ timeStamp }) => {
      if (input.value !== '' && input.validity.valid) this.#set(field.name, input.valueAsNumber, timeStamp);
      this.#show();
    });
    return { ...field, input, unit, row };
  }

  #set(name, value, time) {
    const viewer = this.#viewer;
    if (!viewer.isReady) return;
    const { rig } = viewer;
    const { frame, glide } = this.#orientation;
    const { nearest, farthest } = zoomLimits(sphereAround(viewer.box));
    const limited = Math.min(farthest, Math.max(nearest, value));
    switch (name) {
      case 'distance': case 'height': glide.to({ ...rig, [name]: limited }, time); break;
      case 'fov': viewer.place(withFieldOfView(rig, value), time); break;
      default: glide.to({ ...rig, orientation: orientationOf(frame, { ...anglesOf(frame, rig.orientation), [name]: value }) }, time);
    }
  }

  /** Shows the numbers of the camera; a field that has the focus stays as the user writes it. */
  #show() {
    const { rig, volume, canControl } = this.#viewer;
    this.#body.toggleAttribute('inert', !canControl || !rig);
    if (!rig) return;
    const angles = anglesOf(this.#orientation.frame, rig.orientation);
    const extent = heightAtTarget(rig);
    for (const { name, input, unit, row, of } of this.#rows) {
      row.hidden = Boolean(of) && of !== rig.projection;
      if (!row.hidden && document.activeElement !== input) {
        const value = name in angles ? round(angles[name]) : name === 'fov' ? round(rig.fovY) : roundCoordinate(rig[name], extent);
        input.value = String(value);
      }
      if (name === 'distance' || name === 'height') unit.textContent = unitName(volume?.unit);
    }
  }

  /** Shows the numbers at the next animation frame. */
  plan() {
    if (this.#isPlanned) return;
    this.#isPlanned = true;
    requestAnimationFrame(() => {
      this.#isPlanned = false;
      this.#show();
    });
  }
}

export function install(app) {
  const numbers = new CameraNumbers(app);
  app.viewer.on('view', () => numbers.plan());
  app.viewer.on('camera', () => numbers.plan());
  app.orientation.on('change', () => numbers.plan());
}
