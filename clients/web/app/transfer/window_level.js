// SPDX-License-Identifier: Apache-2.0
// The mode in which a drag in the picture changes window and level: it stretches and moves all values of the transfer function, or
// changes the window of a projection in grey.
import { numberText, roundValue } from '../../core/lengths.js';
import { dragWindow, isGrey, isProjection, projectionWindow } from '../../core/projection.js';
import { stretchAll, windowOf } from '../../core/transfer.js';
import { t } from '../../core/text.js';
import { byId } from '../controls/dom.js';

const MODE = 'window';
const KEY_PX = 12;
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const LEVEL_REACH = 600; // px of a drag for the whole range
const WINDOW_REACH = 180; // px of a drag for a factor e

class WindowDrag {
  #transfer;
  #viewer;
  #start = null; // {at, gesture, projection} or {at, gesture, state, window}; null: no drag, or no control

  constructor(transfer, viewer) {
    this.#transfer = transfer;
    this.#viewer = viewer;
  }

  begin(at) {
    const { isEditable, state, range, histogram } = this.#transfer;
    const projection = isEditable ? projectionWindow(this.#viewer.view, histogram) : null;
    const gesture = `window ${performance.now()}`;
    if (projection || isProjection(this.#viewer.view)) {
      this.#start = projection && { at, gesture, projection };
      return;
    }
    this.#start = isEditable ? { at, gesture, state, window: windowOf(state.points, range) } : null;
  }

  /** To the right the window gets wider, upwards the level rises. */
  move(at, time) {
    if (!this.#start) return;
    const { state, window: from, gesture, projection } = this.#start;
    const [dx, dy] = [at[0] - this.#start.at[0], at[1] - this.#start.at[1]];
    if (projection) {
      const { level, width } = dragWindow(projection, dx / WINDOW_REACH, -dy / LEVEL_REACH);
      this.#transfer.edit({ shown: { ...this.#transfer.state.shown, center: level, width } }, { gesture, time });
      return;
    }
    const [low, high] = this.#transfer.range;
    const width = Math.min(Math.max(from.width * Math.exp(dx / WINDOW_REACH), (high - low) * 1e-3), (high - low) * 10);
    const level = Math.min(Math.max(from.level - dy / LEVEL_REACH * (high - low), low - (high - low)), high + (high - low));
    this.#transfer.edit(stretchAll(state, from, { level, width }), { gesture, time });
  }

  end() {
    if (this.#start) this.#transfer.seal();
    this.#start = null;
  }
}

/** The fields of the window of a projection in grey; an empty one is automatic. */
function installFields(transfer, viewer) {
  const row = byId('projection-window');
  const fields = new Map([...row.querySelectorAll('input')].map((input, i) => [['center', 'width'][i], input]));
  for (const [name, input] of fields) {
    input.addEventListener('change', ({ timeStamp }) => {
      const value = Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : null;
      transfer.edit({ shown: { ...transfer.state.shown, [name]: value } }, { time: timeStamp });
    });
    input.addEventListener('blur', () => transfer.plan());
  }
  transfer.onShow(() => {
    row.hidden = !isGrey(viewer.view);
    if (row.hidden) return;
    const window = projectionWindow(viewer.view, transfer.histogram);
    for (const [name, value] of [['center', window?.level], ['width', window?.width]]) {
      const input = fields.get(name);
      if (document.activeElement !== input) input.value = value === undefined ? '' : String(roundValue(value, transfer.range));
    }
  });
}

export function install({ modes, toolbar, transfer, viewer }) {
  installFields(transfer, viewer);
  const drag = new WindowDrag(transfer, viewer);
  const sayWindow = () => {
    if (!transfer.state) return;
    const { level, width } = projectionWindow(viewer.view, transfer.histogram) ?? windowOf(transfer.state.points, transfer.range);
    modes.say(t('window.values', { width: numberText(roundValue(width, transfer.range)), level: numberText(roundValue(level, transfer.range)) }));
  };
  modes.add(MODE, {
    label: t('window.title'), hint: t('window.hint'), cursor: 'move',
    enter: sayWindow,
    down: (at) => drag.begin(at),
    move: (at, { timeStamp }) => drag.move(at, timeStamp),
    up: () => drag.end(),
    cancel: () => drag.end(),
    key: ({ key, shiftKey, timeStamp }) => {
      if (!STEPS[key] || shiftKey) return false;
      const [dx, dy] = STEPS[key];
      drag.begin([0, 0]);
      drag.move([dx * KEY_PX, -dy * KEY_PX], timeStamp);
      drag.end();
      return true;
    },
  });
  const toggle = () => {
    if (transfer.isEditable) modes.toggle(MODE);
  };
  const button = toolbar.button({
    id: 'tool-window', icon: 'contrast', label: t('window.title'), key: 'w', group: 'tools', isToggle: true, needs: 'values', press: toggle,
  });
  byId('transfer-window').addEventListener('click', toggle);
  const show = () => {
    if (modes.current === MODE && !transfer.isEditable) modes.leave(MODE); // control went to another participant
    const isOn = modes.current === MODE;
    for (const element of [button, byId('transfer-window')]) {
      element.setAttribute('aria-pressed', String(isOn));
      element.disabled = !transfer.isEditable;
    }
    if (isOn) sayWindow();
  };
  modes.on('change', show);
  transfer.onShow(show);
}
