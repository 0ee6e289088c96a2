// SPDX-License-Identifier: Apache-2.0
// The scale bar: a round length at the depth of the target.
import { worldPerPixel } from '../../core/camera.js';
import { scaleBar } from '../../core/lengths.js';
import { t } from '../../core/text.js';
import { withUnit } from '../../core/unit_text.js';
import { byId, make, setText } from '../controls/dom.js';

const WIDEST_PX = 140;
const SHARE = 0.3; // of a narrow picture

export function install({ viewer, overlay }) {
  const line = make('span', { class: 'scale-line' });
  const text = make('span', { class: 'scale-text' });
  const root = make('div', { id: 'scale-bar', role: 'img', hidden: true }, text, line);
  byId('pane-3d').append(root);
  overlay.layer((project, { rig, width, height }) => {
    const perPx = worldPerPixel(rig, { width, height });
    const isFlat = rig.projection === 'orthographic';
    root.hidden = !(perPx > 0 && Number.isFinite(perPx)) || !viewer.volume;
    if (root.hidden) return;
    const unit = viewer.volume.unit ?? '';
    const bar = scaleBar(perPx, Math.min(WIDEST_PX, width * SHARE), unit);
    line.style.width = `${bar.px.toFixed(1)}px`;
    const length = withUnit(bar.text, unit);
    setText(text, isFlat ? length : t('scale.about', { length }));
    root.title = `${t(isFlat ? 'scale.flat' : 'scale.perspective')}${unit ? '' : ` ${t('scale.nounit')}`}`;
    root.setAttribute('aria-label', `${t('scale.label', { length })}${unit ? '' : `. ${t('scale.nounit')}`}`);
  });
}
