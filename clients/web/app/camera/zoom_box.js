// SPDX-License-Identifier: Apache-2.0
// A mode: the picture zooms to a rectangle that the user drags.
import { sphereAround, zoomLimits } from '../../core/camera.js';
import { zoomTo } from '../../core/movement.js';
import { t } from '../../core/text.js';
import { svg } from '../controls/dom.js';

const NAME = 'zoom-box';
const LEAST_PX = 8; // a smaller rectangle is a click

export function install({ viewer, modes, toolbar, overlay, orientation }) {
  let from = null;
  let to = null;
  const frame = svg('rect', { class: 'zoom-box' });
  const layer = overlay.layer((project, { group }) => {
    if (!from) {
      frame.remove();
      return;
    }
    if (!frame.isConnected) group.append(frame);
    const [x, y] = [0, 1].map((i) => Math.min(from[i], to[i]));
    const [width, height] = [0, 1].map((i) => Math.abs(to[i] - from[i]));
    for (const [name, value] of Object.entries({ x, y, width, height })) frame.setAttribute(name, value);
  });
  const show = (a, b) => {
    [from, to] = [a, b];
    layer.update();
  };
  const button = toolbar.button({
    id: 'zoom-box', icon: 'zoom-in', label: t('zoombox.label'), key: 'z', group: 'view', order: 20, isToggle: true, press: () => modes.toggle(NAME),
  });
  modes.add(NAME, {
    label: t('zoombox.label'), hint: t('zoombox.hint'), cursor: 'zoom-in',
    down(at) { show(at, at); },
    move(at) { show(from, at); },
    up(at, event) {
      const start = from;
      show(null, null);
      if (!viewer.isReady || Math.max(Math.abs(at[0] - start[0]), Math.abs(at[1] - start[1])) < LEAST_PX) return;
      const limits = zoomLimits(sphereAround(viewer.box));
      orientation.glide.to(zoomTo(viewer.rig, start, at, viewer.viewport, limits), event.timeStamp);
      modes.leave(NAME);
    },
    cancel() { show(null, null); },
  });
  modes.on('change', (name) => button.setAttribute('aria-pressed', String(name === NAME)));
}
