// SPDX-License-Identifier: Apache-2.0
// The mode in which a drag in the picture changes window and level.
import { t } from '../core/text.js';
import { byId } from './dom.js';

const MODE = 'window';
const KEY_PX = 12;
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export function install({ modes, toolbar, transfer }) {
  let from = null;
  const end = () => transfer.endWindow();
  modes.add(MODE, {
    label: t('window.title'), hint: t('window.hint'), cursor: 'move',
    enter: () => modes.say(transfer.windowText),
    down: (at) => {
      from = at;
      transfer.beginWindow();
    },
    move: (at, { timeStamp }) => transfer.dragWindow(at[0] - from[0], at[1] - from[1], timeStamp),
    up: end,
    cancel: end,
    key: ({ key, shiftKey, timeStamp }) => {
      if (!STEPS[key] || shiftKey) return false;
      const [dx, dy] = STEPS[key];
      transfer.beginWindow();
      transfer.dragWindow(dx * KEY_PX, -dy * KEY_PX, timeStamp);
      end();
      return true;
    },
  });
  const toggle = () => {
    if (transfer.isEditable) modes.toggle(MODE);
  };
  const button = toolbar.button({
    id: 'tool-window', icon: 'contrast', label: t('window.title'), key: 'w', group: 'tools', isToggle: true, press: toggle,
  });
  byId('transfer-window').addEventListener('click', toggle);
  const show = () => {
    if (modes.current === MODE && !transfer.isEditable) modes.leave(MODE); // control went to another participant
    const isOn = modes.current === MODE;
    for (const element of [button, byId('transfer-window')]) {
      element.setAttribute('aria-pressed', String(isOn));
      element.disabled = !transfer.isEditable;
    }
    if (isOn) modes.say(transfer.windowText);
  };
  modes.on('change', show);
  transfer.onShow(show);
}
