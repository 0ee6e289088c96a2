// SPDX-License-Identifier: Apache-2.0
// The section "Picture" of the panel: background, shading, and the rendering choices.
import { flatLimit, hideFlat, matters, steepest } from '../../core/choices.js';
import { hasChannels, layersOf } from '../../core/layers.js';
import { quadratic } from '../../core/slider.js';
import { t } from '../../core/text.js';
import { byId } from '../controls/dom.js';
import { Fields, showNumber, showValue } from '../controls/fields.js';

const hex = (part) => Math.round(Math.min(1, Math.max(0, part)) * 255).toString(16).padStart(2, '0');
/** [r, g, b, a] in [0,1] → "#rrggbb" */
const colorToHex = (color) => `#${color.slice(0, 3).map(hex).join('')}`;
/** "#rrggbb" → [r, g, b, 1] */
const hexToColor = (text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255).concat(1);

/** The scale of the slider "Hide flat": up to the largest gradient of the samples, or without a list of volumes, of the points. */
function flatScale({ volume, view }) {
  if (volume?.range) return quadratic(steepest(volume));
  const { points = [], reference_length: unit = 1 } = view?.transfer_function ?? {};
  return quadratic(points.length ? steepest({ range: [points[0].value, points.at(-1).value], spacing: [unit] }) : 0);
}

export function install({ viewer, notice }) {
  const section = byId('picture-section');
  const swatches = [...section.querySelectorAll('.swatches button')];
  const fields = new Fields(byId('panel-body'), { viewer, notice });
  const setBackground = (text, time) => viewer.change({ background: hexToColor(text) }, time);

  byId('background').addEventListener('input', (event) => setBackground(event.target.value, event.timeStamp));
  for (const swatch of swatches) {
    swatch.style.backgroundColor = swatch.dataset.color;
    swatch.addEventListener('click', (event) => setBackground(swatch.dataset.color, event.timeStamp));
  }
  byId('shading').addEventListener('change', ({ target, timeStamp }) => {
    viewer.change({ shading: { mode: target.checked ? 'phong' : 'none' } }, timeStamp);
  });
  byId('flat').addEventListener('input', ({ target, timeStamp }) => {
    viewer.change({ transfer_function: { gradient: hideFlat(flatScale(viewer).at(target.valueAsNumber)) } }, timeStamp);
  });

  function showFlat(gradient) {
    const limit = flatLimit(gradient);
    byId('flat').value = flatScale(viewer).of(limit ?? gradient.at(-1).magnitude);
    showValue(byId('flat'), limit === null ? t('picture.flat.other') : limit === 0 ? t('picture.flat.off') : showNumber(limit));
  }

  viewer.on('view', (view) => {
    section.inert = !viewer.canControl;
    const color = colorToHex(view.background ?? [0, 0, 0, 1]);
    byId('background').value = color;
    for (const swatch of swatches) swatch.setAttribute('aria-pressed', String(swatch.dataset.color === color));
    document.body.style.backgroundColor = color;
    byId('shading').checked = view.shading?.mode === 'phong';
    showFlat(view.transfer_function?.gradient);
    for (const id of ['shading', 'flat']) {
      const row = byId(id).closest('.row');
      byId(id).disabled = !matters(view, row.dataset.pointer);
      row.toggleAttribute('data-idle', byId(id).disabled);
    }
    byId('channels-hint').hidden = !hasChannels(layersOf(view));
    byId('minimum-hint').hidden = view.compositing?.mode !== 'minimum';
    fields.show(view);
    document.title = view.volume ? t('page.title', { volume: view.volume }) : 'splatd';
  });
}
