// SPDX-License-Identifier: Apache-2.0
// The pointer, the wheel and the keys of the page, and the buttons for the camera.
import { t } from '../../core/text.js';
import { byId } from '../controls/dom.js';
import { attachPointers, attachWheel, cameraKeys } from './pointer.js';

export function install({ viewer, modes, shortcuts, panel, screen, toolbar }) {
  const canvas = screen.element;
  const toggleHelp = () => (byId('help').open ? byId('help').close() : byId('help').showModal());
  attachPointers(canvas, viewer, modes);
  attachWheel(canvas, viewer, modes);
  for (const [keys, act] of cameraKeys(viewer)) shortcuts.add(keys, act);
  shortcuts.add('?', toggleHelp);
  shortcuts.add('p', () => panel.toggle());
  for (const id of ['help-open', 'help-close']) byId(id).addEventListener('click', toggleHelp);
  byId('fit').addEventListener('click', (event) => viewer.fit(event.timeStamp));
  byId('reset').addEventListener('click', (event) => viewer.reset(event.timeStamp));
  byId('reset-all').addEventListener('click', (event) => viewer.resetAll(event.timeStamp));
  viewer.on('view', () => { byId('moves').inert = !viewer.canControl; });
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  const navigate = toolbar.button({
    id: 'tool-navigate', icon: 'rotate-3d', label: t('tool.navigate'), order: 0, isToggle: true, press: () => modes.leave(),
  });
  const show = () => navigate.setAttribute('aria-pressed', String(modes.isNavigating));
  modes.on('change', show);
  show();
}
